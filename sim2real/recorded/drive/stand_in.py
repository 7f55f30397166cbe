"""The controller that closes the simulated loop of a recording whose own controller is not known."""

from dataclasses import replace
from math import ceil, pi, sqrt

import numpy as np

from maglev_env.design.default_gains import default_gains, pole_placed
from maglev_env.experiment import Experiment
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.gains import Controller, Gains
from maglev_env.loop.linear_controller import LinearController
from maglev_env.loop.magnets.kinds import force_law, geometric_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, axis_rig

# Of the designed stand-in: net stiffness in that of the magnets, and damping ratio. Stiff ones keep the simulated mass
# where the recorded one was, but they turn noise into current. Both change the stiffness of the magnets: the current by
# its square over that of the bias; the mass because it departs by the share ASTRAY / stiffness of its motion, if the
# nominal rig is off by that share.
STIFF, DAMPED, ASTRAY = (8.0, 4.0, 2.0, 1.0), 0.8, 0.3
FASTEST = 30.0  # its control samples in a cycle of the mode that it makes
TAPS = 4  # present and past readings that a fitted controller uses
PAST = 2  # past outputs that it uses
FITTED = 0.9  # share of the current's variance from which a fitted controller is the stand-in
HOLDING = 1.5  # stiffness at rest of a fitted controller, in that of the magnets
LEAK = 100.0  # time constant of the designed stand-in's leak, in integral times
INSIDE = 0.9999  # largest pole of a fitted controller


def stand_in(
    rig: Rig, finer: int, driving: np.ndarray, reference: np.ndarray, displacement: np.ndarray, fitted: bool
) -> tuple[Controller, str]:
    """A controller that stabilises a one-axis rig: one that explains the record, or else a designed one; and its name.

    Args:
        rig: with the control rate of the simulation.
        finer: control samples for each recorded one.
        driving: (samples,), recorded current or command, A.
        reference: (samples,), m.
        displacement: (samples,), m.
        fitted: whether it should follow what the recorded one made of noise; else it is always a designed one.
    """
    found = fitted_controller(driving, reference, displacement) if fitted else None
    if found is not None and holds(rig, found) and _stable(rig, _slowed(found, finer)):
        return _slowed(found, finer), "one fitted to this recording"
    return _designed(rig, displacement), "one designed for the nominal rig"


def fitted_controller(command: np.ndarray, reference: np.ndarray, displacement: np.ndarray) -> LinearController | None:
    """The linear controller that explains a command or current by the readings; None where none explains it.

    The least-squares regression of each sample on PAST earlier ones and on TAPS readings and references.

    Args:
        command: (samples,), A.
        reference: (samples,), m.
        displacement: (samples,), m.
    """
    n = command.size - TAPS
    if n < 20 * (PAST + 2 * TAPS):
        return None

    def past(signal: np.ndarray, first: int, count: int) -> np.ndarray:
        return np.stack([signal[TAPS - k : TAPS - k + n] for k in range(first, first + count)], axis=1)

    columns = np.concatenate(
        [past(command, 1, PAST), past(-displacement, 0, TAPS), past(reference, 0, TAPS), np.ones((n, 1))], axis=1
    )
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    target = command[TAPS:]
    found = np.linalg.lstsq(columns / scale, target, rcond=None)[0] / scale
    left = target - columns @ found
    if left.var() > (1 - FITTED) * target.var():
        return None
    denominator = np.array([1.0, *-found[:PAST]])
    roots = np.roots(denominator)
    if np.abs(roots).max(initial=0.0) > INSIDE:
        roots = np.where(np.abs(roots) > INSIDE, roots * (INSIDE / np.abs(roots)), roots)
        denominator = np.real(np.poly(roots))
    denominator = np.pad(denominator, (0, max(0, TAPS - denominator.size)))
    return LinearController(tuple(map(float, found[PAST : PAST + TAPS])), tuple(map(float, denominator)))


def _designed(rig: Rig, displacement: np.ndarray) -> Gains:
    """Gains with an integrator that hardly leaks: the simulated mass follows the recorded one in the mean, whatever the
    offsets of the channels are. They are those that change the magnets' stiffness least, see ASTRAY; default gains
    where lags forbid all of them."""
    law = force_law(rig)
    gain, stiffness = linearise(law)
    noise = float(np.std(np.diff(displacement, 3)) / np.sqrt(20.0))  # of white noise; slow motion hardly counts
    bias = geometric_law(rig).bias_current or abs(stiffness) * rig.gap / gain  # or what pulls across the gap
    astray = ASTRAY * float(np.std(displacement))
    best, least = default_gains(rig), np.inf
    for stiff in STIFF:
        gains = pole_placed(rig, gain, stiffness or -rig.support_stiffness, stiff, DAMPED, 0.1, 2.0)
        found = replace(gains, ki=LEAK * gains.kp, ti=LEAK * gains.ti)
        departed = linearise(law, astray / stiff)[1] / stiffness - 1 if stiffness else 0.0
        changed = ((gains.kp + gains.kd / gains.td) * noise / bias) ** 2 + abs(departed)
        if changed < least and _stable(rig, found):
            best, least = found, changed
    return best


def _slowed(controller: LinearController, finer: int) -> LinearController:
    """The controller with the same response at a control rate `finer` times as high: z becomes z^finer."""
    if finer == 1:
        return controller

    def spread(values: tuple[float, ...]) -> tuple[float, ...]:
        found = np.zeros((len(values) - 1) * finer + 1)
        found[::finer] = values
        return tuple(map(float, found))

    return LinearController(spread(controller.numerator), spread(controller.denominator))


def holds(rig: Rig, controller: LinearController) -> bool:
    """Whether a controller is clearly stiffer at rest than the magnets; else a large motion or another law loses the
    simulated mass, although the linear loop is stable. A controller fitted without its reference may come out softer
    than it is."""
    gain, stiffness = linearise(force_law(rig))
    return abs(sum(controller.numerator)) * gain > HOLDING * abs(stiffness) * abs(sum(controller.denominator))


def _stable(rig: Rig, controller: Controller) -> bool:
    return bool(np.abs(closed_loop_poles(Experiment(rig, controller, ()))).max() < INSIDE)


def finer_steps(rig: Rig, rate: float) -> int:
    """Control samples of the stand-in for each recorded one."""
    own = [axis_rig(rig, axis) for axis in range(rig.axes)]
    stiffness = [abs(r.support_stiffness + (linearise(force_law(r))[1] if r.controlled else 0.0)) for r in own]
    fastest = max(sqrt(STIFF[0] * k / r.mass) for k, r in zip(stiffness, own, strict=True))
    return max(1, ceil(FASTEST * fastest / (2 * pi) / rate))
