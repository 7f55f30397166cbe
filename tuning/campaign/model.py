"""The rig by which gains are judged: responses as measured, large signals by rigs that the recordings allow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimation.stability_margins import margin_arrays
from maglev_env.design.goals import goal_of
from maglev_env.evaluation.goal_score import goal_score, goal_terms, misses
from maglev_env.evaluation.requirements import EVENT_NAMES, followed_events, time_to_rest
from maglev_env.evaluation.score import score, terms
from maglev_env.kernel.blocks import own_lanes
from maglev_env.loop.gains import PidGains
from maglev_env.rig.goal import Goal, Requirement
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.campaign.carried import DRAWS, Carried, louder
from tuning.campaign.gain_set import GainSet
from tuning.campaign.rig_fit import MASS, IdentifiedRig
from tuning.study.study import experiments
from tuning.tuner import Trials

RIGS = 12  # of the posterior, on which large signals are simulated; the first is the best estimate
# Large-signal figures that recordings show, too, with the relative standard error of one recording.
SEEN = {"peak_displacement": 0.02, "current_rms": 0.005, "noise_current": 0.03}
# Relative standard deviation of what an event of the fitted rig shows from that of the true one; lift-off begins where
# no recording has been, at a share of the gap where the force law is not known by its tangent.
EVENT_ERROR, LIFT_OFF_ERROR = 0.05, 0.15
CURVED = 0.2  # that of a displacement in an event, over its share of the clearance: law and probe are known near rest
# Standard deviation of ln of the band in which a rotor is at rest: a tail of the motion that is larger or smaller than
# that of the fitted rig leaves the band one swing later or earlier.
BAND_ERROR = {"step": 0.15, "lift_off": 0.5}


@dataclass(frozen=True, eq=False)
class Model:
    """The rig by which gains are judged.

    Attributes:
        task: The task; its box covers the recorded gains.
        corners: Corners (2, k) of the rig's own bounds in that box.
        goal: Of the task, for the rig itself; None for `match`.
        responses: From all recordings.
        episodes: RIGS rigs of the posterior.
        recorded: Gain sets that held, from which distances are counted.
        ratios: Measured over simulated on each of the RIGS, of SEEN where it is known.
        noise_error: Relative standard error of the noise current that the ratio is made of.
        mass: Relative standard deviation of the stated mass.
        probe: That of the stated gain of the probe.
    """

    task: Task
    corners: np.ndarray
    goal: Goal | None
    responses: Carried
    episodes: Sequence[Episode]
    recorded: Sequence[GainSet]
    ratios: Mapping[str, np.ndarray] = field(default_factory=dict)
    noise_error: float = 0.0
    mass: float = MASS
    probe: float = 0.0

    def gains(self, point: np.ndarray) -> PidGains:
        return self.task.box.applied(self.task.rig.gains, self.task.box.gains(point))

    def point(self, gains: PidGains) -> np.ndarray:
        return self.task.box.point(gains)

    def apart(self, gains: PidGains) -> float:
        """log2 of the largest factor between the controller's response and the nearest recorded one."""
        return min(louder(s.gains, gains, self.task.rig.control_rate) for s in self.recorded) / np.log(2)


def model_of(
    task: Task, corners: np.ndarray, identified: IdentifiedRig, responses: Carried, good: Sequence[GainSet], seed: int
) -> Model:
    """The rig by which gains are judged."""
    start = np.zeros(len(task.box.names))
    rng = np.random.default_rng(seed)
    rigs = [identified.rig(theta) for theta in responses.thetas[:RIGS]]
    episodes = [Episode(rig, task.target, start, int(rng.integers(2**63))) for rig in rigs]
    goal, tolerance = goal_of(task.rig), task.rig.tolerance
    model = Model(
        task, corners, goal, responses, episodes, good,
        mass=tolerance.get("mass", MASS), probe=tolerance.get("probe_gain", 0.0),
    )  # fmt: skip
    points = np.array([model.point(s.gains) for s in good])
    n = len(points)
    every = [episode for episode in episodes for _ in range(n)]
    simulated = experiments(task, every, np.tile(points, (RIGS, 1)), [0] * len(every))
    ratios, certain = {}, np.array([1 / (SEEN["noise_current"] ** 2 + s.noise_error**2) for s in good])
    for name in SEEN:
        shown = figure(simulated, name).reshape(RIGS, n)
        seen = np.array([measured(s)[name] for s in good])
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.where((shown > 0) & (seen > 0), np.log(seen / shown), np.nan)
        if not np.isnan(apart[0]).all():
            # A rig that does not hold there tells nothing of its own, and takes what the best estimate shows.
            apart = np.where(np.isnan(apart), apart[0], apart)
            weight = np.where(np.isnan(apart), 0.0, certain if name == "noise_current" else 1.0)
            ratios[name] = np.exp((weight * np.nan_to_num(apart)).sum(axis=1) / weight.sum(axis=1))
    told = [s.noise_error for s in good if s.noise_current > 0]
    error = float(np.sqrt(1 / np.sum(1 / np.square(told)))) if told and min(told) > 0 else 0.0
    return Model(**{**vars(model), "ratios": ratios, "noise_error": error})


def linear(model: Model, responses: Carried, gains: PidGains, apart: float, draws: int) -> dict[str, np.ndarray]:
    """Margins, stiffness, damping and compliance (draws,) by the responses."""
    rig = model.task.rig
    s = responses.sensitivity(gains, apart, draws)
    m = margin_arrays(responses.injected, s)
    rng = np.random.default_rng(161803)  # the same rotor and probe whatever the gains
    weighed, calibrated = rng.standard_normal((2, DRAWS))[:, :draws]
    weighed[0] = calibrated[0] = 0.0
    y = responses.receptance(gains, apart, draws) / (1 + model.probe * calibrated[:, None])
    f = responses.forced
    low, high = rig.target.band
    inside = (f >= low) & (f <= high)
    w, z = 2 * np.pi * f[inside], 1 / y[:, inside]
    weight = 1 / (rig.noise.force**2 + np.abs(z[0]) ** 2 * rig.noise.displacement**2 + 1e-30)
    mass = rig.mass * (1 + model.mass * weighed[:, None])
    k = (weight * (z.real + mass * w**2)).sum(axis=1) / weight.sum()
    c = (weight * w * z.imag).sum(axis=1) / (weight * w**2).sum()
    found = {
        "stiffness": k,
        "damping": c,
        **{n: m[n] for n in ("peak_sensitivity", "phase_margin", "gain_margin_high", "disk_margin")},
        "gain_margin": np.fmin(m["gain_margin_high"], np.fmin(1 / m["gain_margin_low"], responses.falls(gains, draws))),
    }
    asked = {r.name: r for r in model.goal.measured} if model.goal else {}
    band = asked["compliance"].band if "compliance" in asked else (0.0, np.inf)
    found["compliance"] = np.abs(y[:, (f >= band[0]) & (f <= band[1])]).max(axis=1)
    return found


def large(
    model: Model,
    lanes: Trials,
    turn: np.ndarray,
    seen: GainSet | None,
    alone: bool = False,
    times: Mapping[str, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """What the experiment and the events show of large signals, for each draw that of its lane.

    Args:
        model: The rig.
        lanes: Experiments on the RIGS of the model in this order, or, alone, all on its best estimate.
        turn: Lane of each draw.
        seen: A recording at these gains, which shows some of it itself.
        alone: Then the values are without errors.
        times: By `event_times`; None: those of the experiments.
    """
    own = measured(seen) if seen else {}
    found, rng = {}, np.random.default_rng(141421)

    def scattered(values: np.ndarray, error: float | np.ndarray) -> np.ndarray:
        if alone:
            return values
        normal = rng.standard_normal(turn.size)
        normal[0] = 0.0
        return values * np.exp(error * normal)

    for name, error in SEEN.items():
        known = own.get(name, np.nan)
        ratio = model.ratios.get(name, np.ones(RIGS))
        shown = figure(lanes, name)[turn] * (ratio[0] if alone else ratio[turn])
        values = np.full(turn.size, known) if known > 0 else shown
        if name == "noise_current":
            error = np.hypot(error, seen.noise_error if seen and known > 0 else model.noise_error)
        found[name] = scattered(values, error)
    found["displacement"] = found["peak_displacement"] / model.task.rig.clearance
    for one in model.goal.measured if model.goal else ():
        if one.quantity.event not in (None, "hover"):
            shown = (times or {}).get(one.name)
            shown = figure(lanes, one.name, np.inf)[turn] if shown is None else shown
            error = event_error(one.name)
            if one.quantity.event == "impulse":
                error = np.hypot(error, CURVED * np.minimum(shown / model.task.rig.clearance, 1.0))
            found[one.name] = scattered(shown, error)
    return found


def event_times(model: Model, gains: PidGains, turn: np.ndarray) -> dict[str, np.ndarray]:
    """Times (draws,) of the goal's events on the rig of each draw, under the doubt of when the rotor is at rest; s."""
    if model.goal is None or not set(BAND_ERROR) & set(model.goal.events):
        return {}
    point = model.task.box.gains(model.point(gains)[None])[0]
    tried = [model.task.experiment(episode, point, 0) for episode in model.episodes]
    (followed,) = followed_events(model.goal, tried, own_lanes(tried))
    found, rng = {}, np.random.default_rng(196883)
    for event, limit, series in followed.events:
        if event.kind in BAND_ERROR:
            wider = np.exp(BAND_ERROR[event.kind] * rng.standard_normal(turn.size))
            wider[0] = 1.0
            times = np.array([time_to_rest(followed, limit, series, w)[t] for w, t in zip(wider, turn, strict=True)])
            found[EVENT_NAMES[event.kind]] = np.where(np.isnan(times), np.inf, times)
    return found


def event_error(name: str) -> float:
    """Relative standard deviation of a quantity that an event shows."""
    return LIFT_OFF_ERROR if name == "lift_off_time" else EVENT_ERROR


def event_current(model: Model, gains: PidGains) -> float | None:
    """Largest current in the events of the goal on the fitted rig, A; None where the goal has no events."""
    goal = model.goal
    if goal is None or not goal.events:
        return None
    others = tuple(r for r in goal.requirements if r.name != "current_peak")
    asked = replace(goal, requirements=(*others, Requirement("current_peak", 1.0)))
    first = model.episodes[0]
    rig = replace(first.rig, target=replace(first.rig.target, goal=asked.text))
    lanes = experiments(model.task, [replace(first, rig=rig)], model.point(gains)[None], [0])
    return float(figure(lanes, "current_peak")[0])


def terms_of(model: Model, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Terms of the score, each (draws,)."""
    if model.goal is None:
        names = ("stiffness", "damping", "peak_sensitivity", "peak_displacement", "current_rms")
        return terms(model.task.target, *(values[n] for n in names))
    return goal_terms(model.goal, values)


def scored(model: Model, found: Mapping[str, np.ndarray]) -> np.ndarray:
    """The score of each draw by the terms of its goal or target."""
    return np.asarray(goal_score(found) if model.goal else score(found))


def missed_by(model: Model, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By how much each requirement of the goal is missed, (draws,) each (`goal_score.misses`)."""
    return {r.name: misses(r, values[r.name]) for r in model.goal.requirements} if model.goal else {}


def measured(s: GainSet) -> dict[str, float]:
    return {"peak_displacement": s.peak_displacement, "current_rms": s.current_rms, "noise_current": s.noise_current}


def figure(lanes: Trials, name: str, unknown: float = np.nan) -> np.ndarray:
    """One named figure of all trials, (n,); `unknown` where a trial lacks it."""
    return np.array([one.get(name, one.get(f"required_{name}", unknown)) for one in lanes.info], float)
