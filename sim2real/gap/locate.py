"""Where the gap lies: in which block of the loop, which band, which kind of lines, and what is unsynchronised."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import linear_ones
from sim2real.compared.line_kinds import KINDS
from sim2real.compared.problem import Part, Problem
from sim2real.recorded.at_rest.static_evidence import AT_REST
from sim2real.recorded.records import Record

# Segments of the loop that ratios of recorded channels isolate, named by their blocks.
DRIVE = "controller+amplifier"
ACTUATOR, RECEPTANCE, PLANT = "actuator", "mechanics+sensor", "actuator+mechanics+sensor"
WHOLE = "controller+amplifier+actuator+mechanics+sensor"
OCTAVE_THIRDS = 3
SIGNIFICANT = 5.0  # standard deviations of a band's cost under noise alone
FEW_BETWEEN = 0.05  # share of the lines below which those between the excited ones tell nothing of a distortion
ALL_DRIVEN = "not told, as hardly a line between the excited ones is compared, where only distortion answers"
CONTROLLER_SD = 6.0  # distance above which the recorded controller is not the one described


@dataclass(frozen=True)
class Where:
    """Shares of the noise-weighted gap; each set of shares sums to one where there is a gap.

    Attributes:
        blocks: Share of each block or segment.
        bands: (f_lo, f_hi, share) of third octaves, Hz.
        kind: Share of each kind of lines: linear, even, odd, unsynchronised; and of the means of a mass at rest, where
            they are evidence. These have no band; their block is the actuator, whose force they weigh.
        significant: Whether any of it exceeds the noise.
        controller: Distance of the recorded command from the described control law, in standard deviations of its
            resolution; None where no command was recorded, or where it does not follow from the recorded channels.
        between: Whether enough lines between the excited ones are compared for the kind to be told: where all are
            excited, what is not linear shows on these.
        axes: Share of the motion along each of two axes; empty with one.
    """

    blocks: Mapping[str, float]
    bands: tuple[tuple[float, float, float], ...]
    kind: Mapping[str, float]
    significant: bool
    controller: float | None
    between: bool = True
    axes: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The shares, and whether that of the kinds is told."""
        return {
            "blocks": dict(self.blocks),
            "bands": [{"f_lo": lo, "f_hi": hi, "share": share} for lo, hi, share in self.bands],
            "kind": dict(self.kind),
            "kind_told": self.between,
            "axes": dict(self.axes),
        }


def locate(problem: Problem, residual: np.ndarray, unsynchronised: float = 0.0) -> Where:
    """Locate a whitened residual.

    Args:
        problem: The problem.
        residual: Whitened residual (K,) that a simulation leaves, calibrated or not.
        unsynchronised: Excess cost of tones.
    """
    power = abs(residual) ** 2 - 2.0
    thirds = np.floor(OCTAVE_THIRDS * np.log2(problem.frequency)).astype(int)
    linear, rest = problem.kind < KINDS.index("even"), problem.kind == KINDS.index("rest")
    labels = np.stack([np.where(rest, thirds.min() - 1, thirds), linear, problem.output], axis=1)
    cells = np.unique(labels, axis=0, return_inverse=True)[1].reshape(-1)
    excess, count = np.bincount(cells, power), np.bincount(cells)
    real = excess > SIGNIFICANT * np.sqrt(4.0 * count)
    significant = bool(real.any()) or unsynchronised > 0
    kept = real[cells] if real.any() else np.ones(cells.size, bool)
    gain = np.where(kept, power, 0.0)
    bands = []
    for third in np.unique(thirds):
        share = gain[(thirds == third) & ~rest].sum()
        bands.append((2.0 ** (third / OCTAVE_THIRDS), 2.0 ** ((third + 1) / OCTAVE_THIRDS), share))
    total = max(sum(max(b[2], 0.0) for b in bands), 1e-12)
    kinds = {
        "linear": gain[linear].sum(),
        "even": gain[problem.kind == KINDS.index("even")].sum(),
        "odd": gain[problem.kind == KINDS.index("odd")].sum(),
        "unsynchronised": unsynchronised,
    } | ({AT_REST: gain[rest].sum()} if rest.any() else {})
    blocks = _blocks(problem, residual, kept)
    if rest.any():
        blocks[ACTUATOR] = blocks.get(ACTUATOR, 0.0) + float(gain[rest].sum())
    return Where(
        _shares(blocks),
        tuple((lo, hi, max(share, 0.0) / total) for lo, hi, share in bands),
        _shares(kinds),
        significant,
        controller_distance(problem),
        float(np.mean(~linear & ~rest)) >= FEW_BETWEEN,
        _shares(_axes(problem, gain)),
    )


def _shares(parts: Mapping[str, float]) -> dict[str, float]:
    positive = {name: max(float(v), 0.0) for name, v in parts.items()}
    total = sum(positive.values())
    return {name: v / total if total > 0 else 0.0 for name, v in positive.items()}


def _axes(problem: Problem, gain: np.ndarray) -> dict[str, float]:
    """Cost of each of two axes; empty with one."""
    if problem.parts[0].record.axes == 1:
        return {}
    own = [
        gain[part.place].reshape((*part.measured.shape[:2], -1))[part.opened.outputs.index("plant")].sum(axis=1)
        for part in problem.parts
    ]
    return dict(zip(AXES, map(float, np.sum(own, axis=0)), strict=True))


def _blocks(problem: Problem, residual: np.ndarray, kept: np.ndarray) -> dict[str, float]:
    """Noise-weighted gap of each segment of the loop that the channels isolate."""
    found: dict[str, float] = {}
    for part in problem.parts:
        r = residual[part.place].reshape(*part.measured.shape[:2], -1)
        on = kept[part.place].reshape(r.shape)
        for name, cost in _of_part(part, r, on).items():
            found[name] = found.get(name, 0.0) + cost
    return found


def _of_part(part: Part, r: np.ndarray, on: np.ndarray) -> dict[str, float]:
    outputs, record = part.opened.outputs, part.record
    if not record.experiment.rig.controlled:
        return {RECEPTANCE: _excess(r, on)}
    if "amplifier" not in outputs:
        return {WHOLE: _excess(r, on)}
    raw = r * part.noise[..., part.used] / np.sqrt(2)
    plant, amplifier = outputs.index("plant"), outputs.index("amplifier")
    gain = (part.opened.plant / part.opened.amplifier)[:, part.used]
    rest = raw[plant] - gain * raw[amplifier]  # from the current (not the command) to the reading
    variance = part.noise[plant] ** 2 + abs(part.opened.plant / part.opened.amplifier) ** 2 * part.noise[amplifier] ** 2
    sd = np.sqrt(variance[:, part.used] / 2)
    either = on[plant] | on[amplifier]
    found = {DRIVE: _excess(r[amplifier], either)}
    # Along an axis that only one of both drives, nothing tells the actuator from what it moves.
    both = [
        all(record.driven[place][axis, part.used].any() for place in ("force", "current"))
        for axis in range(len(on[plant]))
    ]
    alone = np.array([not own for own in both])
    if alone.any():
        found[PLANT] = _excess((rest / sd)[alone], either[alone])
    return {**found, **_actuator_or_not(part, rest / sd, sd, either, np.flatnonzero(both))} if any(both) else found


def _excess(r: np.ndarray, on: np.ndarray) -> float:
    return float(np.where(on, abs(r) ** 2 - 2.0, 0.0).sum())


def _actuator_or_not(
    part: Part, rest: np.ndarray, sd: np.ndarray, on: np.ndarray, axes: Sequence[int]
) -> dict[str, float]:
    """Split the gap between current and reading along these axes into actuator and receptance.

    Force and current lines of one third octave separate the actuator's change a from the receptance's change m, because
    rest = a G i + m (G i + H f).
    """
    record, used = part.record, part.used
    current = record.mean("current")[:, used]
    gain = (part.opened.plant / part.opened.amplifier)[:, used]
    force = record.driving("force")[:, used]
    driven = gain * current
    moved = driven + part.opened.receptance[:, used] * force
    found = {ACTUATOR: 0.0, RECEPTANCE: 0.0}
    for axis in axes:
        for own in _told_apart(part, on[axis], axis):
            columns = np.stack([driven[axis, own], moved[axis, own]], axis=1) / sd[axis, own, None]
            (a, m), *_ = np.linalg.lstsq(columns, rest[axis, own], rcond=1e-6)
            shares = [float(np.sum(abs(x * c) ** 2)) for x, c in ((a, columns[:, 0]), (m, columns[:, 1]))]
            cost = max(float((abs(rest[axis, own]) ** 2 - 2).sum()), 0.0)
            total = max(sum(shares), 1e-300)
            found[ACTUATOR] += cost * shares[0] / total
            found[RECEPTANCE] += cost * shares[1] / total
    return found


def _told_apart(part: Part, on: np.ndarray, axis: int) -> list[np.ndarray]:
    """Neighbouring third octaves (n,), merged until each has two lines of the force and two of the current."""
    record, used = part.record, part.used
    kinds = [record.driven[place][axis, used] & on for place in ("force", "current")]
    thirds = np.floor(OCTAVE_THIRDS * np.log2(record.frequency[used])).astype(int)
    found: list[np.ndarray] = []
    own = np.zeros(thirds.size, bool)
    for third in np.unique(thirds):
        own = own | ((thirds == third) & on)
        if all((own & kind).sum() >= 2 for kind in kinds):
            found.append(own)
            own = np.zeros(thirds.size, bool)
    if own.any():
        found = [*found[:-1], found[-1] | own] if found else [own]
    return found


def controller_distance(problem: Problem) -> float | None:
    """Largest rms distance, in standard deviations, of a record's command from the command that its gains give."""
    worst = None
    for part in problem.parts:
        r = part.record
        if "command" not in r.periods or not r.experiment.rig.controlled or not _exact(r):
            continue
        injection, reference = map(r.driving, ("current", "reference"))
        law = part.opened.from_reference * reference - part.opened.controller * r.periods["displacement"] + injection
        if "current" in r.periods:
            law = law - part.opened.from_current * r.periods["current"]
        off = r.periods["command"] - law
        rig, n = r.nominal, r.experiment.recorded_per_period
        resolution = rig.command_step**2 / 12 * 4 / n
        size = abs(r.periods["command"]).mean() ** 2 * 1e-10
        mean = off.mean(axis=0)
        noise = off.var(axis=0, ddof=1) / r.count + resolution + size
        distance = float(np.sqrt(np.mean(abs(mean) ** 2 / noise)))
        worst = distance if worst is None else max(worst, distance)
    return worst


def _exact(record: Record) -> bool:
    """Whether the recorded channels give a record's command by linear filters."""
    e = record.experiment
    return all(
        one.limit is None and not (one.reads_current and "current" not in record.periods)
        for one in linear_ones(e.gains, 1 / e.rig.control_rate)
    )
