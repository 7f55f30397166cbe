"""What is not known of how two axes of magnets act on each other, for the estimate of a rig.

A diagnosis compares it as a gap instead: the effect cross_coupling.

Magnets may stand between the probes. Turned by 45 degrees, equal ones have the same linear force; but what of it is
curved then depends on the motion of both axes: with a cubic pull, x^3 becomes x^3 / 2 + 3 x y^2 / 2. Where they differ,
or the probes are turned by a degree, a linear share acts across. Neither is noise, and a fit takes it for gain and
stiffness.
"""

from collections.abc import Mapping

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.loop.magnets.law import force
from sim2real.recorded.along_motion import NEAREST, law_along, slopes
from sim2real.recorded.open_loop import Loop
from sim2real.recorded.open_record import OpenRecord

TURNED = "magnets between the probes"
# One standard deviation of what acts across, in what acts along: pairs that differ by a twentieth, or three degrees.
ACROSS = 0.05


def crossed_columns(
    record: OpenRecord, loop: Loop, outputs: tuple[str, ...], predicted: np.ndarray, near: Experiment
) -> Mapping[str, np.ndarray]:
    """Change of the opened coordinates (outputs, axes, n) by each of these, by name; none of a rig with one axis.

    Args:
        record: the record.
        loop: at which it is opened.
        outputs: that are compared.
        predicted: displacement, current and command (3, axes, samples) of the simulation at the point of comparison.
        near: the record's experiment there.
    """
    if record.axes != 2 or not near.rig.controlled:
        return {}
    y, i = predicted[0], predicted[1]
    linear = [slopes(law_along(near, axis), 0.0, 0.0) for axis in range(2)]
    gains, stiffnesses = (np.array(v)[::-1, None] for v in zip(*linear, strict=True))
    pulled, held = ACROSS * gains * i[::-1], -ACROSS * stiffnesses * y[::-1]
    forces = {
        TURNED: turned_force(near, y, i),
        "gain across the axes": pulled,
        "gain around the axes": pulled * np.array([[1.0], [-1.0]]),
        "stiffness across the axes": held,
    }
    receptance, found = np.reshape(loop.blocks.receptance, (-1, *loop.shape)), {}
    for name, acting in forces.items():
        column = np.zeros((len(outputs), record.axes, record.frequency.size), complex)
        moved = record.windows.project(receptance * record.spectrum(acting))
        column[outputs.index("plant")] = moved.reshape(record.axes, -1)
        found[name] = column
    return found


def turned_force(e: Experiment, y: np.ndarray, i: np.ndarray) -> np.ndarray:
    """What the curved part of the magnets' force (2, samples), N, would have more if they stood between the axes.

    Args:
        e: with magnets along both axes.
        y: displacement (2, samples), m.
        i: control current (2, samples), A.
    """
    laws, farthest, half = [law_along(e, axis) for axis in range(2)], NEAREST * e.rig.gap, np.sqrt(0.5)

    def curved(axis: int, place: np.ndarray, current: np.ndarray) -> np.ndarray:
        gain, stiffness = slopes(laws[axis], 0.0, 0.0)
        place = np.clip(place, -farthest, farthest)
        return np.asarray(force(laws[axis], place, current)) - gain * current + stiffness * place

    one = curved(0, half * (y[0] + y[1]), half * (i[0] + i[1]))
    other = curved(1, half * (y[1] - y[0]), half * (i[1] - i[0]))
    return half * np.stack([one - other, one + other]) - np.stack([curved(axis, y[axis], i[axis]) for axis in range(2)])
