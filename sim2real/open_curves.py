"""Responses of a recording without a period, measured and simulated: one value in each window of lines.

In a window of lines, displacement and command are a response times what drove the loop, plus noise. The response that
fits the window best in the sense of least squares is taken of the record and of its simulations alike, so that they
differ by noise alone where the rig is the simulated one, however much the response changes within the window. Where the
drive itself is noisy, its part along the instruments is taken (two-stage least squares).
"""

import numpy as np

from estimation.lines.line_windows import KEPT
from maglev_env.loop.axes import AXES
from sim2real.compared.point import Point
from sim2real.compared.problem import Part
from sim2real.compared.simulated import series_at
from sim2real.curve import FEWEST, Curve
from sim2real.recorded.open_record import OpenRecord

SHARE = 0.1  # of the motion in a window that its drive must cause on the nominal rig for its response to be drawn
ROUNDING = 1e-9  # of the strongest drive of a window: what is less is no direction of its own


def open_curves(part: Part, nominal: Point, corrected: Point) -> list[Curve]:
    """Receptances and sensitivities that a recording without a period shows.

    Args:
        part: the recording, as it is judged.
        nominal: the point of the nominal rig.
        corrected: that of the corrected rig.
    """
    record = part.record
    if not isinstance(record, OpenRecord) or record.upstream:
        return []  # another controller stands in, and the loop that was measured is not known
    drives = np.concatenate([record.driving("force"), record.coordinates(record.added)])  # (2 axes, n)
    windows = [slice(i * KEPT, (i + 1) * KEPT) for i in range(record.windows.count)]
    inverse, covariance = zip(*(_inverse(record, drives, w) for w in windows), strict=True)
    series = [series_at(record, point) for point in (nominal, corrected)]
    found = []
    for kind, own in (("receptance", 0), ("sensitivity", record.axes)):
        for axis in range(record.axes):
            driven, noise = own + axis, _noise(part, axis) * (abs(part.opened.controller[axis]) if own else 1.0)
            on = [i for i, w in enumerate(windows) if _shown(part, kind, axis, drives[driven, w], w)]
            if len(on) < FEWEST:
                continue
            measured = record.mean("displacement") if kind == "receptance" else record.coordinates(record.command)
            simulated = [record.coordinates(s[0 if kind == "receptance" else 2]) for s in series]
            values = [np.array([inverse[i][driven] @ y[axis, windows[i]] for i in on]) for y in (measured, *simulated)]
            sd = np.array([noise[windows[i]].mean() * np.sqrt(covariance[i][driven]) for i in on])
            named = AXES[axis] if record.axes == 2 else ""
            found.append(Curve(kind, record.name, named, record.windows.centre[on], values[0], sd, *values[1:]))
    return found


def _inverse(record: OpenRecord, drives: np.ndarray, window: slice) -> tuple[np.ndarray, np.ndarray]:
    """What times the coordinates of a window (KEPT,) gives its responses to the drives, (drives, KEPT), and their
    variances (drives,) for noise of 1."""
    d = drives[:, window].T
    if record.instrument is not None:
        z = record.windows.project(record.instrument).reshape(len(record.instrument), -1)[:, window].T
        d = z @ np.linalg.pinv(z, rcond=ROUNDING) @ d
    scale = np.linalg.norm(d, axis=0)
    scale = np.where(scale > 0, scale, np.inf)  # what does not drive has no response, and no part in the others
    found = np.linalg.pinv(d / scale, rcond=ROUNDING) / scale[:, None]
    return found, np.sum(abs(found) ** 2, axis=1)


def _noise(part: Part, axis: int) -> np.ndarray:
    """Standard deviation (n,) of the displacement's coordinates."""
    opened = part.opened
    return part.noise[opened.outputs.index("plant"), axis] / abs(opened.closed[axis])


def _shown(part: Part, kind: str, axis: int, drive: np.ndarray, window: slice) -> bool:
    """Whether a drive (KEPT,) is what moves a window, as the nominal rig would, and no tone does."""
    record, opened = part.record, part.opened
    if not part.used[window].all() or any(_within(record, tone.frequency, window) for tone in record.tones):
        return False
    answer = opened.receptance if kind == "receptance" else opened.plant
    moved = abs((answer / opened.closed)[axis, window] * drive)
    return bool(np.linalg.norm(moved) > SHARE * np.linalg.norm(record.mean("displacement")[axis, window]))


def _within(record: OpenRecord, frequency: float, window: slice) -> bool:
    """Whether a tone lies in the lines of a window."""
    lines = record.windows.frequency[window.start // KEPT]
    return bool(lines[0] <= frequency <= lines[-1])
