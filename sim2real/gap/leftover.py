"""What a fit leaves of a campaign: how much, in which channel, block, band, recording and time, and its shape."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import Part, Problem
from sim2real.gap.fit_figures import Figures, figures, motion
from sim2real.gap.locate import Where, locate
from sim2real.gap.missing_force import Profile, open_residual, profiles
from sim2real.gap.shrink import closed
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.candidates import Attribution, Candidate
from sim2real.words import Fitted

CHANNELS = {"plant": "displacement", "amplifier": "current"}  # that shows each output
SEGMENTS = 8  # of a record, at most: in which of them the leftover lies
BINS_PER_OCTAVE = 6


@dataclass(frozen=True)
class Share:
    """One recording's part of a leftover.

    Attributes:
        name: Of the recording.
        motion: Its rms displacement in the compared lines, m.
        chi_square: Of its residual per degree of freedom.
        share: Of the whole leftover.
        segments: (start, end, share) of its times, s.
    """

    name: str
    motion: float
    chi_square: float
    share: float
    segments: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Leftover:
    """What the best partial explanation leaves.

    Attributes:
        effects: Its effects; none where calibration alone is as good.
        parameters: Fitted values and standard errors by name.
        share: Share of the gap that it leaves, on the recordings that judge; None where no gap of the nominal rig or
            of calibration can be stated.
        figures: Of the same recordings.
        where: In which block, band and kind of line it lies, of the fitted recordings; as all of the following.
        channels: Share of each channel.
        recordings: Share of each recording, the largest motion first.
        frequency: Middle of bins (n,), Hz.
        before: Rms (n,) of the residual of calibration alone in these bins, in units of the noise; nan where the rotor
            touches down.
        after: The same of the partial explanation (n,).
        profiles: The force that the simulation lacks, over displacement, current and velocity.
    """

    effects: tuple[str, ...]
    parameters: Mapping[str, Fitted]
    share: float | None
    figures: Figures | None
    where: Where
    channels: Mapping[str, float]
    recordings: tuple[Share, ...]
    frequency: np.ndarray
    before: np.ndarray
    after: np.ndarray
    profiles: tuple[Profile, ...]

    def to_json(self) -> dict[str, Any]:
        """SI; nan becomes None where JSON is written."""
        return {
            "effects": list(self.effects),
            "parameters": {name: dict(values) for name, values in self.parameters.items()},
            "share_left": self.share,
            "figures": None if self.figures is None else asdict(self.figures),
            **self.where.to_json(),
            "channels": dict(self.channels),
            "recordings": [
                {
                    "file": r.name,
                    "motion_rms": r.motion,
                    "chi_square": r.chi_square,
                    "share": r.share,
                    "segments": [{"from": a, "to": b, "share": share} for a, b, share in r.segments],
                }
                for r in self.recordings
            ],
            "residual": {"frequency": self.frequency, "calibrated": self.before, "partial": self.after},
            "missing_force": [asdict(p) for p in self.profiles],
        }


def leftover(
    attribution: Attribution,
    judged: Problem,
    candidate: Candidate,
    parameters: Mapping[str, Fitted],
    seed: int,
) -> Leftover:
    """What a candidate leaves.

    Args:
        attribution: The fitted candidates.
        judged: The recordings that judge.
        candidate: The best partial explanation.
        parameters: Its fitted values, for the report.
        seed: Of the bootstrap.
    """
    fitted, point = attribution.problem, candidate.fit.hypothesis.point(candidate.fit.u)
    calibration = attribution.calibration.fit
    base = calibration.hypothesis.point(calibration.u) if np.isfinite(calibration.cost) else NOMINAL
    nominal, calibrated, after = judged.data - judged.simulate([NOMINAL, base, point])
    fraction, _ = closed(nominal if np.isfinite(nominal).all() else calibrated, after, seed)
    residual = candidate.fit.residual
    excess = abs(residual) ** 2 - 2.0
    channels = _positive([float(excess[fitted.output == i].sum()) for i in range(len(fitted.outputs))])
    shares = _positive([float(excess[part.place].sum()) for part in fitted.parts])
    recordings = [
        Share(part.record.name, motion(part), float(np.mean(abs(residual[part.place]) ** 2) / 2), share,
              _segments(part, point))
        for part, share in zip(fitted.parts, shares, strict=True)
    ]  # fmt: skip
    frequency, before, left = _by_frequency(fitted.frequency, calibration.residual, residual)
    return Leftover(
        candidate.effects,
        parameters,
        None if fraction is None else 1 - fraction,
        figures(judged, after),
        locate(fitted, residual),
        dict(zip((CHANNELS[name] for name in fitted.outputs), channels, strict=True)),
        tuple(sorted(recordings, key=lambda r: -r.motion)),
        frequency,
        before,
        left,
        profiles(fitted.parts, point),
    )


def _positive(parts: Sequence[float]) -> list[float]:
    """Each part as a share of the sum of all positive parts; negative ones count as zero."""
    total = sum(max(part, 0.0) for part in parts)
    return [max(part, 0.0) / total if total else 0.0 for part in parts]


def _by_frequency(frequency: np.ndarray, *residuals: np.ndarray) -> tuple[np.ndarray, ...]:
    """Middles of bins (n,), Hz, and the rms (n,) of residuals (K,) in them, in units of the noise."""
    bins, label = np.unique(
        np.floor(BINS_PER_OCTAVE * np.log2(np.maximum(frequency, 1e-9))).astype(int), return_inverse=True
    )
    count = np.bincount(label)
    rms = (np.sqrt(np.bincount(label, abs(r) ** 2) / (2 * count)) for r in residuals)
    return 2.0 ** ((bins + 0.5) / BINS_PER_OCTAVE), *rms


def _segments(part: Part, point: Point) -> tuple[tuple[float, float, float], ...]:
    """(start, end, share) of up to SEGMENTS times of a record, s; empty where they cannot be told."""
    cut = _open_power(part, point) if isinstance(part.record, OpenRecord) else _power_of_periods(part, point)
    if cut is None or len(cut[1]) < 2:
        return ()
    edges, power = cut
    return tuple((float(a), float(b), s) for a, b, s in zip(edges[:-1], edges[1:], _positive(power), strict=True))


def _power_of_periods(part: Part, point: Point) -> tuple[np.ndarray, Sequence[float]] | None:
    """Edges (s) and the excess power of the residual, of groups of periods."""
    record, predicted = part.record, part.predictor.smoothed([point])[0]
    if not np.isfinite(predicted).all():
        return None
    own = part.opened.residuals(record.periods["displacement"], record.periods.get("current"))
    scale = np.sqrt(2 / record.count) / part.noise  # of a single period, whose noise is that much louder
    r = ((own - predicted) * scale)[..., part.used]
    power = np.sum(abs(r) ** 2 - 2.0, axis=(1, 2, 3))
    groups = np.array_split(np.arange(record.count), min(SEGMENTS, record.count))
    period = 1 / record.experiment.fundamental
    edges = record.start + period * np.array([groups[0][0], *(g[-1] + 1 for g in groups)])
    return edges, [float(power[g].sum()) for g in groups]


def _open_power(part: Part, point: Point) -> tuple[np.ndarray, Sequence[float]] | None:
    """Edges (s, from the first sample that is simulated) and the excess power of the whitened residual."""
    record, windows, simulated = part.record, part.record.windows, open_residual(part, point)
    if simulated is None:
        return None
    kept = part.noise.shape[-1] // windows.count
    sd = part.noise[part.opened.outputs.index("plant")].reshape(record.axes, windows.count, kept)[..., :1]
    white = (simulated[0] / sd).reshape(record.axes, -1)
    spectrum = np.zeros((record.axes, windows.samples // 2 + 1), complex)
    spectrum[:, windows.first : windows.first + white.shape[1]] = white
    # Parseval: the sum over samples is twice that of |white|^2, whose mean under noise alone is 1 on every kept line.
    power = windows.samples * np.sum(np.fft.irfft(spectrum, windows.samples, axis=-1) ** 2, axis=0)
    expected = 2 * record.axes * windows.count * kept / windows.samples
    parts = np.array_split(power, SEGMENTS)
    edges = (record.first + np.cumsum([0, *(p.size for p in parts)])) / windows.sample_rate
    return edges, [float(p.sum() - expected * p.size) for p in parts]
