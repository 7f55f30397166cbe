"""The force that a simulation lacks, over displacement, current and velocity: the shape of what no effect explains.

The residual of the reading with the loop opened, divided by the opened receptance, is the external force that would
have to act on the rotor for the simulation to be right. Against the displacement it shows a spring or a force law,
against the current an actuator's law, against the velocity friction and damping.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim2real.compared.point import Point
from sim2real.compared.problem import Part
from sim2real.compared.simulated import series_at
from sim2real.recorded.open_evidence import measured_series
from sim2real.recorded.open_record import OpenRecord

BINS = 24  # of each quantity, with equally many samples
PER_CYCLE = 4  # samples of a cycle of the highest line
MOVING = (
    0.99  # share of the displacement's power below the highest line that is looked at: above it, only noise would be
)
QUANTITIES = {"displacement": "m", "current": "A", "velocity": "m/s"}


@dataclass(frozen=True)
class Profile:
    """Mean missing force over a quantity.

    Attributes:
        quantity: A key of QUANTITIES, without its mean.
        at: Mean of the quantity in each bin (BINS,).
        force: Mean missing force in each bin (BINS,), N.
        se: Its standard error (BINS,), N.
        share: Share of the missing force's power that the profile describes.
        clear: Mean square of the profile in units of its standard error; about 1 where the force has nothing to do with
            the quantity.
    """

    quantity: str
    at: np.ndarray
    force: np.ndarray
    se: np.ndarray
    share: float
    clear: float


def profiles(parts: Sequence[Part], point: Point) -> tuple[Profile, ...]:
    """Profiles over every quantity that the records hold, all records together."""
    found: dict[str, list[np.ndarray]] = {name: [] for name in QUANTITIES}
    forces: dict[str, list[np.ndarray]] = {name: [] for name in QUANTITIES}
    samples = independent = 0
    for part in parts:
        made = missing_force(part, point)
        if made is None:
            continue
        series, lines = made
        samples += series["force"].size
        independent += 2 * lines * len(series["force"])
        for name in QUANTITIES.keys() & series.keys():
            found[name].append(series[name].ravel())
            forces[name].append(series["force"].ravel())
    return tuple(
        _profile(name, np.concatenate(found[name]), np.concatenate(forces[name]), min(independent / samples, 1.0))
        for name in QUANTITIES
        if found[name]
    )


def _profile(name: str, x: np.ndarray, force: np.ndarray, independent: float) -> Profile:
    """The profile of samples (n,), of which a share is independent."""
    order = np.argsort(x, kind="stable")
    bins = np.array_split(order, min(BINS, max(x.size // 2, 1)))
    at, mean = (np.array([v[b].mean() for b in bins]) for v in (x, force))
    count = np.array([b.size for b in bins])
    se = np.array([force[b].std() for b in bins]) / np.sqrt(np.maximum(independent * count, 1))
    power = float(np.sum(force**2))
    clear = float(np.mean((mean / np.maximum(se, 1e-300)) ** 2)) if power else 0.0
    return Profile(name, at, mean, se, float(np.sum(count * mean**2) / power) if power else 0.0, clear)


def missing_force(part: Part, point: Point) -> tuple[Mapping[str, np.ndarray], int] | None:
    """Series (axes, samples) of force (N), displacement (m), velocity (m/s) and, where recorded, current (A).

    All but the force are the simulated ones, whose noise is not that of the force. All are without their means, and
    hold the compared lines of the band in which the rotor moves; of a periodic record it is one period.

    Returns:
        The series by name, and the number of lines; None where the rotor touches down.
    """
    spectra = _open_spectra(part, point) if isinstance(part.record, OpenRecord) else _periodic_spectra(part, point)
    if spectra is None:
        return None
    lines, samples, rate, found = spectra
    found["velocity"] = 2j * np.pi * lines * rate / samples * found["displacement"]
    power = np.cumsum(np.sum(abs(found["displacement"]) ** 2, axis=0))
    top = int(np.searchsorted(power, MOVING * power[-1])) + 1
    short = min(samples, PER_CYCLE * (int(lines[top - 1]) + 1))
    series = {}
    for name, values in found.items():
        spectrum = np.zeros((len(values), short // 2 + 1), complex)
        spectrum[:, lines[:top]] = values[:, :top] * (short / 2)
        series[name] = np.fft.irfft(spectrum, short, axis=-1)
    return series, top


_Spectra = tuple[np.ndarray, int, float, dict[str, np.ndarray]]  # lines, samples, rate in Hz, channel -> (axes, lines)


def _periodic_spectra(part: Part, point: Point) -> _Spectra | None:
    record, opened, used = part.record, part.opened, part.used
    predicted = part.predictor.smoothed([point])[0]
    if not np.isfinite(predicted).all():
        return None
    plant = opened.outputs.index("plant")
    displacement = opened.displacement(predicted)
    found = {"force": (part.measured - predicted)[plant] / opened.receptance, "displacement": displacement}
    if "amplifier" in opened.outputs:
        driven = predicted[opened.outputs.index("amplifier")] - opened.amplifier * opened.controller * displacement
        found["current"] = driven / (1 + opened.amplifier * opened.from_current)
    e = record.experiment
    return record.lines[used], e.recorded_per_period, e.recorded_rate, {n: v[:, used] for n, v in found.items()}


def open_residual(part: Part, point: Point) -> tuple[np.ndarray, np.ndarray] | None:
    """Opened residual (axes, windows, WIDTH) of an open record's reading, without transient and drift.

    Returns:
        The residual, and the simulated series (3, axes, samples) of reading, current and command; None where the rotor
        touches down.
    """
    record, loop = part.record, part.predictor.replay.loop
    series = series_at(record, point)
    if not np.isfinite(series).all():
        return None
    off = measured_series(record) - series
    return record.windows.cleared(loop.opened(record, off[0], off[2], None)[0]), series


def _open_spectra(part: Part, point: Point) -> _Spectra | None:
    record, windows, simulated = part.record, part.record.windows, open_residual(part, point)
    if simulated is None:
        return None
    opened, series = simulated
    flat = (record.axes, -1)
    found = {"force": opened.reshape(flat) / part.predictor.replay.loop.blocks.receptance} | {
        name: record.spectrum(values).reshape(flat)
        for name, values in zip(("displacement", "current"), series[:2], strict=True)
        if name in record.series
    }
    lines = windows.first + np.arange(found["force"].shape[1])
    return lines, windows.samples, windows.sample_rate, found
