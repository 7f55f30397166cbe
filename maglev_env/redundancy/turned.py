"""Two axes whose readings are turned against their commands: what each controller reads holds the other axis, too.

At its own lines a turned axis looks scaled; only the lines of the other axis, at which nothing is added to its command,
show what it reads. So each command is compared at the lines of both axes, with the readings of both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.channels import SHOWN_BY
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import controller_response, reads_current
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.redundancy.controller import cut_off, limited_in
from maglev_env.redundancy.finding import Finding, Kind
from maglev_env.redundancy.rows import LEVEL, fit
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import axis_excitations, lines_at

LEAST = 0.025  # share of the other axis' reading, from which it is no matter of adjustment: 1.4 degrees
SHAPE = 0.05  # relative misfit up to which the commands are what the controllers make of turned readings
# Of the command that the own reading would make at the lines of the other axis: what there may be of it, and of what
# that leaves beyond the other reading. A lag of the amplifier that is off by a fifth makes as much.
QUIET, BY_SHARE = 0.3, 0.15
TOGETHER = 0.99  # coherence of two readings that nothing tells apart
ALIKE = 0.05  # of its size: how far a matrix may be from a rotation with one scale
EXCHANGED = 0.1  # of the other share: an axis that reads less of its own than that is exchanged, not turned
DOUBTED = ("mismatch", "controller", "scale", "sign", "filter", "shape", "delay", "amplifier", "newton force",
           "newton current", "newton command", "newton injection")  # fmt: skip


@dataclass(frozen=True)
class Turned:
    """What the controllers read, by what was recorded as their readings.

    Attributes:
        weights: (2, 2), reading of an axis (row) per recorded displacement of an axis (column).
        by: The channel that shows it, "command" or "current".
        exact: Whether every entry is told; else only the shares in a row are.
    """

    weights: np.ndarray
    by: str
    exact: bool

    @property
    def angle(self) -> float | None:
        """Of the rotation, degrees; None where the weights are none."""
        (a, b), (c, d) = self.weights
        cosine, sine = (a + d) / 2, (c - b) / 2
        off = np.abs(self.weights - np.array([[cosine, -sine], [sine, cosine]])).max()
        return None if off > ALIKE * np.hypot(cosine, sine) else float(np.degrees(np.arctan2(sine, cosine)))

    @property
    def exchanged(self) -> bool:
        """Whether the columns of the two axes are exchanged, and nothing else is wrong with them."""
        cross = np.array([self.weights[0, 1], self.weights[1, 0]])
        return bool((np.abs(np.diag(self.weights)) < EXCHANGED * np.abs(cross)).all() and (cross > 0).all())


def turned(spec: RecordingSpec, views: Sequence[View]) -> list[Finding]:
    """The finding that two axes' readings are turned against their commands, or that nothing shows whether they are.

    Args:
        spec: The recording.
        views: Of both axes, each with the lines of all excitations; fewer tell nothing.
    """
    if len(views) != 2 or not all(view.periodic and view.rig is not None and view.rig.controlled for view in views):
        return []
    source = next((n for n in ("command", "current") if all(n in view.recorded for view in views)), None)
    if source is None or not all(_applies(view) for view in views):
        if not all("displacement" in view.recorded for view in views):
            return []
        text = (
            "not checkable here: whether the axes of the probes are those of the coils; probes that are turned look "
            "like another actuator gain and a stiffness across the axes; record the commands, and state the gains"
        )
        return [Finding("coverage", spec.name, "axes", None, None, text, "not checkable")]
    excited = [lines_at(axis_excitations(spec.excitations, axis)) for axis in range(2)]
    found = (_exactly(views) if source == "command" else None) or _by_shares(views, source, excited)
    if found is None or found.exchanged:
        return []
    angle, cross = found.angle, np.abs([found.weights[0, 1], found.weights[1, 0]])
    if angle is not None:
        looks = f"the probes look rotated by {abs(angle):.3g} degrees against the coils"
    else:
        looks = "the probes do not read the motion along the coils' axes"
    where = "both axes" if found.exact else "the other axis"
    text = (
        f"displacement_x or displacement_y: {looks}: at the lines of {where}, the {source}s are what the stated "
        f"controllers make of {_stated(spec, found.weights)}; state these weights, or the controllers feed the reading "
        "of each axis to the other, too"
    )
    value = float(cross.max()) if angle is None else angle
    kind: Kind = "contradiction" if source == "command" else "wiring"
    return [Finding("turned", spec.name, "displacement_x or displacement_y", value, None, text, kind)]


def _applies(view: View) -> bool:
    """Whether the command is a linear function of the reading."""
    if view.gains is None or "displacement" not in view.recorded or reads_current(view.gains, _step(view)):
        return False
    if "command" not in view.recorded:
        return True
    return not (limited_in(view, view.gains) or "command" in view.railed or cut_off(view.channels["command"]))


def _step(view: View) -> float:
    assert view.rig is not None
    return 1 / view.rig.control_rate


def _made(views: Sequence[View], axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Spectra (s, n) of what the controller of an axis would make of its own reading and of that of the other."""
    own, of = views[axis], [view.lines.parts["displacement"] for view in (views[axis], views[1 - axis])]
    z = np.exp(2j * np.pi * own.lines.frequency * _step(own))
    steady = min(len(part) for part in of)  # a transient may last longer in one axis
    response = -controller_response(own.gains, z, _step(own))
    return response * of[0][-steady:], response * of[1][-steady:]


def _exactly(views: Sequence[View]) -> Turned | None:
    """The whole matrix from the commands, where all that was added to them is known; None where it is as stated."""
    rows, off = [], False
    for axis, view in enumerate(views):
        lines, dt = view.lines, _step(view)
        if any(e.at != "force" and SHOWN_BY[e.at] not in view.channels for e in view.excitations):
            return None
        own, other = _made(views, axis)
        command = lines.parts["command"] - lines.parts.get("injection", 0.0)
        if "reference" in lines.parts:
            z = np.exp(2j * np.pi * lines.frequency * dt)
            command = command - controller_response(view.gains, z, dt, "reference") * lines.parts["reference"]
        if _alike(own, other):
            return None
        found = fit(command[-len(own) :], [own, other], lines.frequency, view.rate, True, delays=False)
        if found is None or found.misfit > SHAPE:
            return None
        (direct, cross), error = found.gain, found.gain_se * np.abs(found.gain)
        off = off or abs(cross) > LEAST * abs(direct) + LEVEL * error[1]
        rows.append((direct, cross) if axis == 0 else (cross, direct))
    return Turned(np.array(rows), "command", True) if off else None


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two readings (s, n) have one ratio at all lines, as where only one axis is excited."""
    a, b = one.mean(axis=0), other.mean(axis=0)
    size = np.maximum(np.hypot(np.abs(a), np.abs(b)), 1e-300)
    a, b = a / size, b / size
    return bool(np.abs(np.vdot(a, b)) > TOGETHER * np.linalg.norm(a) * np.linalg.norm(b))


def _by_shares(views: Sequence[View], source: str, excited: Sequence[np.ndarray]) -> Turned | None:
    """What each axis reads of the other, from the lines of the other alone, at which nothing is added to its command.

    An axis that reads its own motion answers there to what it reads. One whose coil is still, although its probe moves,
    reads something else: so much of the other probe that the two cancel.
    """
    shares: list[float | None] = []
    for axis, view in enumerate(views):
        keep = np.isin(view.lines.harmonics, np.setdiff1d(excited[1 - axis], excited[axis]))
        own, other = (part[:, keep] for part in _made(views, axis))
        acted = view.lines.parts[source][-len(own) :, keep]
        if source == "current":
            acted = acted / view.nominal(view.lines.frequency[keep]).amplifier
        found = fit(acted - own, [other], view.lines.frequency[keep], view.rate, True, delays=False)
        if found is None:
            shares.append(None)
            continue
        share, error = float(found.gain[0]), float(found.gain_se[0] * abs(found.gain[0]))
        still = np.linalg.norm(acted.mean(axis=0)) < QUIET * np.linalg.norm(own.mean(axis=0))
        if abs(share) < LEAST + LEVEL * error or found.misfit > BY_SHARE or not still:
            return None
        shares.append(share)
    told = [share for share in shares if share is not None]
    if not told:
        return None
    x, y = (share if share is not None else -told[0] for share in shares)
    weights = np.array([[1.0, x], [y, 1.0]]) / np.hypot(1.0, np.array([[x], [y]]))
    return Turned(weights, source, False)


def _stated(spec: RecordingSpec, weights: np.ndarray) -> str:
    """The displacements with other weights, as the campaign states them, or in words where they are not plain sums."""
    names = [f"displacement_{letter}" for letter in AXES]
    sources = [spec.channels[name] for name in names]
    plain = all(s.polynomial is None and not (s.offset or s.filter or s.high_pass or s.delay) for s in sources)
    said = []
    for name, own, row in zip(names, sources, weights, strict=True):
        if not plain:
            terms = " and ".join(f"{w:.3g} times {n}" for w, n in zip(row, names, strict=True))
            said.append(f"{name} = {terms}")
            continue
        of: dict[str, float] = {}
        for share, source in zip(row, sources, strict=True):
            for column, weight in zip(source.columns, source.weights, strict=True):
                of[column] = of.get(column, 0.0) + share * weight * source.scale / own.scale
        columns, values = ", ".join(f'"{column}"' for column in of), ", ".join(f"{w:.3g}" for w in of.values())
        said.append(f"{name} = {{ from = [{columns}], weights = [{values}], scale = {own.scale:g} }}")
    return " and ".join(said)
