"""The campaign as one least-squares problem: whitened residuals of every recording, output, axis and line."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from maglev_lanes.threads import single_blas
from sim2real.opened import Opened, noise_of, opened_loop
from sim2real.records import Record
from sim2real.simulated import Point, Predictor, predictor, together

# Detection lines are looked at up to so many times the line below which this share of the driven ones lies.
DENSE, DENSE_REACH = 0.75, 1.2
KINDS = ("force", "current", "reference", "even", "odd")  # what drives a line, or of which detection lines it is


@dataclass(frozen=True)
class Part:
    """One record's share: measured residuals and their noise (outputs, axes, n), lines used (n,), and its slice of the
    stacked vector."""

    record: Record
    opened: Opened
    predictor: Predictor
    measured: np.ndarray
    noise: np.ndarray
    used: np.ndarray
    place: slice


@dataclass(frozen=True)
class Problem:
    """Stacked, whitened: data (K,) complex, of variance 1 per real part; record, output, axis, line and kind (K,) of
    each; `KINDS`, `outputs` and `parts` name them."""

    parts: tuple[Part, ...]
    data: np.ndarray
    record: np.ndarray
    output: np.ndarray
    axis: np.ndarray
    frequency: np.ndarray
    kind: np.ndarray
    outputs: tuple[str, ...]

    def simulate(self, points: Sequence[Point], settled: bool = True) -> np.ndarray:
        """Whitened predictions (n, K) at each point; nan where the rotor touches down in any recording. Not settled:
        modes may still ring, as far as the nominal loop is settled."""
        found = np.empty((len(points), self.data.size), complex)
        period = 1 / self.parts[0].record.experiment.fundamental
        with single_blas():  # matrices of lanes are small: more threads only wait for each other
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
        """What the linear nominal rig leaves (K,), its loop opened: no rotor needs to stand for that."""
        found = np.empty_like(self.data)
        for part in self.parts:
            off = (part.measured - part.opened.driven(part.record)) * np.sqrt(2) / part.noise
            found[part.place] = off[..., part.used].reshape(-1)
        return found

    @property
    def loudest(self) -> Part:
        """The record that moves the rotor most: what is not linear shows there."""
        return max(self.parts, key=lambda part: float((abs(part.measured) ** 2).sum()))

    def only(self, part: Part) -> "Problem":
        """One record alone."""
        at = part.place
        columns = (self.data, self.record, self.output, self.axis, self.frequency, self.kind)
        alone = replace(part, place=slice(0, at.stop - at.start))
        return Problem((alone,), *(c[at] for c in columns), self.outputs)

    def split(self, every: int) -> tuple["Problem", "Problem"]:
        """Without every n-th excited line, and those lines alone."""
        kept, withheld = [], []
        for part in self.parts:
            driven = np.flatnonzero(part.record.excited & part.used)
            out = np.zeros_like(part.used)
            out[driven[every - 1 :: every]] = True
            kept.append(part.used & ~out)
            withheld.append(out)
        records = [p.record for p in self.parts]
        return assemble(records, kept), assemble(records, withheld)


def informative(record: Record) -> np.ndarray:
    """Lines (n,) worth fitting: the driven ones, and among them the detection lines as far as driven ones are dense;
    without those on which tones of known origin would lie."""
    reach = DENSE_REACH * np.quantile(record.lines[record.excited], DENSE)
    return (record.excited | (record.lines <= reach)) & ~record.masked


def line_kinds(record: Record) -> np.ndarray:
    """Index into KINDS of every line (axes, n); what drives it along that axis, or else along the other."""
    kinds = np.where(record.lines % 2 == 0, KINDS.index("even"), KINDS.index("odd"))
    kinds = np.repeat(kinds[None], record.axes, axis=0)
    for place, on in record.driven.items():
        kinds[:, on.any(axis=0)] = KINDS.index(place)
    for place, on in record.driven.items():
        kinds[on] = KINDS.index(place)
    return kinds


def assemble(records: Sequence[Record], lines: Sequence[np.ndarray] | None = None) -> Problem:
    """Stack records; lines: which ones of each record (n,), default all but those of tones of known origin."""
    parts, at = [], 0
    names = ("plant", "amplifier")
    columns: dict[str, list[np.ndarray]] = {k: [] for k in ("data", "record", "output", "axis", "frequency", "kind")}
    for i, record in enumerate(records):
        used = informative(record) if lines is None else lines[i]
        opened = opened_loop(record)
        current = record.mean("current") if "current" in record.periods else None
        measured = opened.residuals(record.mean("displacement"), current)
        noise = noise_of(record, opened)
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
