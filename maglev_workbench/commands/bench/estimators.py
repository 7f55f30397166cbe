"""Time of every estimator on one core, in ms per gain set if lanes share the work, else per recording."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.signal

from estimation.bands import band_slices, sliding_bands
from estimation.effective import pid_effective_coefficients
from estimation.least_squares import least_squares
from estimation.lines.frequency_response import distortion, frequency_response, pooled_variance
from estimation.lines.local_polynomial import local_polynomial
from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import maximum_likelihood
from estimation.modal import modal_estimate
from estimation.multisine.low_crest import low_crest
from estimation.stability_margins import margin_arrays, margins
from estimation.xy.planar import axis_statistics, eight_coefficients, row_sums
from estimation.xy.planar_least_squares import planar_least_squares
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.timing import Size, alternately

Works = dict[str, tuple[Callable[[], object], int]]  # by figure: what is timed, and how many units it does

PER_SET, PER_RECORD = "ms per gain set", "ms per recording"
_RATE = 20e3  # Hz, of the recording that is not periodic


def estimator_figures(size: Size) -> dict[str, Figure]:
    """Milliseconds of every estimator; `all_bands` means the 15 Hz bands every 3 Hz of the rig's protocol."""
    rig = load_rig("hmb_radial")
    pair = _two_records(size.xy_lanes)
    one = axis_statistics(pair[0], "x")
    one = replace(one, mean=one.mean[0], covariance=one.covariance[0])
    groups = {
        PER_SET: {**_one_axis(size.lanes), **_two_axes(pair, rig.mass)},
        PER_RECORD: {**_recordings(size), "modal_estimate_ms": (lambda: modal_estimate(one), 1)},
    }
    works = {name: work for group in groups.values() for name, (work, _) in group.items()}
    seconds = alternately(works, size.repeats)
    found = {
        name: Figure(1e3 * seconds[name] / count, unit)
        for unit, group in groups.items()
        for name, (_, count) in group.items()
    }
    lines = np.arange(1, 251)
    design = alternately({"low_crest": lambda: low_crest(lines, int(_RATE))}, size.repeats)["low_crest"]
    return found | {"low_crest_250_lines_ms": Figure(1e3 * design, "ms per design")}


def _one_axis(lanes: int) -> Works:
    """The estimators that take many gain sets at once, on the lines of the rig's protocol."""
    first = protocol_experiment(load_rig("hmb_free"))
    statistics = simulate_statistics([replace(first, seed=i) for i in range(lanes)], threads=1).statistics
    force, protocol, mass = force_statistics(statistics, first), first.rig.protocol, first.rig.mass
    bands = sliding_bands(force.frequency, protocol.band_width, protocol.band_overlap)
    slices = band_slices(force.frequency, bands)
    receptance, _ = frequency_response(force, "displacement", "force")
    loop = statistics.at_lines(lines_at(first.excitations, "current"))
    sensitivity, _ = frequency_response(loop, "command", "injection")
    gains, law = first.gains, linearise(force_law(first.rig))

    def every_band() -> None:
        for start, stop in slices:
            least_squares(force.frequency[start:stop], receptance[:, start:stop], mass)

    def effective() -> None:
        for _ in range(lanes):
            pid_effective_coefficients(force.frequency, gains.kp, gains.ki, gains.kd, gains.td, *law)

    works = {
        "least_squares_all_bands_ms": every_band,
        "ml_points_all_bands_ms": lambda: maximum_likelihood(force, bands, mass, intervals=False),
        "ml_intervals_all_bands_ms": lambda: maximum_likelihood(force, bands, mass),
        "effective_coefficients_ms": effective,
        "margin_arrays_ms": lambda: margin_arrays(loop.frequency, sensitivity),
        "frequency_response_ms": lambda: frequency_response(force, "displacement", "force"),
    }
    return {name: (work, lanes) for name, work in works.items()}


def _two_records(lanes: int) -> tuple[LineStatistics, LineStatistics]:
    """Force lines of the x-y rig's protocol, and of one with the force turned by 90 degrees."""
    first = protocol_experiment(load_rig("hmb_radial"))
    records = []
    for turn in (0.0, 90.0):
        turned = tuple(replace(x, direction=x.direction + turn) for x in first.excitations)
        experiments = [replace(first, excitations=turned, seed=i) for i in range(lanes)]
        statistics = simulate_statistics(experiments, threads=1).statistics
        records.append(statistics.at_lines(lines_at(turned, "force")))
    return tuple(records)


def _two_axes(pair: tuple[LineStatistics, LineStatistics], mass: float) -> Works:
    """The x-y estimators on both records of every gain set (row_sums: on one)."""
    protocol = load_rig("hmb_radial").protocol
    bands = sliding_bands(pair[0].frequency, protocol.band_width, protocol.band_overlap)
    works = {
        "planar_least_squares_all_bands_ms": lambda: planar_least_squares(pair, bands, mass),
        "eight_coefficients_points_all_bands_ms": lambda: eight_coefficients(pair, bands, mass, intervals=False),
        "eight_coefficients_all_bands_ms": lambda: eight_coefficients(pair, bands, mass),
        "row_sums_all_bands_ms": lambda: row_sums(pair[0], bands, mass),
    }
    return {name: (work, len(pair[0].mean)) for name, work in works.items()}


def _recordings(size: Size) -> Works:
    """Estimators that run once per recording: margins with intervals, distortion, responses without periods."""
    first = protocol_experiment(load_rig("hmb_free"))
    statistics = simulate_statistics([first], threads=1).statistics
    record = replace(statistics, mean=statistics.mean[0], covariance=statistics.covariance[0])
    loop = record.at_lines(lines_at(first.excitations, "current"))
    sensitivity, variance = frequency_response(loop, "command", "injection")
    variance = pooled_variance(variance)
    noise = noise_record(size.record_seconds)
    channels = ("force", "displacement")
    works = {
        "margins_with_intervals_ms": lambda: margins(loop.frequency, sensitivity, variance),
        "distortion_ms": lambda: distortion(record, "displacement", record.lines[::2]),
        "local_polynomial_60_s_ms": lambda: local_polynomial(noise, channels, _RATE, "force"),
    }
    return {name: (work, 1) for name, work in works.items()}


def noise_record(seconds: float) -> np.ndarray:
    """Force and displacement, (2, samples) at 20 kHz: noise up to 500 Hz on the pedestal's resonance at 61 Hz."""
    rng, n = np.random.default_rng(0), round(seconds * _RATE)
    force = scipy.signal.lfilter(*scipy.signal.butter(4, 500, fs=_RATE), rng.standard_normal(n))
    plant = scipy.signal.cont2discrete(([1.0], [0.92, 20.0, 134.5e3]), 1 / _RATE)
    displacement = scipy.signal.lfilter(plant[0][0], plant[1], force)
    return np.stack([force, displacement + 1e-8 * rng.standard_normal(n)])
