"""The campaign as one least-squares problem: whitened residuals of every recording, output, axis and line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from estimation.lines.line_windows import KEPT
from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_lanes.threads import single_blas
from sim2real.compared.bench_noise import NO_BOUND, BenchNoise
from sim2real.compared.evidence import evidence_of, measured_at
from sim2real.compared.law_shape import shows_shape
from sim2real.compared.line_kinds import KINDS, informative, line_kinds
from sim2real.compared.point import NOMINAL, Point, experiment_at, together
from sim2real.compared.simulated import Predictor, residuals
from sim2real.compared.tolerance_forms import form_nuisances
from sim2real.recorded.at_rest.static_evidence import StaticEstimate, coefficients_at, static_of
from sim2real.recorded.drifting import DRIFTING
from sim2real.recorded.nuisances import Nuisances, stacked
from sim2real.recorded.open_evidence import exact_errors, opened_of
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import Opened
from sim2real.recorded.records import Record

NOISELESS = 1e-9  # least noise, of the largest coordinate


@dataclass(frozen=True)
class Part:
    """One record's share of the problem.

    Attributes:
        record: The record.
        opened: Its opened loop.
        predictor: Predicts its residuals.
        measured: Measured residuals (outputs, axes, n).
        noise: Their standard deviation (outputs, axes, n).
        used: Lines that are used (n,).
        place: Its slice of the stacked vector.
    """

    record: Record | OpenRecord
    opened: Opened
    predictor: Predictor
    measured: np.ndarray
    noise: np.ndarray
    used: np.ndarray
    place: slice

    @cached_property
    def looked(self) -> Predictor:
        """Predicts what is used of a record with periods."""
        return self.predictor if isinstance(self.record, OpenRecord) else self.predictor.at(self.used)

    @cached_property
    def whitening(self) -> np.ndarray:
        """Factor (outputs, axes, used lines) that makes the noise 1 per real part."""
        return np.sqrt(2) / self.noise[..., self.used]

    def whitened(self, predicted: np.ndarray) -> np.ndarray:
        """What `looked` predicts (n, outputs, axes, lines), of the used lines in units of their noise, (n, size)."""
        whole = predicted.shape[-1] == self.whitening.shape[-1]
        used = predicted if whole else predicted[..., self.used]
        return (used * self.whitening).reshape(len(predicted), -1)


@dataclass(frozen=True)
class Problem:
    """All records, stacked and whitened.

    Attributes:
        parts: The records.
        whitened: Whitened complex data (K,), of variance 1 per real part.
        record: Index (K,) into parts.
        output: Index (K,) into outputs.
        axis: Axis (K,).
        frequency: Frequency (K,), Hz.
        kind: Index (K,) into `KINDS`.
        outputs: Names of the outputs.
        nuisances: What is not known of the measurement.
        static: What the means of a mass at rest say; its rows come last.
        bench: Noise that recordings without a period may have at most.
        errors: Name -> amount, in standard deviations, of errors of a measured drive about which the problem is
            linearised; 0 of the others.
        for_estimate: Whether what two axes may do to each other is a nuisance. In a diagnosis it is a gap, and the form
            of the amplifier's lag is a nuisance.
        louder: How many times as loud as it looks the noise of recordings without a period is taken.
    """

    parts: tuple[Part, ...]
    whitened: np.ndarray
    record: np.ndarray
    output: np.ndarray
    axis: np.ndarray
    frequency: np.ndarray
    kind: np.ndarray
    outputs: tuple[str, ...]
    nuisances: Nuisances
    static: StaticEstimate | None = None
    bench: BenchNoise = NO_BOUND
    errors: Mapping[str, float] = field(default_factory=dict)
    for_estimate: bool = False
    louder: float = 1.0

    @cached_property
    def data(self) -> np.ndarray:
        """Whitened data (K,) without the directions in which nothing is known."""
        return self.nuisances.without(self.whitened)

    def simulate(self, points: Sequence[Point], settled: bool = True) -> np.ndarray:
        """Whitened predictions at each point.

        Args:
            points: The points.
            settled: False lets the points' modes ring; only the nominal loop's transient is then waited for.

        Returns:
            Predictions (n, K); nan where the rotor touches down in any recording.
        """
        found = np.empty((len(points), self.data.size), complex)
        periodic = [p for p in self.parts if not isinstance(p.record, OpenRecord)]
        period, anyway = 1.0, np.inf  # without a period nothing needs to settle
        if periodic:
            # Of the longest ones, because `residuals` limits each recording's transient by its own period.
            period = max(1 / p.record.experiment.fundamental for p in periodic)
            anyway = min(p.predictor.transient / p.record.nominal.control_rate for p in periodic)
        with single_blas():  # the matrices of lanes are small, so several threads would only wait for each other
            nominal = self.parts[0].record.nominal
            drifts = DRIFTING in nominal.effects
            kinds = [drifts or DRIFTING in p.effects for p in points]
            for drifting in sorted({*kinds}):
                some = [i for i, kind in enumerate(kinds) if kind == drifting]
                # Recordings share lanes, but for a drift that counts by its mean over the periods of each.
                shared: dict[tuple, list[Part]] = {}
                for part in self.parts:
                    p = part.predictor
                    shared.setdefault(((p.kind, drifting and p.middle), p.schedule), []).append(part)
                own = [points[i] for i in some]
                groups = together(own, period, nominal, anyway) if settled else [((0.0, False), range(len(own)))]
                for (lasts, dithered), at in groups:
                    which, prepared = [some[i] for i in at], {}
                    for (kind, _), parts in shared.items():
                        if kind not in prepared:
                            prepared[kind] = parts[0].predictor.lanes([points[i] for i in which], dithered)
                        predicted = residuals([p.looked for p in parts], prepared[kind], lasts, dithered)
                        for part, rows in zip(parts, predicted, strict=True):
                            found[which, part.place] = part.whitened(rows)
        if self.static is not None:
            resting = Experiment(self.parts[0].record.nominal, NO_CONTROLLER, ())
            at = [experiment_at(resting, p) for p in points]
            rows = self.static.whitened(np.array([coefficients_at(e) for e in at]))
            found[:, -rows.shape[1] :] = rows
        return self.nuisances.clear(found)

    def opened_residual(self) -> np.ndarray:
        """Residual (K,) of the linear nominal rig with its loop opened, which exists even if no rotor levitates."""
        found = np.empty_like(self.whitened)
        for part in self.parts:
            opened, measured = part.opened, part.measured
            if isinstance(part.record, OpenRecord):  # which may have been opened at a rig that was found
                loop = nominal_loop(part.record)
                opened = opened_of(loop)
                measured = measured_at(part.record, loop, opened.outputs)
            off = (measured - opened.driven(part.record)) * np.sqrt(2) / part.noise
            found[part.place] = off[..., part.used].reshape(-1)
        if self.static is not None:
            found[-len(self.static.values) :] = 0.0
        return self.nuisances.without(found)

    @property
    def log_noise(self) -> float:
        """Twice the sum of ln of the noise's variance over all coordinates, as a closed loop shows them.

        With the cost of a point it is -2 ln of its likelihood, which compares problems of the same records that are
        opened at other rigs: a residual that is opened with more loop gain is larger, and explains no less. What is
        compared along an instrument alone has none of it: its noise is what is left beside the instrument, which is
        least where the rig explains the noise that a controller fed back, and no true rig does.
        """
        opened = [p for p in self.parts if isinstance(p.record, OpenRecord) and p.record.instrument is None]
        noise = sum(float(np.log(p.noise[..., p.used]).sum()) for p in opened)
        return 4 * (noise - sum(float(np.log(abs(p.opened.closed[..., p.used])).sum()) for p in opened))

    @property
    def loudest(self) -> Part:
        """The record with the largest motion, in which nonlinearity shows most."""
        return max(self.parts, key=lambda part: float((abs(part.measured) ** 2).sum()))

    def only(self, part: Part) -> "Problem":
        """The problem of one record alone."""
        at = part.place
        columns = (self.whitened, self.record, self.output, self.axis, self.frequency, self.kind)
        alone = replace(part, place=slice(0, at.stop - at.start))
        return Problem((alone,), *(c[at] for c in columns), self.outputs, self.nuisances.within(at))

    def again(
        self, near: Point, louder: float = 1.0, records: Sequence[Record | OpenRecord] | None = None
    ) -> "Problem":
        """The same lines, with the noise that a point leaves of records without a period, times a factor.

        Args:
            near: the point.
            louder: the factor.
            records: used in place of its own, for instance with other tones.
        """
        return self.with_errors(near, self.errors, louder, records)

    def about(self, near: Point) -> "Problem":
        """As `again`, with the errors of measured drives about their most probable amounts at a point: the best basis
        for a fit that begins there, but not for comparing hypotheses that lie elsewhere."""
        opened = [p.record for p in self.parts if isinstance(p.record, OpenRecord)]
        if any(exact_errors(r) or (r.axes == 1 and shows_shape(r)) for r in opened):
            (predicted,) = self.simulate([near])
            if np.isfinite(predicted).all():
                # A nuisance is what changes in the residual when an error is put right: an error is its negative.
                amounts = self.nuisances.amounts(self.data - predicted)
                moved = self.with_errors(near, {name: -a for name, a in amounts.items()})
                if np.isfinite(moved.simulate([near])).all():  # else the rotor falls under the drive that is put right
                    return moved
        return self.again(near)

    def with_errors(
        self,
        near: Point,
        errors: Mapping[str, float],
        louder: float = 1.0,
        records: Sequence[Record | OpenRecord] | None = None,
    ) -> "Problem":
        """As `again`, about these amounts of the errors of measured drives."""
        records, used = records or [p.record for p in self.parts], [p.used for p in self.parts]
        return assemble(records, used, near, self.static is not None, louder, self.bench, errors, self.for_estimate)

    def split(self, every: int) -> tuple["Problem", "Problem"]:
        """Two problems: one without every n-th excited line, and one of those lines alone. Of records without a period
        that are compared in all directions, every n-th window is withheld."""
        withheld = [_every(part, every) for part in self.parts]
        kept = [part.used & ~out for part, out in zip(self.parts, withheld, strict=True)]
        records = [p.record for p in self.parts]
        return assemble(records, kept, bench=self.bench), assemble(records, withheld, rest=False, bench=self.bench)


def _every(part: Part, n: int) -> np.ndarray:
    """Every n-th of a record's excited lines (lines,), or all those of every n-th window.

    What of a window goes with the excitation, and what is noise, is told by all coordinates of the window. Where there
    are fewer windows than n, or where they are compared along instruments alone, single ones are taken.
    """
    driven = np.flatnonzero(part.record.excited & part.used)
    unit = driven
    if isinstance(part.record, OpenRecord) and part.record.instrument is None:
        windows = driven // KEPT
        unit = windows if np.unique(windows).size >= n else driven
    out = np.zeros_like(part.used)
    out[driven[np.isin(unit, np.unique(unit)[n - 1 :: n])]] = True
    return out


def _least(measured: np.ndarray) -> np.ndarray:
    """Least standard deviation (outputs, axes, 1) of the noise of coordinates (outputs, axes, n).

    A simulation may repeat a record to the last digit, as that of a logged command by the stated controller does.
    """
    largest = np.abs(measured).max(axis=-1, keepdims=True, initial=0.0)
    return np.where(largest > 0, NOISELESS * largest, 1.0)


def assemble(
    records: Sequence[Record | OpenRecord],
    lines: Sequence[np.ndarray] | None = None,
    near: Point | None = None,
    rest: bool = True,
    louder: float = 1.0,
    bench: BenchNoise = NO_BOUND,
    errors: Mapping[str, float] | None = None,
    for_estimate: bool = False,
) -> Problem:
    """Stack records into one problem.

    Args:
        records: The records.
        lines: Lines used of each record (n,); by default those that `informative` selects.
        near: The best known parameters; the noise of records without a period is what a simulation there leaves.
        rest: Whether the means of a mass at rest are used.
        louder: Factor on the noise of records without a period.
        bench: Noise that these may have at most; what is beyond is no noise.
        errors: Name -> amount of errors of measured drives about which they are linearised; 0 by default.
        for_estimate: As of `Problem`.
    """
    errors = errors or {}
    parts, nuisances, at = [], [], 0
    names = ("plant", "amplifier")
    columns: dict[str, list[np.ndarray]] = {
        k: [] for k in ("whitened", "record", "output", "axis", "frequency", "kind")
    }
    for i, record in enumerate(records):
        used = informative(record) if lines is None else lines[i]
        evidence = evidence_of(record, near or NOMINAL, errors, for_estimate)
        # A diagnosis takes out the law's shape about what it found, which need not have the form of the stiffness.
        covered = for_estimate and isinstance(record, OpenRecord) and shows_shape(record)
        forms = form_nuisances(record.experiment, near or NOMINAL, evidence.predictor, not covered, for_estimate)
        unsure = {**evidence.nuisances, **forms}
        opened, measured, noise = evidence.opened, evidence.measured, evidence.noise
        if isinstance(record, OpenRecord):
            noise = np.minimum(noise * louder, bench.most(record, opened.outputs))
        noise = np.maximum(noise, _least(measured))
        shape = (*measured.shape[:2], int(used.sum()))
        size = int(np.prod(shape))
        parts.append(Part(record, opened, evidence.predictor, measured, noise, used, slice(at, at + size)))
        at += size
        whitening = np.sqrt(2) / noise
        nuisances.append({n: (c * whitening)[..., used].reshape(-1) for n, c in unsure.items()})
        outputs = np.array([names.index(n) for n in opened.outputs])
        rows = {
            "whitened": (measured * whitening)[..., used],
            "record": np.full(shape, i),
            "output": np.broadcast_to(outputs[:, None, None], shape),
            "axis": np.broadcast_to(np.arange(record.axes)[:, None], shape),
            "frequency": np.broadcast_to(record.frequency[used], shape),
            "kind": np.broadcast_to(line_kinds(record)[:, used], shape),
        }
        for key, value in rows.items():
            columns[key].append(value.reshape(-1))
    static = static_of(records[0].nominal, [r.rests for r in records]) if rest else None
    sizes = [part.place.stop - part.place.start for part in parts]
    found = stacked(nuisances, sizes)
    if static is not None:
        rows = len(static.values)
        last = {
            "record": 0,
            "output": 0,
            "axis": 0,
            "kind": KINDS.index("rest"),
            "frequency": parts[0].record.frequency[0],
        }
        columns["whitened"].append(static.whitened(static.values).astype(complex))
        for key, value in last.items():
            columns[key].append(np.full(rows, value))
        found = Nuisances(found.names, np.pad(found.columns, ((0, 0), (0, rows))))
    columns_of = {key: np.concatenate(value) for key, value in columns.items()}
    return Problem(
        tuple(parts),
        outputs=names,
        nuisances=found,
        static=static,
        bench=bench,
        errors=errors,
        for_estimate=for_estimate,
        louder=louder,
        **columns_of,
    )
