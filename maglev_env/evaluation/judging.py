"""What is estimated of simulated identification experiments, and their scores; also in other processes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimation.bands import band_slices, sliding_bands
from estimation.least_squares import least_squares
from estimation.lines.frequency_response import POOL, frequency_response, pooled_variance
from estimation.lines.periods import LineStatistics
from estimation.lines.smooth_loop import smooth_closed_loop
from estimation.max_likelihood import BandEstimate, maximum_likelihood
from estimation.normal import NORMAL_95, widening
from estimation.stability_margins import margin_arrays
from maglev_env.evaluation.devices import Prepared
from maglev_env.evaluation.evaluation import Evaluation, joined
from maglev_env.evaluation.goal_score import goal_score, goal_terms
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.evaluation.requirements import LOOP, Measured, held, large_signal_test, measured
from maglev_env.evaluation.score import ScoreTarget, score, terms
from maglev_env.evaluation.sensitivity import injected_sensitivity
from maglev_env.evaluation.target import protocol_of
from maglev_env.evaluation.worst import worst_hidden, worst_of
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.kernel.blocks import Block, own_lanes
from maglev_env.kernel.simulate import Gathered, SimulatedStatistics, simulate_statistics
from maglev_env.kernel.state import State
from maglev_env.linear.between_lines import between_lines
from maglev_env.linear.poles import all_poles
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import of_axis
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.goal import Goal
from maglev_env.rig.rig import axis_rig
from maglev_lanes.period_statistics import PeriodStatistics
from maglev_lanes.shared_pool import Place, SharedPool


@dataclass(frozen=True)
class Judged:
    """How experiments that were simulated are judged.

    Args:
        targets: of each axis, those of all experiments (see `score.stacked`).
        bands: as for `evaluate`.
        goal: what the score is of.
    """

    targets: Sequence[ScoreTarget]
    bands: np.ndarray | None
    goal: Goal | None

    def __call__(self, made: Sequence[Prepared]) -> Evaluation:
        """The evaluation of experiments, of which those on other rigs follow where the goal asks for them."""
        found = [evaluated(part, self.targets, self.bands, self.goal) for part in made]
        return _worst(self.goal, found) if self.goal and len(found) > 1 else found[0]


@dataclass(frozen=True)
class Elsewhere:
    """Experiments that another process judges.

    Args:
        parts: experiments, and of each of their blocks where means, second moments and rows of the state lie.
        how: how they are judged.
        periods: kept ones.
        noisy: number of channels that have a covariance.
    """

    parts: Sequence[tuple[Sequence[Experiment], Sequence[tuple[Place, Place, Place]]]]
    how: Judged
    periods: int
    noisy: int

    @classmethod
    def of(cls, made: Sequence[Prepared], how: Judged, pool: SharedPool) -> "Elsewhere | None":
        """Experiments that were simulated into arrays of the pool; None where these found no room in it."""
        parts, periods, noisy = [], 0, 0
        for part in made:
            places = []
            for done in part.gathered or ():
                mean, second = done.statistics.gathered
                periods, noisy = done.statistics.periods, len(second)
                places.append(tuple(map(pool.place, (mean, second, done.state.rows))))
                if None in places[-1]:
                    return None
            parts.append((list(part.experiments), places))
        return cls(parts, how, periods, noisy)

    def names(self) -> set[str]:
        """Of the memory where all of it lies."""
        return {place.memory for _, places in self.parts for three in places for place in three}

    def judge(self) -> Evaluation:
        """Judge them, in the process that this was sent to."""
        return self.how([self._prepared(*part) for part in self.parts])

    def _prepared(self, experiments: Sequence[Experiment], places: Sequence[tuple[Place, Place, Place]]) -> Prepared:
        blocks = own_lanes(experiments)
        return Prepared(experiments, blocks, list(map(self._gathered, blocks, places)))

    def _gathered(self, block: Block, places: tuple[Place, Place, Place]) -> Gathered:
        mean, second, rows = (place.array() for place in places)
        state = State(block)
        state.rows = rows
        return Gathered(block, state, PeriodStatistics.of(self.periods, range(self.noisy), mean, second))


def ready() -> None:
    """Nothing, but a process that is sent this has imported all that `Elsewhere.judge` needs."""


def _worst(goal: Goal, parts: Sequence[Evaluation]) -> Evaluation:
    """The first evaluation, with the score of the worst values over all, which are of one gain set on several rigs."""
    required, low, high = _worst_required(goal, parts)
    own = goal_terms(goal, required)
    feasible = np.all([part.feasible for part in parts], axis=0)
    total = np.where(feasible, goal_score(own), 0.0)
    return replace(
        parts[0],
        required=required,
        required_low=low,
        required_high=high,
        terms=own,
        score=total,
        feasible=feasible,
        between_lines=worst_hidden([part.between_lines for part in parts]),
    )


def _worst_required(goal: Goal, parts: Sequence[Evaluation]) -> list[dict[str, np.ndarray]]:
    """What a goal measures, of the worst of several rigs or axes, and the bounds of that.

    Where lines hide what a loop has between them, the bounds hold it also if the lines of another one read worse.
    """
    value, low, high = worst_of(
        goal, [p.required for p in parts], [p.required_low for p in parts], [p.required_high for p in parts]
    )
    hidden = worst_hidden([p.between_lines for p in parts])
    for name in set(LOOP) & set(value):
        kept = held(Measured(value[name], low[name], high[name]), name, hidden[name])
        low[name], high[name] = kept.low, kept.high
    return [value, low, high]


def evaluated(
    prepared: Prepared,
    targets: Sequence[ScoreTarget],
    bands: np.ndarray | None,
    goal: Goal | None,
) -> Evaluation:
    """As `evaluate`, of experiments with their lanes, which are simulated here unless they were.

    Args:
        prepared: The experiments.
        targets: Of each axis, those of all experiments (see `score.stacked`).
        bands: As for `evaluate`.
        goal: What the score is of.
    """
    experiments, blocks = prepared.experiments, prepared.blocks
    simulated = simulate_statistics(experiments, threads=1, blocks=blocks, gathered=prepared.gathered)
    poles = all_poles(experiments)
    tested = large_signal_test(goal, experiments, blocks) if goal else [{}] * len(targets)
    parts = [
        _of_axis(experiments, axis, simulated, poles, target, bands, goal, tested[axis])
        for axis, target in enumerate(targets)
    ]
    if len(parts) == 1:
        return parts[0]
    # A rotor is only as good as its worse axis.
    worse = np.argmin([part.score for part in parts], axis=0)
    found = joined(parts, lambda values: np.choose(worse.reshape(-1, *[1] * (values[0].ndim - 1)), values))
    found = replace(found, between_lines=worst_hidden([part.between_lines for part in parts]))
    if not goal:
        return found
    # The axis with the lower score may meet what the other one misses, whose best quantity is better.
    required, low, high = _worst_required(goal, parts)
    return replace(found, required=required, required_low=low, required_high=high)


def _of_axis(
    experiments: Sequence[Experiment],
    axis: int,
    simulated: SimulatedStatistics,
    poles: Sequence[np.ndarray],
    target: ScoreTarget,
    bands: np.ndarray | None,
    goal: Goal | None,
    tested: Mapping[str, Measured],
) -> Evaluation:
    """Estimates and scores of one axis of simulated experiments; tested: by its large-signal test."""
    whole, first = experiments[0], axis_experiment(experiments[0], axis)
    band = np.array([whole.rig.target.band], dtype=float)
    alive = np.isnan(simulated.touchdown_time)
    of_rig = {id(e.rig): axis_rig(e.rig, axis) for e in {id(e.rig): e for e in experiments}.values()}  # mostly one
    rigs = [of_rig[id(e.rig)] for e in experiments]
    mass = np.array([rig.mass for rig in rigs])[alive]
    force = force_statistics(_at_lines(simulated, first, axis, "force", ("force", "displacement")), first)
    if bands is None:
        protocol = protocol_of(whole.rig)
        bands = sliding_bands(force.frequency, protocol.band_width, protocol.band_overlap)
    sliding = maximum_likelihood(force, bands, mass, intervals=False)
    in_target = maximum_likelihood(force, band, mass)
    start, stop = band_slices(force.frequency, band)[0]
    receptance, _ = frequency_response(force, "displacement", "force")
    ls = least_squares(force.frequency[start:stop], receptance[:, start:stop], mass)
    read = ("displacement", "command", "injection") + (("position",) if first.sensor != "probe" else ())
    injection = _at_lines(simulated, first, axis, "current", read)
    controllers = [of_axis(e.gains, axis) for e, lives in zip(experiments, alive, strict=True) if lives]
    sensitivity, variance = injected_sensitivity(injection, controllers, whole.rig.control_rate)
    # The noise of S is averaged in proportion to |S|^2, as it enters at one place of the loop: that of a single line is
    # told by few periods, and the peak is the line that noise raised most, not the one whose noise looks large.
    size = np.abs(sensitivity) ** 2
    variance = pooled_variance(variance / size) * size
    if goal:
        sensitivity, variance = smooth_closed_loop(injection.frequency, sensitivity, variance)
    variance = variance * widening(2 * POOL * (injection.periods - 1)) ** 2
    margins = margin_arrays(injection.frequency, sensitivity)
    nearest = np.abs(np.log(injection.frequency / margins["peak_frequency"][:, None])).argmin(axis=1)
    probe = np.array([rig.sensor_time_constant for rig in rigs])[alive]
    if first.sensor == "probe":
        added_phase, margin_lost = np.full((2, len(probe)), np.nan)
    else:
        added_phase, margin_lost = _sensing_cost(probe, injection, sensitivity, margins)
    hidden = between_lines(experiments, poles, injection.frequency, axis)
    ms_se = np.sqrt(variance[np.arange(len(nearest)), nearest] / 2)
    ms_se = np.fmax(ms_se, (hidden["peak_sensitivity"][alive] - margins["peak_sensitivity"]) / NORMAL_95)
    aims = ScoreTarget(*(np.asarray(value)[alive] for value in vars(target).values()))
    scored = terms(
        aims,
        in_target.stiffness[:, 0],
        in_target.damping[:, 0],
        margins["peak_sensitivity"],
        simulated.peak_displacement[alive],
        simulated.current_rms[alive],
        0.0 if first.sensor == "probe" else simulated.gap_error.rms[alive],
    )
    total, required = score(scored), {}
    if goal:
        known = _known(in_target, simulated, alive, aims, tested)
        loop = injection.frequency, sensitivity, variance
        required = measured(goal, force, loop, margins, known, axis_rig(whole.rig, axis).runs_away)
        required |= {name: held(required[name], name, hidden[name][alive]) for name in LOOP if name in required}
        scored = goal_terms(goal, {name: m.value for name, m in required.items()})
        total = goal_score(scored)
    radius = np.array([np.abs(own).max() for own in poles])
    feasible = alive & (radius < 1)
    scored = {name: _scatter(value, alive) for name, value in scored.items()}
    return Evaluation(
        bands=bands,
        band_stiffness=_scatter(sliding.stiffness, alive),
        band_damping=_scatter(sliding.damping, alive),
        band_stiffness_se=_scatter(sliding.stiffness_se, alive),
        band_damping_se=_scatter(sliding.damping_se, alive),
        **{
            name: _scatter(getattr(in_target, name)[:, 0], alive)
            for name in ("stiffness", "stiffness_low", "stiffness_high", "damping", "damping_low", "damping_high")
        },
        ls_stiffness=_scatter(ls.stiffness, alive),
        ls_damping=_scatter(ls.damping, alive),
        margins={name: _scatter(value, alive) for name, value in margins.items()},
        peak_sensitivity_se=_scatter(ms_se, alive),
        peak_displacement=simulated.peak_displacement,
        current_rms=simulated.current_rms,
        touchdown_time=simulated.touchdown_time,
        **{f"gap_error_{name}": values for name, values in vars(simulated.gap_error).items()},
        added_phase=_scatter(added_phase, alive),
        margin_lost=_scatter(margin_lost, alive),
        pole_radius=radius,
        terms=scored,
        score=np.where(feasible, np.nan_to_num(_scatter(total, alive)), 0.0),
        feasible=feasible,
        axis=np.full(len(experiments), axis),
        required={name: _scatter(m.value, alive) for name, m in required.items()},
        required_low={name: _scatter(m.low, alive) for name, m in required.items()},
        required_high={name: _scatter(m.high, alive) for name, m in required.items()},
        between_lines={name: np.where(alive, values, np.nan) for name, values in hidden.items()},
    )


def _known(
    in_target: BandEstimate,
    simulated: SimulatedStatistics,
    alive: np.ndarray,
    aims: ScoreTarget,
    tested: Mapping[str, Measured],
) -> dict[str, Measured]:
    """What a goal may require and the loop's responses do not show: of the large-signal test, estimate and record."""
    known = {name: Measured(m.value[alive], m.low[alive], m.high[alive]) for name, m in tested.items()}
    for name in ("stiffness", "damping"):
        ends = (getattr(in_target, f"{name}{end}")[:, 0] for end in ("", "_low", "_high"))
        known[name] = Measured(*ends)
    for name, value in (
        ("displacement", simulated.peak_displacement[alive] / aims.clearance),
        ("current_rms", simulated.current_rms[alive]),
    ):
        known[name] = Measured(value, *np.full((2, len(value)), np.nan))
    return known


def _sensing_cost(
    probe_lag: np.ndarray, injection: LineStatistics, sensitivity: np.ndarray, margins: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Cost of self-sensing compared with a probe, degrees (n,) each, from its effect on the injection lines.

    Args:
        probe_lag: Time constant of the probe, (n,), s.
        injection: Statistics of the injection lines.
        sensitivity: Sensitivity at these lines.
        margins: Margins of the loop.

    Returns:
        Lag added at the crossover of the phase margin, and phase margin lost.
    """
    frequency = injection.frequency
    read, was = (injection.mean[:, injection.channels.index(name)] for name in ("displacement", "position"))
    probe = 1 / (1 + 2j * np.pi * frequency * probe_lag[:, None])
    beyond = read / was / probe
    with_probe = margin_arrays(frequency, 1 / (1 + (1 / sensitivity - 1) / beyond))
    lag = -np.degrees(np.angle(beyond))
    crossing = margins["phase_margin_frequency"]
    added = np.array([np.interp(at, frequency, row) for at, row in zip(crossing, lag, strict=True)])
    return np.where(np.isnan(crossing), np.nan, added), with_probe["phase_margin"] - margins["phase_margin"]


def _at_lines(
    simulated: SimulatedStatistics, of_axis: Experiment, axis: int, place: str, channels: Sequence[str]
) -> LineStatistics:
    """Channels of one axis at the lines of its excitation at a place, of experiments without a touchdown."""
    ending = f"_{AXES[axis]}" if simulated.experiment.rig.axes == 2 else ""
    names, alive = [f"{name}{ending}" for name in channels], np.isnan(simulated.touchdown_time)
    found = simulated.at_lines(lines_at(of_axis.excitations, place), names, alive)
    return replace(found, channels=tuple(channels))


def _scatter(values: np.ndarray, alive: np.ndarray) -> np.ndarray:
    out = np.full((len(alive), *values.shape[1:]), np.nan)
    out[alive] = values
    return out
