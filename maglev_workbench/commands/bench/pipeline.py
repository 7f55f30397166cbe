"""Whole evaluations: gain sets per second, the time of each part, and the scaling with threads."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import process_time, thread_time

import numpy as np

from estimation.bands import band_slices, sliding_bands
from estimation.least_squares import least_squares
from estimation.lines.frequency_response import frequency_response
from estimation.max_likelihood import maximum_likelihood
from estimation.stability_margins import margin_arrays
from maglev_env.channels import SPECTRAL, step_channels
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.evaluation.target import score_target
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.blocks import own_lanes
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.linear.between_lines import between_lines
from maglev_env.linear.poles import all_poles, pole_radii
from maglev_env.loop.gains import with_gains
from maglev_env.rig.excitation import PLACES, lines_at
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES
from maglev_lanes.line_spectra import LineSpectra
from maglev_lanes.noise import line_noise
from maglev_lanes.period_statistics import PeriodStatistics
from maglev_lanes.threads import cores, over_threads
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.kernels import quiet_experiment
from maglev_workbench.commands.bench.timing import Size, alternately, stepper

_PERIODS_PER_CALL = 4  # a call of the bare kernel then outlasts the start of its threads


def rate_figures(size: Size) -> dict[str, Figure]:
    """Gain sets per second on one thread, two, and all cores, of the one-axis and the x-y rig, and their ratios."""
    found = {}
    for rig, prefix in (("hmb_free", ""), ("hmb_radial", "xy_")):
        experiment = protocol_experiment(load_rig(rig))
        evaluate([experiment], threads=1)  # compiles
        sets = {t: _sets(experiment, t, size) for t in _threads()}
        works = {t: partial(evaluate, sets[t], threads=t) for t in sets}
        rate = {t: len(sets[t]) / seconds for t, seconds in alternately(works, size.repeats).items()}
        every = cores()
        found |= {
            f"{prefix}gain_sets_per_second": Figure(rate[every], "1/s", "higher"),
            f"{prefix}gain_sets_per_second_one_thread": Figure(rate[1], "1/s", "higher"),
            f"{prefix}gain_sets_per_second_two_threads": Figure(rate[2], "1/s", "higher"),
            f"{prefix}gain_sets_two_threads_over_one": Figure(rate[2] / rate[1], "ratio", "higher"),
            f"{prefix}gain_sets_all_cores_over_one_thread": Figure(rate[every] / rate[1], "ratio", "higher"),
        }
    return found


def _threads() -> set[int]:
    return {1, 2, cores()}


def _sets(experiment: Experiment, threads: int, size: Size) -> list[Experiment]:
    """Two chunks for every thread."""
    return spread_sets(experiment, 2 * threads * size.lanes)


def spread_sets(experiment: Experiment, n: int) -> list[Experiment]:
    """Stable gain sets all over the rig's bounds, as a sweep has them; some take work that the preset does not.

    Of one set again and again it was not seen that every third of a sweep took four times as long as the others.
    """
    rng, found = np.random.default_rng(0), []
    while len(found) < n:
        drawn = {
            name: float(low * (high / low) ** share if low > 0 else low + (high - low) * share)
            for (name, (low, high)), share in zip(experiment.rig.bounds.items(), rng.random(8), strict=False)
        }
        e = replace(experiment, gains=with_gains(experiment.gains, **drawn), seed=len(found))
        if pole_radii([e])[0] < 1:
            found.append(e)
    return found


def thread_figures(size: Size) -> dict[str, Figure]:
    """Lane steps per second of the bare kernel at one thread, two, and all cores, and their ratios."""
    experiment, repeats = quiet_experiment(), 4 * size.repeats
    works = {}
    for threads in _threads():
        steppers = [stepper([experiment] * LANES, repeats * _PERIODS_PER_CALL) for _ in range(2 * threads)]
        works[threads] = partial(_run, steppers, threads)
    best = alternately(works, repeats)
    steps = _PERIODS_PER_CALL * LANES * experiment.samples_per_period
    rate = {threads: 2 * threads * steps / seconds for threads, seconds in best.items()}
    every = cores()
    return {
        "kernel_steps_per_second": Figure(rate[every], "lane steps/s", "higher"),
        "kernel_steps_per_second_one_thread": Figure(rate[1], "lane steps/s", "higher"),
        "kernel_steps_per_second_two_threads": Figure(rate[2], "lane steps/s", "higher"),
        "kernel_two_threads_over_one": Figure(rate[2] / rate[1], "ratio", "higher"),
        "kernel_all_cores_over_one_thread": Figure(rate[every] / rate[1], "ratio", "higher"),
    }


def _run(steppers: Sequence[Callable[[], None]], threads: int) -> None:
    def several(step: Callable[[], None]) -> None:
        for _ in range(_PERIODS_PER_CALL):
            step()

    for _ in over_threads(several, steppers, threads):
        pass


def part_figures(size: Size) -> dict[str, Figure]:
    """Milliseconds per gain set of each part of an evaluation on one thread, and their share of the whole.

    evaluation_cores_used is the processor time of all threads over that of the calling one. If it is above 1, the
    linear algebra library starts its own threads, which slow down operations on such small matrices.
    """
    first = protocol_experiment(load_rig("hmb_free"))
    experiments = spread_sets(first, size.lanes)
    repeats = 2 * size.repeats
    works = _parts(experiments, repeats)
    periods = experiments[0].periods + experiments[0].transient_periods
    scales = dict.fromkeys(works, 1.0) | {"kernel": periods}
    works["evaluation"] = lambda: evaluate(experiments, threads=1)
    seconds = alternately(works, repeats)
    total = seconds.pop("evaluation")
    parts = {name: value * scales[name] for name, value in seconds.items()}
    found = {f"share_{name}_ms": Figure(1e3 * value / size.lanes, "ms per gain set") for name, value in parts.items()}
    return found | {
        "evaluation_cores_used": Figure(_cores_used(works["evaluation"], size.repeats), "ratio"),
        "evaluation_ms": Figure(1e3 * total / size.lanes, "ms per gain set"),
        "kernel_share_of_evaluation": Figure(parts["kernel"] / total, "ratio", None),
        "fft_share_of_evaluation": Figure(parts["fft"] / total, "ratio", None),
        "parts_over_evaluation": Figure(sum(parts.values()) / total, "ratio", None),
    }


def _cores_used(work: Callable[[], object], repeats: int) -> float:
    own, every = thread_time(), process_time()
    for _ in range(repeats):
        work()
    return (process_time() - every) / (thread_time() - own)


def _parts(experiments: list[Experiment], calls: int) -> dict[str, Callable[[], object]]:
    """The parts of `evaluate` for the experiments of one chunk, in order; the kernel for one period only."""
    e = experiments[0]
    rig, n, lines = e.rig, e.samples_per_period, lines_at(e.excitations)
    s = simulate_statistics(experiments, threads=1).statistics
    force, band = force_statistics(s, e), np.array([rig.target.band])
    bands = sliding_bands(force.frequency, rig.protocol.band_width, rig.protocol.band_overlap)
    start, stop = band_slices(force.frequency, band)[0]
    loop, poles = s.at_lines(lines_at(e.excitations, "current")), all_poles(experiments)
    blocks = -(-len(experiments) // LANES)
    rng = np.random.default_rng(0)
    output = rng.standard_normal((n, len(step_channels()), LANES))
    spectra, at_lines = rng.standard_normal((len(SPECTRAL), len(lines), 2, LANES)), LineSpectra(n, lines)
    seeds, rms = np.arange(LANES, dtype=np.uint64), np.full(LANES, rig.noise.force)

    def fft() -> None:
        for _ in range(blocks * e.periods):
            at_lines(output, 0)
            at_lines(output, 1)

    def prepare() -> None:
        own_lanes(experiments)
        for place in PLACES * blocks:
            e.waveform(place)

    def statistics() -> None:
        for _ in range(blocks):
            gathered = PeriodStatistics(len(SPECTRAL), (0, 1, 2), len(lines))
            for period in range(e.periods):
                line_noise(seeds, rms, period, n, lines)
                gathered.add(spectra)
            gathered.mean()
            gathered.covariance()
        force_statistics(s, e)
        s.at_lines(loop.lines)

    def in_target_band() -> None:
        receptance, _ = frequency_response(force, "displacement", "force")
        least_squares(force.frequency[start:stop], receptance[:, start:stop], rig.mass)

    def margin() -> None:
        sensitivity, _ = frequency_response(loop, "command", "injection")
        margin_arrays(loop.frequency, sensitivity)

    return {
        "target": lambda: score_target(rig),
        "lanes": prepare,
        "kernel": stepper(experiments, calls),
        "fft": fft,
        "statistics": statistics,
        "poles": lambda: pole_radii(experiments),
        "between_lines": lambda: between_lines(experiments, poles, loop.frequency),
        "ml_points_all_bands": lambda: maximum_likelihood(force, bands, rig.mass, intervals=False),
        "ml_intervals_target_band": lambda: maximum_likelihood(force, band, rig.mass),
        "least_squares_target_band": in_target_band,
        "margins": margin,
    }
