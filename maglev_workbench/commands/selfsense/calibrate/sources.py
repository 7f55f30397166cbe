"""Sources of a calibration: a simulated sensor, recordings of a campaign, or a table of displacement and output."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimation.lines.periods import period_spectra, split_periods, transient_periods
from maglev_env.loop.axes import AXES, suffixes
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.excitation import axis_excitations, lines_at
from maglev_env.rig.rig import Rig
from maglev_workbench.commands.selfsense.calibrate.static_steps import static_steps
from selfsense.calibration.dynamic import DynamicCalibration, dynamic_calibration, simulated_dynamic
from selfsense.calibration.static import StaticCalibration, check_follows, static_calibration, static_sweep
from selfsense.linear import tracking
from selfsense.sensor import SelfSensor, largest_gap

LOWEST, HIGHEST = (1, 2, 3, 5), 22  # of the sweep, in tenths of the gap at rest
FUNDAMENTAL, TOP, PEAK, PERIODS = 1.0, 4000.0, 0.2, 8  # Hz, Hz, of the gap at rest, of the simulated SPHS
_SIGNIFICANT = 3.0  # standard deviations by which the displacement of a line must stand out
_FEWEST = 3  # lines, or steps
_BY_CHANCE = 6  # with this many steps or more, three of them may lie on a line by chance
_ROWS = 500  # largest number of rows of a table; with more, the search for the linear range takes minutes


@dataclass(frozen=True)
class Axis:
    """A displayed quantity: its name, its unit ("" if the data do not give it), and the factor from SI to this unit."""

    name: str
    unit: str = ""
    factor: float = 1.0


@dataclass(frozen=True)
class Static:
    """A static calibration and its points, (n,) each, in the units of `found`."""

    name: str
    displacement: np.ndarray
    output: np.ndarray
    axes: tuple[Axis, Axis]
    found: StaticCalibration


@dataclass(frozen=True)
class Dynamic:
    """A dynamic calibration over a number of periods.

    At each line it has the power of the displacement, in any unit, and the response of the linear model, if there is
    one.
    """

    name: str
    periods: int
    found: DynamicCalibration
    power: np.ndarray
    model: np.ndarray | None = None


@dataclass(frozen=True)
class Calibration:
    """All calibrations from a source; notes: sentences on data that were left out and on assumptions."""

    source: str
    static: tuple[Static, ...]
    dynamic: tuple[Dynamic, ...]
    notes: tuple[str, ...] = ()
    rig: Rig | None = None
    sensor: SelfSensor | None = None


def simulated(rig: Rig, sensor: SelfSensor, progress: Callable[[], None]) -> Calibration:
    """Calibrations of a simulated sensor: gap steps beyond its range, and a Schroeder multisine of 1 to 4000 Hz.

    Args:
        rig: for names and notes.
        sensor: the sensor to simulate.
        progress: called after each of the two.

    Raises:
        ValueError: The estimate is not valid.
    """
    gaps, estimates = _sweep(sensor)
    axes = (Axis("gap", "mm", 1e3), Axis("estimated gap", "µm", 1e6))
    static = Static("simulated steps", gaps, estimates, axes, static_calibration(gaps, estimates, rest=sensor.gap))
    progress()
    rate = sensor.acquisition.rate
    fundamental = rate / round(rate / FUNDAMENTAL)
    found = simulated_dynamic(sensor, fundamental, TOP, PEAK * sensor.gap, PERIODS)
    flat = np.ones(found.frequency.size)
    dynamic = Dynamic("simulated multisine", PERIODS, found, flat, tracking(sensor, found.frequency))
    progress()
    return Calibration("simulation", (static,), (dynamic,), (), rig, sensor)


def _sweep(sensor: SelfSensor) -> tuple[np.ndarray, np.ndarray]:
    """Gaps (m) and the mean estimate of each, from the smallest gap whose ripple is larger than the noise."""
    for lowest in LOWEST[:-1]:
        with suppress(ValueError):
            return _swept(sensor, lowest)
    return _swept(sensor, LOWEST[-1])


def _swept(sensor: SelfSensor, lowest: int) -> tuple[np.ndarray, np.ndarray]:
    gaps = sensor.gap * np.arange(lowest, HIGHEST + 1) / 10
    gaps = gaps[gaps < largest_gap(sensor)]
    return gaps, static_sweep(sensor, gaps)


def from_csv(path: Path) -> Calibration:
    """The static calibration of a table with the columns displacement and output, or of its first two columns.

    Raises:
        ValueError: The table is not valid, or as `widest`.
    """
    columns = read_columns(path)
    names = ("displacement", "output") if {"displacement", "output"} <= set(columns.names) else columns.names[:2]
    if len(names) < 2:
        raise ValueError(f"{path}: one column; a static calibration needs displacement and output")
    x, y = map(columns.column, names)
    for name, values in zip(names, (x, y), strict=True):
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            raise ValueError(f"{path}: column {name!r}: row {row} below the header is {values[row]}; mend or delete it")
    if not _FEWEST <= np.unique(x).size <= x.size <= _ROWS:
        raise ValueError(
            f"{path}: {x.size} rows with {np.unique(x).size} different values of {names[0]!r}; give one row per step, "
            f"{_FEWEST} to {_ROWS}"
        )
    try:
        static = Static(path.name, x, y, (Axis(names[0]), Axis(names[1])), widest(x, y))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Calibration(str(path), (static,), ())


def widest(x: np.ndarray, y: np.ndarray) -> StaticCalibration:
    """The static calibration whose linear range covers the largest part of the output, at any position.

    Raises:
        ValueError: The output stands still, no three points lie on a line, or only three of six or more.
    """
    check_follows(y)
    found = []
    for rest in np.unique(np.quantile(x, np.linspace(0, 1, 9), method="nearest")):
        with suppress(ValueError):  # no line around this one
            found.append(static_calibration(x, y, rest=rest))
    if not found:
        raise ValueError("no three steps lie on a line within 1 % of full scale; check the readings")
    best = max(found, key=lambda c: abs(c.gain) * (c.linear_range[1] - c.linear_range[0]))
    low, high = best.linear_range
    steps = np.unique(x)
    if steps.size >= _BY_CHANCE and np.sum((steps >= low) & (steps <= high)) <= _FEWEST:
        raise ValueError(
            f"no more than {_FEWEST} of {steps.size} steps lie on a line within 1 % of full scale, as they do by "
            "chance; check the readings"
        )
    return best


def from_campaign(
    campaign: Campaign, source: Path, track: Callable[[Iterable[RecordingSpec]], Iterable[RecordingSpec]]
) -> Calibration:
    """Calibrations from all recordings with displacement and gap_estimate.

    A recording with a periodic excitation gives the response at its lines; one without gives the static calibration of
    the steps of its displacement.

    Raises:
        ValueError: No recording has both channels, or none can be used.
    """
    static, dynamic, notes = [], [], []
    having = [(spec, pairs) for spec in campaign.recordings if (pairs := _pairs(spec))]
    if not having:
        raise ValueError(
            f"{campaign.folder}: no recording has the channels displacement and gap_estimate; name both under "
            "[recording.channels], or record with `maglev simulate --sensor self_sensing`"
        )
    notes += [f"{s.name}: no displacement with gap_estimate: left out" for s in campaign.recordings if not _pairs(s)]
    for spec, pairs in track(having):
        dataset = read_recording(campaign, spec)
        for suffix in pairs:
            name = f"{spec.name}, {suffix[1:]}" if suffix else spec.name
            displacement, estimate = (dataset[f"{n}{suffix}"].values for n in ("displacement", "gap_estimate"))
            try:
                if _lines(spec, suffix).size:
                    dynamic.append(_recorded_dynamic(name, spec, suffix, displacement, estimate, notes))
                else:
                    static.append(_recorded_static(name, spec, displacement, estimate))
            except ValueError as error:
                notes.append(f"{name}: {error}")
    if not static and not dynamic:
        raise ValueError(f"{campaign.folder}: nothing to calibrate with: " + "; ".join(notes))
    return Calibration(str(source), tuple(static), tuple(dynamic), tuple(notes), campaign.rig)


def _pairs(spec: RecordingSpec) -> list[str]:
    """Suffixes of the channels for which a recording has both displacement and gap_estimate."""
    endings = ("", *suffixes(2))
    return [e for e in endings if all(f"{n}{e}" in spec.channels for n in ("displacement", "gap_estimate"))]


def _lines(spec: RecordingSpec, suffix: str) -> np.ndarray:
    """Harmonics that excite the axis of the channels with a suffix."""
    if not suffix or not any(e.direction for e in spec.excitations):  # of one axis it is not said which way: along it
        return lines_at(spec.excitations)
    return lines_at(axis_excitations(spec.excitations, AXES.index(suffix[1:])))


def _recorded_dynamic(
    name: str, spec: RecordingSpec, suffix: str, displacement: np.ndarray, estimate: np.ndarray, notes: list[str]
) -> Dynamic:
    lines, per_period = _lines(spec, suffix), spec.samples_per_period
    whole = displacement.size // per_period
    kept = slice(whole * per_period)
    spectra = np.stack([period_spectra(p, lines)[0] for p in split_periods(displacement[None, kept], per_period)])
    dropped = transient_periods(spectra)
    steady = spectra[dropped:]
    noise = np.sqrt(steady.var(axis=0, ddof=1) / len(steady))
    clear = np.abs(steady.mean(axis=0)) > _SIGNIFICANT * noise
    if clear.sum() < _FEWEST:
        raise ValueError(
            f"the displacement stands out of its noise at {clear.sum()} of {lines.size} excited lines; excite it more, "
            "or record longer"
        )
    if not clear.all():
        notes.append(f"{name}: {(~clear).sum()} of {lines.size} lines are left out: their displacement is mostly noise")
    fundamental = spec.sample_rate / per_period
    found = dynamic_calibration(
        displacement[kept], estimate[kept], spec.sample_rate, fundamental, lines[clear], len(steady)
    )
    return Dynamic(name, len(steady), found, np.abs(steady.mean(axis=0)[clear]) ** 2)


def _recorded_static(name: str, spec: RecordingSpec, displacement: np.ndarray, estimate: np.ndarray) -> Static:
    levels, outputs = static_steps(displacement, estimate, spec.sample_rate)
    if levels.size < _FEWEST:
        raise ValueError(
            f"no periodic excitation, and the displacement rests at {levels.size} levels: {_FEWEST} are needed for a "
            "static calibration"
        )
    axes = (Axis("displacement", "mm", 1e3), Axis("gap_estimate", "µm", 1e6))
    return Static(name, levels, outputs, axes, widest(levels, outputs))
