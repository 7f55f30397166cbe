"""What gains reach on a rig: by the responses that were measured, and by the fitted rig what responses do not show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimation.stability_margins import margin_arrays
from maglev_env.design.goals import goal_of
from maglev_env.evaluation.goal_score import goal_score, goal_terms, misses
from maglev_env.evaluation.score import score, terms
from maglev_env.loop.gains import Gains, controller_response
from maglev_env.rig.goal import Goal
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.campaign.carried import DRAWS, Carried
from tuning.campaign.recorded_sets import GainSet
from tuning.campaign.rig_fit import MASS, IdentifiedRig
from tuning.study.recommendation import DISPLACEMENT_SHARE, GAIN_MARGIN, PEAK_SENSITIVITY, PHASE_MARGIN
from tuning.study.study import experiments
from tuning.tuner import Trials

RIGS = 12  # of the posterior, on which large signals are simulated; the first is the best estimate
FEW = 8  # draws of the responses by which a search judges how sure margins are
LEVEL = (2.5, 97.5)  # percentiles of a 95 % interval
# Large-signal figures that recordings show, too, with the relative standard error of one recording.
SEEN = {"peak_displacement": 0.02, "current_rms": 0.005, "noise_current": 0.03}
EVENT_ERROR = 0.05  # relative standard deviation of what an event of the fitted rig shows from that of the true one
RESERVE = 0.05  # share by which a margin's bound misses its limit where a search halves the score


@dataclass(frozen=True)
class Value:
    """An estimate with its 95 % interval, SI."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """What gains reach.

    Attributes:
        gains: The gains.
        score: Under the task's goal.
        expected: Its mean over all draws.
        values: Quantities by name: the score, those of `match`, those of the goal.
        reason: Why these gains are not to be kept, or None.
        held: Whether the rotor levitates in all simulations.
        met: Share of the draws in which every requirement of the goal is met; None for `match`.
        missed: The requirements that the best estimate misses.
        unsure: Those that it meets, but the interval does not.
        response: |S| over frequency: (frequency, best, low, high), each (s,).
    """

    gains: Gains
    score: Value
    expected: float
    values: Mapping[str, Value]
    reason: str | None
    held: bool
    met: float | None = None
    missed: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()
    response: tuple[np.ndarray, ...] = ()

    @property
    def peak(self) -> Value:
        return self.values["peak_sensitivity"]


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
        ratios: Measured over simulated, of SEEN where it is known.
        mass: Relative standard deviation of the stated mass.
        probe: That of the stated gain of the probe.
    """

    task: Task
    corners: np.ndarray
    goal: Goal | None
    responses: Carried
    episodes: Sequence[Episode]
    recorded: Sequence[GainSet]
    ratios: Mapping[str, float] = field(default_factory=dict)
    mass: float = MASS
    probe: float = 0.0

    def gains(self, point: np.ndarray) -> Gains:
        return self.task.box.applied(self.task.rig.gains, self.task.box.gains(point))

    def point(self, gains: Gains) -> np.ndarray:
        return self.task.box.point(gains)

    def apart(self, gains: Gains) -> float:
        """log2 of the largest factor between the controller's response and the nearest recorded one."""
        return min(louder(s.gains, gains, self.task.rig.control_rate) for s in self.recorded) / np.log(2)


def louder(old: Gains, new: Gains, rate: float) -> float:
    """ln of the largest factor between two controllers' responses, at any frequency."""
    z = np.exp(2j * np.pi * np.geomspace(1e-5, 0.4, 60))
    one, other = (controller_response(g, z, 1 / rate) for g in (old, new))
    return float(np.abs(np.log(np.abs(other / one))).max())


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
    simulated = experiments(task, [episodes[0]] * len(points), points, [0] * len(points))
    ratios = {}
    for name in SEEN:
        pairs = [(_of(simulated, name)[i], _measured(s)[name]) for i, s in enumerate(good)]
        known = [np.log(m / v) for v, m in pairs if v > 0 and m > 0]
        if known:
            ratios[name] = float(np.exp(np.mean(known)))
    return Model(**{**vars(model), "ratios": ratios})


def predict(model: Model, gains: Gains, responses: Carried | None = None, seen: GainSet | None = None) -> Prediction:
    """What gains reach, by all recordings.

    Args:
        model: The rig.
        gains: The gains.
        responses: Instead of those of all recordings.
        seen: A recording at these gains, which shows some large signals itself.
    """
    point = model.point(gains)
    apart = 0.0 if seen else model.apart(gains)
    lanes = experiments(model.task, model.episodes, np.tile(point, (RIGS, 1)), [0] * RIGS)
    # What was recorded has levitated, whatever a model says.
    held = seen is not None or (not lanes.touchdown.any() and bool((_of(lanes, "pole_radius") < 1).all()))
    values = _linear(model, responses or model.responses, gains, apart, DRAWS)
    turn = np.arange(DRAWS) % RIGS  # the rig on which the large signals of a draw are simulated
    values |= _large(model, lanes, turn, seen)
    scores, by = _scored(model, values)
    quantities = {"score": scores, **values}
    ends = {name: _interval(v) for name, v in quantities.items()}
    # A score has a largest value, where its distribution ends at once: what lies above the percentile is part of it.
    ends["score"] = replace(ends["score"], high=float(scores.max()))
    s = np.abs((responses or model.responses).sensitivity(gains, apart))
    shape = (model.responses.injected, s[0], *np.percentile(s, LEVEL, axis=0))
    met, missed, unsure = None, (), ()
    if by:
        met = float(np.mean(np.all([v <= 0 for v in by.values()], axis=0)))
        missed = tuple(n for n, v in by.items() if v[0] > 0)
        unsure = tuple(n for n, v in by.items() if v[0] <= 0 and np.mean(v > 0) > 1 - LEVEL[1] / 100)
    return Prediction(
        gains,
        ends["score"],
        float(scores.mean()),
        ends,
        _reason(ends, held),
        held,
        met,
        missed,
        unsure,
        shape,
    )


def search_scores(model: Model, points: np.ndarray, limit: float) -> np.ndarray:
    """Scores (n,) of points (n, k) over a few draws, lower where margins are not surely kept.

    Args:
        model: The rig.
        points: The points.
        limit: Largest peak sensitivity.
    """
    n = len(points)
    lanes = experiments(model.task, [model.episodes[0]] * n, points, [0] * n)
    large = _large(model, lanes, np.arange(n), None, scatter=False)
    found = np.zeros(n)
    for i, point in enumerate(points):
        if lanes.touchdown[i] or not lanes.info[i].get("pole_radius", 1.0) < 1:
            continue
        gains = model.gains(point)
        values = _linear(model, model.responses, gains, model.apart(gains), FEW)
        sure = {
            "peak": np.max(values["peak_sensitivity"]) / limit,
            "phase": PHASE_MARGIN / np.nanmin(values["phase_margin"], initial=np.inf),
            "gain": GAIN_MARGIN / np.nanmin(values["gain_margin_high"], initial=np.inf),
        }
        drawn = values | {k: np.full(FEW, v[i]) for k, v in large.items()}
        misses_by = sum(max(0.0, float(np.log(v))) for v in sure.values())
        found[i] = _scored(model, drawn)[0].mean() / (1 + misses_by / RESERVE)
    return found


def _linear(model: Model, responses: Carried, gains: Gains, apart: float, draws: int) -> dict[str, np.ndarray]:
    """Margins, stiffness, damping and compliance (draws,) by the responses."""
    rig = model.task.rig
    s = responses.sensitivity(gains, apart, draws)
    m = margin_arrays(responses.injected, s)
    up, down = m["gain_margin_high"], 1 / m["gain_margin_low"]
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
        "gain_margin": np.fmin(up, down),
    }
    asked = {r.name: r for r in model.goal.measured} if model.goal else {}
    band = asked["compliance"].band if "compliance" in asked else (0.0, np.inf)
    found["compliance"] = np.abs(y[:, (f >= band[0]) & (f <= band[1])]).max(axis=1)
    return found


def _large(
    model: Model, lanes: Trials, turn: np.ndarray, seen: GainSet | None, scatter: bool = True
) -> dict[str, np.ndarray]:
    """What the experiment and the events show of large signals, for each draw that of its lane."""
    own = _measured(seen) if seen else {}
    found, rng = {}, np.random.default_rng(141421)

    def scattered(values: np.ndarray, error: float) -> np.ndarray:
        normal = scatter * rng.standard_normal(turn.size)
        normal[0] = 0.0
        return values * np.exp(error * normal)

    for name, error in SEEN.items():
        known = own.get(name, np.nan)
        values = np.full(turn.size, known) if known > 0 else _of(lanes, name)[turn] * model.ratios.get(name, 1.0)
        found[name] = scattered(values, error)
    found["displacement"] = found["peak_displacement"] / model.task.rig.clearance
    for one in model.goal.measured if model.goal else ():
        if one.quantity.event not in (None, "hover"):
            found[one.name] = scattered(_of(lanes, one.name, np.inf)[turn], EVENT_ERROR)
    return found


def _scored(model: Model, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Scores (draws,), and by how much each requirement of the goal is missed (`goal_score.misses`)."""
    if model.goal is None:
        names = ("stiffness", "damping", "peak_sensitivity", "peak_displacement", "current_rms")
        return score(terms(model.task.target, *(values[n] for n in names))), {}
    wanted = {r.name: values[r.name] for r in model.goal.measured}
    total = np.broadcast_to(goal_score(goal_terms(model.goal, wanted)), np.shape(next(iter(wanted.values()))))
    return np.asarray(total), {r.name: misses(r, values[r.name]) for r in model.goal.requirements}


def _interval(values: np.ndarray) -> Value:
    known = values[~np.isnan(values)]
    if not known.size:
        return Value(np.nan, np.nan, np.nan)
    low, high = np.percentile(known, LEVEL, method="closest_observation")
    return Value(float(values[0]), min(float(low), float(values[0])), max(float(high), float(values[0])))


def _reason(ends: Mapping[str, Value], held: bool) -> str | None:
    """Why gains are not to be kept, in words with figures."""
    if not held:
        return "the rotor does not levitate on every rig that the recordings allow"
    if not ends["peak_sensitivity"].high <= PEAK_SENSITIVITY:
        high = ends["peak_sensitivity"].high
        return f"peak sensitivity up to {high:.3g}, beyond zone B of ISO 14839-3 ({PEAK_SENSITIVITY:g})"
    if ends["displacement"].high > DISPLACEMENT_SHARE:
        return f"displacement up to {ends['displacement'].high:.0%} of the clearance under the excitation"
    for name, least, unit in (("phase_margin", PHASE_MARGIN, " degrees"), ("gain_margin_high", GAIN_MARGIN, "")):
        if ends[name].low < least:
            return f"{name.replace('_', ' ')} down to {ends[name].low:.3g}{unit}, below {least:g}{unit}"
    return None


def _measured(s: GainSet) -> dict[str, float]:
    return {"peak_displacement": s.peak_displacement, "current_rms": s.current_rms, "noise_current": s.noise_current}


def _of(lanes: Trials, name: str, unknown: float = np.nan) -> np.ndarray:
    """A figure (n,) of trials."""
    return np.array([one.get(name, one.get(f"required_{name}", unknown)) for one in lanes.info], float)
