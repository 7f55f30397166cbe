"""Scoring of gain sets as on a real rig: simulate the identification experiment, estimate, score."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from estimation.bands import band_slices, sliding_bands
from estimation.least_squares import least_squares
from estimation.lines.frequency_response import frequency_response, pooled_variance
from estimation.lines.periods import LineStatistics, held
from estimation.max_likelihood import maximum_likelihood
from estimation.normal import NORMAL_95
from estimation.stability_margins import margin_arrays
from estimation.xy.planar import axis_statistics
from maglev_env.design.goals import goal_of
from maglev_env.evaluation.goal_score import goal_score, goal_terms
from maglev_env.evaluation.requirements import Measured, large_signal_test, measured
from maglev_env.evaluation.score import ScoreTarget, score, stacked, terms
from maglev_env.evaluation.sensitivity import injected_sensitivity
from maglev_env.evaluation.worst import drawn_experiments, worst_of
from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.kernel.simulate import SimulatedStatistics, own_lanes, simulate_statistics
from maglev_env.linear.loop import closed_loop_poles, expected_statistics, pole_radii
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import NO_CONTROLLER, of_axis
from maglev_env.presented import Presented, matplotlib_figure
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.goal import QUANTITIES, Goal
from maglev_env.rig.rig import Protocol, Rig, axis_rig
from maglev_env.units import prefixed
from maglev_lanes.threads import over_threads

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

CHUNK = 128  # experiments estimated together, which keeps the largest temporary near 10 MB per thread


@dataclass(frozen=True, repr=False)
class Evaluation(Presented):
    """n scored experiments; arrays (n,) unless stated, nan where the rotor touched down.

    For an x-y rig every value is that of the axis with the lower score, by D's direct coefficients; there
    peak_displacement is radial and current_rms is the larger one.

    Attributes:
        bands: (b, 2), Hz.
        band_stiffness, band_damping: By maximum likelihood, (n, b), N/m and N s/m.
        band_stiffness_se, band_damping_se: Their standard errors.
        stiffness, damping: In the rig's target band, N/m and N s/m.
        stiffness_low, stiffness_high, damping_low, damping_high: Their 95 % bounds.
        ls_stiffness, ls_damping: Their least-squares values.
        margins: Margins by name, (n,); nan where the crossing lies outside the injection lines.
        peak_sensitivity_se: Standard error.
        peak_displacement: m.
        current_rms: A.
        touchdown_time: s.
        gap_error_rms: Of the sensed displacement, m; likewise gap_error_bias and gap_error_worst.
        added_phase: Lag of self-sensing beyond the probe's at the frequency of the phase margin, degrees; nan with a
            probe.
        margin_lost: Phase margin that a probe would have in addition, degrees; nan with a probe.
        pole_radius: Of the simulated loop, linearised.
        terms: Score terms.
        score: 0 to 1.
        feasible: The linearised loop is stable and the rotor never touched down. A rotor may also stay near a pole
            although it is unstable in the centre.
        axis: 0 (x) or 1 (y).
        required: What a goal measures, by name (see `rig.goal.QUANTITIES`), of the worst rig if it is judged on
            several. Empty for the goal `match`.
        required_low, required_high: Their 95 % bounds where they are known (see `requirements.Measured`).
    """

    bands: np.ndarray
    band_stiffness: np.ndarray
    band_damping: np.ndarray
    band_stiffness_se: np.ndarray
    band_damping_se: np.ndarray
    stiffness: np.ndarray
    stiffness_low: np.ndarray
    stiffness_high: np.ndarray
    damping: np.ndarray
    damping_low: np.ndarray
    damping_high: np.ndarray
    ls_stiffness: np.ndarray
    ls_damping: np.ndarray
    margins: dict[str, np.ndarray]
    peak_sensitivity_se: np.ndarray
    peak_displacement: np.ndarray
    current_rms: np.ndarray
    touchdown_time: np.ndarray
    gap_error_rms: np.ndarray
    gap_error_bias: np.ndarray
    gap_error_worst: np.ndarray
    added_phase: np.ndarray
    margin_lost: np.ndarray
    pole_radius: np.ndarray
    terms: dict[str, np.ndarray]
    score: np.ndarray
    feasible: np.ndarray
    axis: np.ndarray
    required: dict[str, np.ndarray] = field(default_factory=dict)
    required_low: dict[str, np.ndarray] = field(default_factory=dict)
    required_high: dict[str, np.ndarray] = field(default_factory=dict)

    rows = "experiment"

    def __str__(self) -> str:
        if not self.feasible.any():
            return f"Evaluation of {len(self.score)} experiments, none feasible"
        best = int(np.argmax(self.score))
        factor, unit = prefixed(float(np.nan_to_num(self.stiffness[best])), "N/m")
        return (
            f"Evaluation of {len(self.score)} experiments, {int(self.feasible.sum())} feasible; best number {best}: "
            f"score {self.score[best]:.3f}, stiffness {self.stiffness[best] * factor:.3g} {unit}, "
            f"damping {self.damping[best]:.3g} N s/m, peak |S| {self.margins['peak_sensitivity'][best]:.3g}"
        )

    def to_xarray(self) -> "xr.Dataset":
        """Every array by experiment, and by band at the bands' centres (Hz); units are in the attributes.

        Margins have their own names; the terms of the score begin with `term_`, what a goal measures with `required_`.
        """
        import xarray as xr

        arrays = {}
        for f in fields(self):
            own = getattr(self, f.name)
            if isinstance(own, dict):
                arrays |= {f"{_PREFIXES[f.name]}{name}": values for name, values in own.items()}
            elif f.name != "bands":
                arrays[f.name] = own
        dims = ("experiment", "band")
        variables = {
            name: (dims[: np.ndim(values)], values, {"units": unit} if (unit := _unit_of(name)) else {})
            for name, values in arrays.items()
        }
        hertz = {"units": "Hz"}
        coordinates = {
            "experiment": np.arange(len(self.score)),
            "band": ("band", self.bands.mean(axis=1), hertz),
            "f_lo": ("band", self.bands[:, 0], hertz),
            "f_hi": ("band", self.bands[:, 1], hertz),
        }
        return xr.Dataset(variables, coordinates, {"rows": self.rows})

    def plot(self) -> "Figure":
        """Stiffness and damping over frequency of every experiment with 95 % intervals, as a matplotlib figure."""
        figure = matplotlib_figure()(layout="constrained")
        axes = figure.subplots(2, 1, sharex=True)
        centre = self.bands.mean(axis=1)
        for ax, name, unit in zip(axes, ("stiffness", "damping"), ("N/m", "N s/m"), strict=True):
            value, se = getattr(self, f"band_{name}"), getattr(self, f"band_{name}_se")
            for i in range(len(self.score)):
                ax.errorbar(centre, value[i], NORMAL_95 * se[i], fmt=".-", capsize=2, label=f"experiment {i}")
            ax.set_ylabel(f"{name}, {unit}")
        axes[1].set_xlabel("frequency, Hz")
        axes[0].legend()
        return figure


# Of the arrays by name, in a table of all arrays.
_PREFIXES = {
    "margins": "", "terms": "term_", "required": "required_", "required_low": "required_low_",
    "required_high": "required_high_",
}  # fmt: skip
# SI units of the arrays, by a part of their names; the first that fits counts.
_UNITS = (
    ("term_", ""), ("_frequency", "Hz"), ("stiffness", "N/m"), ("damping", "N s/m"), ("phase", "deg"),
    ("margin_lost", "deg"), ("delay_margin", "s"), ("displacement", "m"), ("current_rms", "A"), ("touchdown_time", "s"),
    ("gap_error", "m"),
)  # fmt: skip


def _unit_of(name: str) -> str:
    if name.startswith("required_"):
        quantity = QUANTITIES.get(name.removeprefix("required_").removeprefix("low_").removeprefix("high_"))
        return quantity.unit if quantity else ""
    return next((unit for part, unit in _UNITS if part in name), "")


def score_target(rig: Rig) -> ScoreTarget:
    """Target of a one-axis rig; a stiffness or damping that it does not give is that of its nominal preset loop.

    For an axis of an x-y rig see `rig.axis_rig`.

    Raises:
        ValueError: The preset gains do not stabilise the nominal loop.
    """
    t = rig.target
    stiffness, damping = t.stiffness, t.damping
    if stiffness is None or damping is None:
        nominal = _nominal_coefficients(rig)
        stiffness, damping = stiffness or nominal[0], damping or nominal[1]
    return ScoreTarget(stiffness, damping, t.peak_sensitivity, rig.clearance, t.current_limit, rig.gap)


def _protocol(rig: Rig) -> Protocol:
    if rig.protocol is None:
        raise ValueError(f"rig {rig.name}: its TOML has no [protocol], by which gains are scored; give one")
    return rig.protocol


def _nominal_coefficients(rig: Rig) -> tuple[float, float]:
    p = _protocol(rig)
    experiment = Experiment(rig, rig.gains or NO_CONTROLLER, p.excitations, p.periods, p.transient_periods)
    radius = np.abs(closed_loop_poles(experiment)).max()
    if radius >= 1:
        raise ValueError(
            f"rig {rig.name}: [gains] do not stabilise it (pole radius {radius:.4f}); set [target] or gains"
        )
    statistics = force_statistics(
        expected_statistics(experiment, lines_at(experiment.excitations, "force")), experiment
    )
    estimate = maximum_likelihood(statistics, np.array([rig.target.band]), rig.mass, intervals=False)
    return float(estimate.stiffness[0]), float(estimate.damping[0])


def force_statistics(statistics: LineStatistics, experiment: Experiment) -> LineStatistics:
    """Force and displacement at the force lines, with the converter's hold removed from the force."""
    lines = lines_at(experiment.excitations, "force")
    if not lines.size:
        raise ValueError("experiment: stiffness and damping need an excitation at the force")
    return held(statistics.at_lines(lines, ("force", "displacement")), "force", experiment.rig.control_rate)


def evaluate(
    experiments: Sequence[Experiment],
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
    targets: Sequence[ScoreTarget] | None = None,
    bands: np.ndarray | None = None,
) -> Evaluation:
    """Simulate, estimate and score experiments of one kind of rig; gains, parameters, effects and seeds may differ.

    What the score is of is the goal of the first rig, see `design.goals.with_goal`; its `match` uses the targets.

    Args:
        experiments: The experiments.
        threads: Number of threads, by default all cores; results do not depend on it.
        progress: Called with the number of experiments done.
        targets: One per experiment, for every axis; by default that of the first rig.
        bands: Bands (b, 2), Hz; by default the sliding ones of the first rig's protocol.

    Raises:
        ValueError: The experiments do not share excitations and schedule, or lack a force or a current excitation.
    """
    if not experiments:
        raise ValueError("give at least one experiment")
    rig = experiments[0].rig
    goal = goal_of(rig)
    if targets is None:
        per_axis = [[score_target(axis_rig(rig, axis))] * len(experiments) for axis in range(rig.axes)]
    elif len(targets) != len(experiments):
        raise ValueError(f"{len(targets)} targets for {len(experiments)} experiments: give one for each")
    else:
        per_axis = [list(targets)] * rig.axes
    chunks = [slice(i, i + CHUNK) for i in range(0, len(experiments), CHUNK)]
    parts = []

    def work(chunk: slice) -> Evaluation:
        own = [stacked(one[chunk]) for one in per_axis]
        drawn = drawn_experiments(experiments[chunk], goal.rigs) if goal else []
        found = [_evaluate_chunk(part, own, bands, goal) for part in (experiments[chunk], *drawn)]
        return _worst(goal, found) if goal and drawn else found[0]

    for part in over_threads(work, chunks, threads):
        parts.append(part)
        if progress:
            progress(len(part.score))
    return _combined(parts, np.concatenate)


def _worst(goal: Goal, parts: Sequence[Evaluation]) -> Evaluation:
    """The first evaluation, with the score of the worst values over all, which are of one gain set on several rigs."""
    ends = ([p.required for p in parts], [p.required_low for p in parts], [p.required_high for p in parts])
    required, low, high = worst_of(goal, *ends)
    own = goal_terms(goal, required)
    feasible = np.all([part.feasible for part in parts], axis=0)
    total = np.where(feasible, goal_score(own), 0.0)
    return replace(
        parts[0], required=required, required_low=low, required_high=high, terms=own, score=total, feasible=feasible
    )


def _evaluate_chunk(
    experiments: Sequence[Experiment],
    targets: Sequence[ScoreTarget],
    bands: np.ndarray | None,
    goal: Goal | None,
) -> Evaluation:
    blocks = own_lanes(experiments)
    simulated = simulate_statistics(experiments, threads=1, blocks=blocks)
    radius = pole_radii(experiments)
    tested = large_signal_test(goal, experiments, blocks) if goal else [{}] * len(targets)
    parts = [
        _of_axis(experiments, axis, simulated, radius, target, bands, goal, tested[axis])
        for axis, target in enumerate(targets)
    ]
    if len(parts) == 1:
        return parts[0]
    # A rotor is only as good as its worse axis.
    worse = np.argmin([part.score for part in parts], axis=0)
    return _combined(parts, lambda values: np.choose(worse.reshape(-1, *[1] * (values[0].ndim - 1)), values))


def _of_axis(
    experiments: Sequence[Experiment],
    axis: int,
    simulated: SimulatedStatistics,
    radius: np.ndarray,
    target: ScoreTarget,
    bands: np.ndarray | None,
    goal: Goal | None,
    tested: Mapping[str, Measured],
) -> Evaluation:
    """Estimates and scores of one axis of simulated experiments; tested: by its large-signal test."""
    whole, first = experiments[0], axis_experiment(experiments[0], axis)
    band = np.array([whole.rig.target.band], dtype=float)
    alive = np.isnan(simulated.touchdown_time)
    statistics = _lanes(simulated.statistics, alive)
    if whole.rig.axes == 2:
        statistics = axis_statistics(statistics, AXES[axis])
    rigs = [axis_rig(e.rig, axis) for e in experiments]
    mass = np.array([rig.mass for rig in rigs])[alive]
    force = force_statistics(statistics, first)
    if bands is None:
        protocol = _protocol(whole.rig)
        bands = sliding_bands(force.frequency, protocol.band_width, protocol.band_overlap)
    sliding = maximum_likelihood(force, bands, mass, intervals=False)
    in_target = maximum_likelihood(force, band, mass)
    start, stop = band_slices(force.frequency, band)[0]
    receptance, _ = frequency_response(force, "displacement", "force")
    ls = least_squares(force.frequency[start:stop], receptance[:, start:stop], mass)
    injection = statistics.at_lines(lines_at(first.excitations, "current"))
    controllers = [of_axis(e.gains, axis) for e, lives in zip(experiments, alive, strict=True) if lives]
    sensitivity, variance = injected_sensitivity(injection, controllers, whole.rig.control_rate)
    margins = margin_arrays(injection.frequency, sensitivity)
    nearest = np.abs(np.log(injection.frequency / margins["peak_frequency"][:, None])).argmin(axis=1)
    probe = np.array([rig.sensor_time_constant for rig in rigs])[alive]
    if first.sensor == "probe":
        added_phase, margin_lost = np.full((2, len(probe)), np.nan)
    else:
        added_phase, margin_lost = _sensing_cost(probe, injection, sensitivity, margins)
    ms_se = np.sqrt(variance[np.arange(len(nearest)), nearest] / 2)
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
        # The noise of S is averaged in proportion to |S|^2, as it enters at one place of the loop.
        size = np.abs(sensitivity) ** 2
        loop = injection.frequency, sensitivity, pooled_variance(variance / size) * size
        known = {name: Measured(m.value[alive], m.low[alive], m.high[alive]) for name, m in tested.items()}
        for name in ("stiffness", "damping"):
            ends = (getattr(in_target, f"{name}{end}")[:, 0] for end in ("", "_low", "_high"))
            known[name] = Measured(*ends)
        for name, value in (
            ("displacement", simulated.peak_displacement[alive] / aims.clearance),
            ("current_rms", simulated.current_rms[alive]),
        ):
            known[name] = Measured(value, *np.full((2, len(value)), np.nan))
        required = measured(goal, force, loop, margins, known)
        scored = goal_terms(goal, {name: m.value for name, m in required.items()})
        total = goal_score(scored)
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
    )


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


def _lanes(statistics: LineStatistics, keep: np.ndarray) -> LineStatistics:
    if keep.all():
        return statistics
    return replace(statistics, mean=statistics.mean[keep], covariance=statistics.covariance[keep])


def _scatter(values: np.ndarray, alive: np.ndarray) -> np.ndarray:
    out = np.full((len(alive), *values.shape[1:]), np.nan)
    out[alive] = values
    return out


def _combined(parts: Sequence[Evaluation], join: Callable[[list[np.ndarray]], np.ndarray]) -> Evaluation:
    """One evaluation with every array joined from those of the parts, which have the same bands."""
    joined = {}
    for f in fields(Evaluation):
        values = [getattr(p, f.name) for p in parts]
        if f.name == "bands":
            joined[f.name] = values[0]
        elif isinstance(values[0], dict):
            joined[f.name] = {key: join([v[key] for v in values]) for key in values[0]}
        else:
            joined[f.name] = join(values)
    return Evaluation(**joined)
