"""The next experiment on a real rig: towards the best gains of the identified rig, as far as its margins allow."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from maglev_env.design.defaults import with_defaults
from maglev_env.loop.gains import Gains, controller_response
from maglev_env.rig.goal import MATCH
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import TUNED, gain_box
from maglev_env.task.task import Task, make_task
from tuning.campaign.candidates import Model, Prediction, model_of, optimum, predict
from tuning.campaign.recorded_sets import GainSet, Shown, shown
from tuning.campaign.rig_fit import IdentifiedRig, fit_rig
from tuning.study.recommendation import GAIN_MARGIN, PEAK_SENSITIVITY, PHASE_MARGIN

EARLY, AIM = 3, 3.0  # for the first gain sets, the peak sensitivity must stay in zone A of ISO 14839-3
LOUDER = 2.0  # largest factor by which one step may change the controller's response, at any frequency
SHARES = (1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1)  # shares of the way to the optimum that are tried, in this order
GAINED, CALMER = 0.01, 0.9  # least gain in score worth an experiment; factor on the peak of a loop beyond its limits
SAME = 1e-3  # of the box; gains closer than this count as equal


@dataclass(frozen=True, eq=False)
class Advice:
    """What to record next, or why to stop.

    Attributes:
        task: The tuning task.
        sets: The recorded gain sets.
        shown: What each set showed; None where it failed or tells nothing.
        predicted: Its prediction; None where it failed or tells nothing.
        identified: The identified rig; None before any set levitated.
        next: Gains to try next; None to stop.
        prediction: Their prediction, unless they are the start.
        why: Why these gains.
        share: Share of the way to the optimum.
        limited: What limited that share.
        stop: Why to stop.
        keep: Index of the set to keep; None where none holds up.
        refused: (index, reason) of better sets that are not kept.
        notes: What else to know.
    """

    task: Task
    sets: tuple[GainSet, ...]
    shown: tuple[Shown | None, ...]
    predicted: tuple[Prediction | None, ...]
    identified: IdentifiedRig | None
    next: Gains | None = None
    prediction: Prediction | None = None
    why: str = ""
    share: float = 1.0
    limited: str | None = None
    stop: str | None = None
    keep: int | None = None
    refused: tuple[tuple[int, str], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def recordings(self) -> int:
        return sum(len(s.files) for s in self.sets)


def next_step(
    rig: Rig, sets: Sequence[GainSet], tuned: Sequence[str] = TUNED, budget: int = 10, seed: int = 0
) -> Advice:
    """Decide what to record next on a rig, or that it is time to stop.

    Args:
        rig: Nominal rig of one axis.
        sets: Recorded gain sets.
        tuned: Names of the tuned gains.
        budget: Number of recordings in all, except those with the role holdout.
        seed: Seed of every choice.

    Raises:
        ValueError: The rig has two axes or no controlled magnet, or the sets differ in gains that are not tuned.
    """
    task, corners = tuning_task(rig, sets, tuned)
    good = [i for i, s in enumerate(sets) if s.failed is None]
    nothing: tuple[None, ...] = (None,) * len(sets)
    notes = tuple(f"{', '.join(s.files)}: {s.failed or s.untold}" for s in sets if s.failed or s.untold)
    if rig.target.goal != MATCH:
        notes = ("the rig's goal needs more than recordings show: gains are judged by the goal match", *notes)
    if not good:
        failed = Advice(task, tuple(sets), nothing, nothing, None, notes=notes)
        if failed.recordings >= budget:
            return replace(failed, stop=f"the budget of {budget} recordings is used up, and none of them held")
        return _start(failed, with_defaults(rig).gains)
    if all(sets[i].untold for i in good):
        last = sets[good[-1]]
        untried = Advice(task, tuple(sets), nothing, nothing, None, notes=notes)
        return _designed(untried, last, last.untold or "", budget)
    identified = fit_rig(task.rig, [sets[i] for i in good if not sets[i].untold])
    best = identified.rig()
    held = _held(sets)
    seen = tuple(s and shown(s, task.target, task.rig.target.band, best.mass, seed) for s in held)
    rng = np.random.default_rng(seed)
    model = model_of(task, corners, identified, [s for s in held if s], rng)
    predicted = tuple(s and predict(model, s.gains, seed) for s in held)
    advice = Advice(task, tuple(sets), seen, predicted, identified, notes=notes)
    if identified.contradicted:
        return _stopped(
            advice,
            f"the recordings contradict the rig's model: they miss it by {np.sqrt(identified.misfit):.0f} times what "
            "noise and 1 % of model error explain; `maglev diagnose` on this campaign says where and why",
        )
    if advice.recordings >= budget:
        return _stopped(advice, f"the budget of {budget} recordings is used up")
    found = _toward(advice, model, optimum(model, sets[_ranked(advice)[0]].gains, rng), seed)
    if found.stop and found.share == 0.0 and all(s.open for s in held if s):
        return _designed(advice, sets[_ranked(advice)[0]], f"no step is surely allowed: {found.limited}", budget)
    return found


def tuning_task(rig: Rig, sets: Sequence[GainSet], tuned: Sequence[str]) -> tuple[Task, np.ndarray]:
    """The task of a campaign, its box wide enough for what was recorded, and the ends of the asked box as actions.

    Raises:
        ValueError: As `next_step`.
    """
    if rig.axes != 1:
        raise ValueError(
            f"rig {rig.name} has two axes: a campaign is tuned one axis at a time; record one axis with a rig TOML of "
            "axes = 1"
        )
    if rig.gains is not None and not isinstance(rig.gains, Gains):
        raise ValueError(f"rig {rig.name}: a campaign is tuned in plain PID gains, and its [gains] are of another form")
    task = make_task(rig, tuned, goal=MATCH)
    if not sets:
        return task, np.array([[-1.0], [1.0]])
    box, first = task.box, sets[0]
    for name, value in asdict(first.gains).items():
        other = next((s for s in sets if getattr(s.gains, name) != value), None)
        if other is not None and name not in box.names:
            raise ValueError(
                f"{first.files[0]} was recorded at {name} = {value:g}, {other.files[0]} at "
                f"{getattr(other.gains, name):g}: tune it too (--tune {name}), or leave one of them out"
            )
    tried = np.array([[getattr(s.gains, name) for name in box.names] for s in sets])
    ends = zip(np.minimum(box.low, tried.min(axis=0)), np.maximum(box.high, tried.max(axis=0)), strict=True)
    wide = gain_box(task.rig, box.names, dict(zip(box.names, ends, strict=True)))
    task = replace(task, rig=replace(task.rig, gains=first.gains), box=wide)
    return task, wide.actions(np.array([box.low, box.high]))


def _held(sets: Sequence[GainSet]) -> list[GainSet | None]:
    """The sets that held and whose recordings tell something."""
    return [None if s.failed or s.untold else s for s in sets]


def _designed(advice: Advice, held: GainSet, why: str, budget: int) -> Advice:
    """The rig's protocol at gains that held, where what was recorded without a period does not tell enough."""
    if advice.recordings >= budget:
        return replace(advice, stop=f"the budget of {budget} recordings is used up, and they tell no margins: {why}")
    words = (
        f"these gains held, but what was recorded at them does not tell how far one may go ({why}); record the "
        "designed excitation below at the same gains"
    )
    return replace(advice, next=held.gains, why=words)


def _start(advice: Advice, preset: Gains) -> Advice:
    if not advice.sets:
        return replace(advice, next=preset, why="the rig's preset gains, from which tuning starts")
    if all(s.gains != preset for s in advice.sets):
        return replace(advice, next=preset, why="nothing recorded so far held; these are the rig's preset gains")
    return replace(
        advice,
        stop="nothing recorded so far held, the rig's preset gains among it: reduce the excitation, check scales and "
        "signs of the channels, and ask `maglev diagnose` how the rig differs from its model",
    )


def _rating(advice: Advice, i: int) -> float:
    """Measured score of a set or, where its recordings do not determine it, its score on the identified rig."""
    measured = advice.shown[i].score
    return measured if np.isfinite(measured) else advice.predicted[i].verdict.score


def _ranked(advice: Advice) -> list[int]:
    good = [i for i, p in enumerate(advice.predicted) if p]
    return sorted(good, key=lambda i: -_rating(advice, i))


def _doubt(advice: Advice, i: int) -> str | None:
    """Why a recorded set is not to be kept."""
    seen = advice.shown[i]
    if seen.margins is not None and seen.peak_bound > PEAK_SENSITIVITY:
        return f"its measured peak sensitivity is up to {seen.peak_bound:.3g}, beyond zone B of ISO 14839-3"
    return None if advice.identified.contradicted else advice.predicted[i].verdict.reason


def _stopped(advice: Advice, why: str, **changes: object) -> Advice:
    refused = []
    for i in _ranked(advice):
        reason = _doubt(advice, i)
        if reason is None:
            return replace(advice, stop=why, keep=i, refused=tuple(refused), **changes)
        refused.append((i, reason))
    return replace(advice, stop=why, refused=tuple(refused), **changes)


def _toward(advice: Advice, model: Model, goal: np.ndarray, seed: int) -> Advice:
    """The farthest worthwhile step towards the goal, from the nearest set that levitated, that is certainly allowed."""
    best = _ranked(advice)[0]
    good = [i for i, p in enumerate(advice.predicted) if p]
    sound = [i for i in good if _doubt(advice, i) is None] or good
    anchor = min(sound, key=lambda i: np.linalg.norm(model.point(advice.sets[i].gains) - goal))
    origin = model.point(advice.sets[anchor].gains)
    worth = max(GAINED, float(np.nan_to_num(advice.shown[best].score_se)))
    limited = None
    for share in SHARES:
        point = np.clip(origin + share * (goal - origin), *model.corners)
        gains = model.gains(point)
        if (why := _beyond(advice, model, anchor, point)) is None:
            prediction = predict(model, gains, seed)
            why = _unsafe(advice, prediction, advice.predicted[anchor])
        if why is not None:
            limited = why
            continue
        gained = prediction.verdict.score - advice.predicted[best].verdict.score
        near = min(np.linalg.norm(model.point(advice.sets[i].gains) - point) for i in good) < SAME
        if near or (gained < worth and _doubt(advice, best) is None):
            bound = "" if limited is None else f"; farther on, {limited}"
            words = (
                f"the best gains that may be tried promise {gained:+.3f} in score over the best recorded ones, no more "
                f"than an experiment can tell ({worth:.3f}){bound}"
            )
            return _stopped(advice, words, share=share, limited=limited)
        words = f"on the identified rig they score {prediction.verdict.score:.3f}, {gained:+.3f} over the best so far"
        return replace(advice, next=gains, prediction=prediction, why=words, share=share, limited=limited)
    return _stopped(advice, f"no step toward the optimum is surely allowed: {limited}", share=0.0, limited=limited)


def _beyond(advice: Advice, model: Model, anchor: int, point: np.ndarray) -> str | None:
    """Why a point is too far from gains that levitated, whatever a model predicts."""
    apart = [float(np.linalg.norm(model.point(s.gains) - point)) for s in advice.sets]
    nearest = int(np.argmin(apart))
    if advice.sets[nearest].failed:
        return f"the gains come nearer to those of {advice.sets[nearest].files[0]}, which failed, than to any that held"
    frequency = np.geomspace(1e-5, 0.4, 60)
    old, new = (
        controller_response(g, np.exp(2j * np.pi * frequency), 1 / model.task.rig.control_rate)
        for g in (advice.sets[anchor].gains, model.gains(point))
    )
    change = float(np.exp(np.abs(np.log(np.abs(new / old))).max()))
    if change > LOUDER * (1 + 1e-9):
        return f"the controller would change {change:.2g}-fold at once, more than {LOUDER:g}-fold"
    return None


def _unsafe(advice: Advice, prediction: Prediction, anchor: Prediction) -> str | None:
    """Why gains must not be tried: peak sensitivity or margins that may exceed their limits, touchdown, instability."""
    high = prediction.peak[1]
    if anchor.verdict.reason is not None and prediction.held and high <= CALMER * anchor.peak[1]:
        return None  # the loop is already beyond its limits, and these gains calm it
    if prediction.verdict.reason is not None:
        return prediction.verdict.reason
    early = sum(p is not None for p in advice.predicted) < EARLY
    # Where the loop is certainly beyond the aim already, a step must at least not make it worse.
    limit = float(np.clip(np.nan_to_num(anchor.peak[0]), AIM, PEAK_SENSITIVITY)) if early else PEAK_SENSITIVITY
    if high > limit:
        return f"the peak sensitivity may reach {high:.3g}, above {limit:.3g}"
    if prediction.margins is not None:
        for name, least in (("phase_margin", PHASE_MARGIN), ("gain_margin_high", GAIN_MARGIN)):
            low = prediction.margins.intervals[name][0]
            if low is not None and low < least:
                return f"on the plant as measured the {name.replace('_', ' ')} may fall to {low:.3g}, below {least:g}"
    return None
