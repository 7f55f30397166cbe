"""What a hypothesis predicts for a campaign: its lanes are simulated with each recording's own waveforms and gains."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from math import ceil, log

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.blocks import Block, prepared
from maglev_env.kernel.controllers import controller_kind
from maglev_env.kernel.steady import steady_spectra
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.rig.rig import Rig
from sim2real.compared.point import (
    HARD,
    NOMINAL,
    Point,
    experiment_at,
    is_dithered,
    settling,
    unseen_by,
    without_dithered,
)
from sim2real.recorded.drifting import DRIFTING, middle, steady
from sim2real.recorded.open_evidence import Replay, coordinates_of_lanes, simulated_series
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened
from sim2real.recorded.records import Record
from sim2real.recorded.ticks import substeps

SETTLED = 3e-5  # share of its initial size to which a transient must have decayed before the evaluated period
MOST_TRANSIENT = 12  # periods
# What noise smooths is simulated with the noise that the rig states, averaged over DITHER_PERIODS, or over as many
# NOISES where nothing repeats, because the simulated noise is not that of the record.
DITHER_PERIODS, NOISES = 24, 4


def substeps_of(record: Record | OpenRecord) -> int:
    """Least number of integration steps per control sample that a record needs."""
    return substeps(record.instants, record.every) if isinstance(record, OpenRecord) else 1


def lanes_of(
    record: Record | OpenRecord, points: Sequence[Point], dithered: bool = False, beside: frozenset[str] = frozenset()
) -> list[Block]:
    """Prepared lanes of a record at every point.

    Args:
        record: The record.
        points: The points.
        dithered: Whether they have the noise that the rig states; without a period each point then has NOISES of them.
        beside: Names of effects that the rig is simulated without, where it has them of its own.
    """
    e, seeds = record.experiment, range(NOISES) if dithered and isinstance(record, OpenRecord) else (None,)
    if dithered:
        noise = replace(e.rig.noise, displacement=record.nominal.noise.displacement)
        e = replace(e, rig=replace(e.rig, noise=noise))
    e, made = _without_own(_hidden(record) | beside, e), dict[tuple, Rig]()
    seen = [_as_seen(record, e, p, made) for p in points]
    seeded = [own if seed is None else replace(own, seed=seed) for own in seen for seed in seeds]
    return prepared(seeded, substeps_of(record))


def series_at(record: OpenRecord, point: Point, lanes: list[Block] | None = None) -> np.ndarray:
    """Displacement, current and command (3, axes, samples) of a simulation at a point, as noise smooths them; nan where
    the rotor touches down.

    Args:
        record: The record.
        point: The point.
        lanes: Its prepared ones without noise, where they are there already.
    """

    def mean(at: Point, dithered: bool, beside: frozenset[str] = frozenset()) -> np.ndarray:
        return simulated_series(record, lanes_of(record, [at], dithered, beside)).mean(axis=0)

    if not is_dithered(point, record.nominal):
        return mean(point, False) if lanes is None else simulated_series(record, lanes)[0]
    plain = without_dithered(point)
    return mean(point, True) - (mean(plain, True, HARD) - mean(plain, False, HARD))


def experiment_near(record: Record | OpenRecord, near: Point) -> Experiment:
    """A record's experiment on the rig that a point describes, as it is simulated."""
    return _as_seen(record, _without_own(_hidden(record), record.experiment), near, {})


def _hidden(record: Record | OpenRecord) -> frozenset[str]:
    """Effects that are not simulated as such: those that act before what drives the record, and a drift over periods,
    in whose place the gain is its mean."""
    return unseen_by(record) | (frozenset() if isinstance(record, OpenRecord) else {DRIFTING})


def _without_own(left_out: frozenset[str], e: Experiment) -> Experiment:
    """The experiment on a rig without these of its own effects, which every experiment on it has."""
    if left_out.isdisjoint(e.rig.effects):
        return e
    own = {name: values for name, values in e.rig.effects.items() if name not in left_out}
    return replace(e, rig=replace(e.rig, effects=own), effects=own)


def _as_seen(record: Record | OpenRecord, e: Experiment, point: Point, made: dict[tuple, Rig]) -> Experiment:
    """As `experiment_at`, without what is hidden; e: without it, too.

    The rig's own effects stay with the rig, so that a tolerance moves the value that they give.
    """
    hidden = _hidden(record)
    seen = {name: values for name, values in point.effects.items() if name not in hidden}
    found = experiment_at(e, Point(seen, point.changes), made)
    drift = {**record.experiment.rig.effects, **point.effects}.get(DRIFTING)
    if drift is None or isinstance(record, OpenRecord):
        return found
    return replace(found, effects=steady(record, {**found.effects, DRIFTING: drift}))


@dataclass(frozen=True)
class Predictor:
    """Predicts the opened loop's residuals of one record.

    Attributes:
        record: The record.
        opened: Its opened loop.
        transient: Control samples simulated before the evaluated period.
        replay: The closed loop of a record without a period.
        lines: Which of the record's lines are predicted, a mask (n,); all by default.
        known: Contribution of noise to the nominal rig without what it smooths, by transient; without a period, to the
            rig at `near`.
        near: Where the loop of a record without a period was opened.
    """

    record: Record | OpenRecord
    opened: Opened
    transient: int
    replay: Replay | None = None
    lines: np.ndarray | None = None
    known: dict[int, np.ndarray] = field(default_factory=dict, compare=False)
    near: Point = NOMINAL

    @cached_property
    def kind(self) -> tuple:
        """Key of the records that may share prepared lanes."""
        e = self.record.experiment
        kind = controller_kind(e.gains, 1 / e.rig.control_rate)
        # Records of one campaign differ in what stands in for their controller, and in how their force law is bent.
        of_rig = tuple(repr(getattr(e.rig, f.name)) for f in fields(e.rig))
        repeats = self.replay is None  # else dithered lanes have several noises
        return kind, e.speed_rpm, *of_rig, unseen_by(self.record), substeps_of(self.record), repeats

    @property
    def middle(self) -> float:
        """Middle of what is compared, s after the begin, where a drift counts by its mean; else 0."""
        return 0.0 if isinstance(self.record, OpenRecord) else middle(self.record)

    @property
    def schedule(self) -> tuple:
        """Key of the records whose lanes may run in one block."""
        e = self.record.experiment
        if self.replay is not None:
            return () if self.replay.record.instants is None else (self.record.name,)
        return e.samples_per_period, e.recorded_rate

    def at(self, lines: np.ndarray) -> "Predictor":
        """Of these lines of a record with periods alone."""
        return Predictor(self.record, self.opened.at(lines), self.transient, lines=lines)

    def lanes(
        self, points: Sequence[Point], dithered: bool = False, beside: frozenset[str] = frozenset()
    ) -> list[Block]:
        """Lanes at every point, for records of this kind, as `lanes_of`."""
        return lanes_of(self.record, points, dithered, beside)

    def __call__(self, points: Sequence[Point]) -> np.ndarray:
        """Residuals (n, outputs, axes, lines) at every point, all without noise: for what a small change does."""
        return residuals([self], self.lanes(points), max(map(settling, points), default=0.0))[0]

    def smoothed(self, points: Sequence[Point]) -> np.ndarray:
        """Residuals (n, outputs, axes, lines) at every point, as noise smooths them: for comparing with the record."""
        lasts = max(map(settling, points), default=0.0)
        noisy = [is_dithered(p, self.record.nominal) for p in points]
        rows: dict[int, np.ndarray] = {}
        for dithered in sorted({*noisy}):
            at = [i for i, own in enumerate(noisy) if own == dithered]
            lanes = self.lanes([points[i] for i in at], dithered)
            rows |= zip(at, residuals([self], lanes, lasts, dithered)[0], strict=True)
        return np.stack([rows[i] for i in range(len(points))])


def residuals(
    predictors: Sequence[Predictor], lanes: list[Block], settling: float = 0.0, dithered: bool = False
) -> list[np.ndarray]:
    """Residuals of prepared lanes in several records that may run in one block (see `kind` and `schedule`).

    Args:
        predictors: Those of the records.
        lanes: Lanes of one of them.
        settling: Time that they take to settle, s.
        dithered: Whether they have noise; what the same noise does without what it smooths is then subtracted.

    Returns:
        Of each record (n, outputs, axes, lines); nan where the rotor touches down.
    """
    if predictors[0].replay is not None:
        found = _replayed(predictors, lanes, dithered)
        return [own - _of_noise(p) for p, own in zip(predictors, found, strict=True)] if dithered else found
    e = predictors[0].record.experiment
    needed = max(*(p.transient for p in predictors), ceil(settling * predictors[0].record.nominal.control_rate))
    transient = min(needed, MOST_TRANSIENT * e.samples_per_period)
    spectra = _spectra(predictors, lanes, transient, dithered)
    if dithered:
        new = [p for p in predictors if transient not in p.known]
        if new:
            plain = [NOMINAL]
            noisy, clean = (_spectra(new, new[0].lanes(plain, on, HARD), transient, True) for on in (True, False))
            for p, own, quiet in zip(new, noisy, clean, strict=True):
                p.known[transient] = np.nan_to_num(own[0] - quiet[0])  # zero where the nominal rig does not levitate
        spectra = [own - p.known[transient] for p, own in zip(predictors, spectra, strict=True)]
    return [
        p.opened.residuals(own[:, 0], own[:, 1] if "amplifier" in p.opened.outputs else None)
        for p, own in zip(predictors, spectra, strict=True)
    ]


def _replayed(predictors: Sequence[Predictor], lanes: list[Block], dithered: bool) -> list[np.ndarray]:
    """Coordinates (n, outputs, axes, lines) of every point; of dithered lanes the mean over the noises of each."""
    found = coordinates_of_lanes([p.replay for p in predictors if p.replay is not None], lanes)
    return [own.reshape(-1, NOISES, *own.shape[1:]).mean(axis=1) for own in found] if dithered else found


def _of_noise(p: Predictor) -> np.ndarray:
    """What the noise of dithered lanes adds (outputs, axes, n) where a record without a period was opened, without what
    it smooths; zero where the rotor falls there."""
    if 0 not in p.known:
        plain = [without_dithered(p.near)]
        noisy, clean = (_replayed([p], p.lanes(plain, on, HARD), on)[0][0] for on in (True, False))
        p.known[0] = np.nan_to_num(noisy - clean)
    return p.known[0]


def _spectra(predictors: Sequence[Predictor], lanes: list[Block], transient: int, dithered: bool) -> list[np.ndarray]:
    """Amplitudes of displacement, and of the current where any record has it."""
    return steady_spectra(
        lanes,
        [p.record.drive for p in predictors],
        [p.record.lines if p.lines is None else p.record.lines[p.lines] for p in predictors],
        transient,
        DITHER_PERIODS if dithered else 1,
        any("amplifier" in p.opened.outputs for p in predictors),
    )


def predictor(record: Record, opened: Opened) -> Predictor:
    """Predictor with the transient that the nominal closed loop needs; an unstable loop gets the longest."""
    radius = abs(closed_loop_poles(record.experiment)).max()
    most = MOST_TRANSIENT * record.experiment.samples_per_period
    samples = most if radius >= 1 else ceil(log(SETTLED) / log(radius))
    return Predictor(record, opened, min(samples, most))
