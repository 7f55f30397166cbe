"""The campaign as one least-squares problem: whitened residuals of every recording, output, axis and line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.kernel.replay import replayed
from maglev_lanes.threads import single_blas
from sim2real.open_evidence import measured_of, nominal_loop, open_noise, opened_of
from sim2real.open_record import OpenRecord
from sim2real.opened import Opened, noise_of, opened_loop
from sim2real.records import Record
from sim2real.simulated import Point, Predictor, predictor, together

# Detection lines are used up to DENSE_REACH times the DENSE quantile of the driven lines.
DENSE, DENSE_REACH = 0.75, 1.2
KINDS = ("force", "current", "reference", "even", "odd")  # what drives a line, or the kind of a detection line


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


@dataclass(frozen=True)
class Problem:
    """All records, stacked and whitened.

    Attributes:
        parts: The records.
        data: Whitened complex data (K,), of variance 1 per real part.
        record: Index (K,) into parts.
        output: Index (K,) into outputs.
        axis: Axis (K,).
        frequency: Frequency (K,), Hz.
        kind: Index (K,) into `KINDS`.
        outputs: Names of the outputs.
    """

    parts: tuple[Part, ...]
    data: np.ndarray
    record: np.ndarray
    output: np.ndarray
    axis: np.ndarray
    frequency: np.ndarray
    kind: np.ndarray
    outputs: tuple[str, ...]

    def simulate(self, points: Sequence[Point], settled: bool = True) -> np.ndarray:
        """Whitened predictions at each point.

        Args:
            points: The points.
            settled: False lets the points' modes ring; only the nominal loop's transient is then waited for.

        Returns:
            Predictions (n, K); nan where the rotor touches down in any recording.
        """
        found = np.empty((len(points), self.data.size), complex)
        periodic = [p.record.experiment.fundamental for p in self.parts if not isinstance(p.record, OpenRecord)]
        period = 1 / periodic[0] if periodic else 1.0  # without a period nothing needs to settle
        with single_blas():  # the matrices of lanes are small, so several threads would only wait for each other
            dithering = self.parts[0].record.nominal.noise.displacement > 0
            groups = together(points, period, dithering) if settled else [((0.0, False), list(range(len(points))))]
            for (lasts, dithered), which in groups:
                prepared: dict[tuple, list] = {}
                for part in self.parts:
                    kind = part.predictor.kind
                    if kind not in prepared:
                        prepared[kind] = part.predictor.lanes([points[i] for i in which], dithered)
                    predicted = part.predictor.of(prepared[kind], lasts, dithered)[..., part.used]
                    whitened = predicted * (np.sqrt(2) / part.noise[..., part.used])
                    found[which, part.place] = whitened.reshape(len(which), -1)
        return found

    def opened_residual(self) -> np.ndarray:
        """Residual (K,) of the linear nominal rig with its loop opened, which exists even if no rotor levitates."""
        found = np.empty_like(self.data)
        for part in self.parts:
            off = (part.measured - part.opened.driven(part.record)) * np.sqrt(2) / part.noise
            found[part.place] = off[..., part.used].reshape(-1)
        return found

    @property
    def loudest(self) -> Part:
        """The record with the largest motion, in which nonlinearity shows most."""
        return max(self.parts, key=lambda part: float((abs(part.measured) ** 2).sum()))

    def only(self, part: Part) -> "Problem":
        """The problem of one record alone."""
        at = part.place
        columns = (self.data, self.record, self.output, self.axis, self.frequency, self.kind)
        alone = replace(part, place=slice(0, at.stop - at.start))
        return Problem((alone,), *(c[at] for c in columns), self.outputs)

    def again(self, near: Point) -> "Problem":
        """The same lines, with the noise that a point leaves of records without a period."""
        return assemble([p.record for p in self.parts], [p.used for p in self.parts], near)

    def split(self, every: int) -> tuple["Problem", "Problem"]:
        """Two problems: one without every n-th excited line, and one of those lines alone."""
        kept, withheld = [], []
        for part in self.parts:
            driven = np.flatnonzero(part.record.excited & part.used)
            out = np.zeros_like(part.used)
            out[driven[every - 1 :: every]] = True
            kept.append(part.used & ~out)
            withheld.append(out)
        records = [p.record for p in self.parts]
        return assemble(records, kept), assemble(records, withheld)


def _evidence(record: Record | OpenRecord, near: Point | None) -> tuple[Opened, np.ndarray, np.ndarray]:
    """The opened nominal loop of a record, what was measured in its coordinates, and their noise."""
    if isinstance(record, OpenRecord):
        loop = nominal_loop(record)
        opened = opened_of(loop)
        lanes = predictor(record, opened).lanes([near or Point({}, {})])
        predicted = replayed(lanes, record.experiment, record.waves)[0]
        return opened, measured_of(record, loop, opened.outputs), open_noise(record, loop, opened.outputs, predicted)
    opened = opened_loop(record)
    current = record.mean("current") if "current" in record.periods else None
    return opened, opened.residuals(record.mean("displacement"), current), noise_of(record, opened)


def informative(record: Record | OpenRecord) -> np.ndarray:
    """Lines (n,) worth fitting: the driven ones, and detection lines as far as the driven ones are dense.

    Lines on which tones of known origin would lie are left out.
    """
    if isinstance(record, OpenRecord):
        return record.excited
    reach = DENSE_REACH * np.quantile(record.lines[record.excited], DENSE)
    return (record.excited | (record.lines <= reach)) & ~record.masked


def line_kinds(record: Record | OpenRecord) -> np.ndarray:
    """Index into KINDS of every line (axes, n): what drives it along that axis, or else along the other."""
    kinds = np.where(record.lines % 2 == 0, KINDS.index("even"), KINDS.index("odd"))
    kinds = np.repeat(kinds[None], record.axes, axis=0)
    for place, on in record.driven.items():
        kinds[:, on.any(axis=0)] = KINDS.index(place)
    for place, on in record.driven.items():
        kinds[on] = KINDS.index(place)
    return kinds


def assemble(
    records: Sequence[Record | OpenRecord], lines: Sequence[np.ndarray] | None = None, near: Point | None = None
) -> Problem:
    """Stack records into one problem.

    Args:
        records: The records.
        lines: Lines used of each record (n,); by default those that `informative` selects.
        near: The best known parameters; the noise of records without a period is what a simulation there leaves.
    """
    parts, at = [], 0
    names = ("plant", "amplifier")
    columns: dict[str, list[np.ndarray]] = {k: [] for k in ("data", "record", "output", "axis", "frequency", "kind")}
    for i, record in enumerate(records):
        used = informative(record) if lines is None else lines[i]
        opened, measured, noise = _evidence(record, near)
        shape = (*measured.shape[:2], int(used.sum()))
        size = int(np.prod(shape))
        parts.append(Part(record, opened, predictor(record, opened), measured, noise, used, slice(at, at + size)))
        at += size
        outputs = np.array([names.index(n) for n in opened.outputs])
        rows = {
            "data": (measured * np.sqrt(2) / noise)[..., used],
            "record": np.full(shape, i),
            "output": np.broadcast_to(outputs[:, None, None], shape),
            "axis": np.broadcast_to(np.arange(record.axes)[:, None], shape),
            "frequency": np.broadcast_to(record.frequency[used], shape),
            "kind": np.broadcast_to(line_kinds(record)[:, used], shape),
        }
        for key, value in rows.items():
            columns[key].append(value.reshape(-1))
    stacked = {key: np.concatenate(value) for key, value in columns.items()}
    return Problem(tuple(parts), outputs=names, **stacked)
