"""The next experiment on a real rig: calmer where margins are thin, then towards the best gains, never stuck."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from maglev_env.design.defaults import with_defaults
from maglev_env.evaluation.goal_score import in_words
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import TUNED, gain_box
from maglev_env.task.task import Task, make_task
from tuning.campaign.candidates import Model, Prediction, louder, model_of, predict, search_scores
from tuning.campaign.carried import carried
from tuning.campaign.disagreement import Disagreement, diagnosing
from tuning.campaign.recorded_sets import GainSet, Shown, shown
from tuning.campaign.rig_fit import IdentifiedRig, fit_rig
from tuning.campaign.search import TRIED, nearby, optimum, peak_bounds
from tuning.study.recommendation import PEAK_SENSITIVITY

EARLY, AIM = 3, 3.0  # for the first gain sets, the peak sensitivity must stay in zone A of ISO 14839-3
LOUDER = 2.0  # largest factor by which one step may change the controller's response, at any frequency
SHARES = (1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1)  # shares of the way to the optimum that are tried, in this order
GAINED, CALMER = 0.01, 0.9  # least gain in score worth an experiment; factor on the peak of a loop beyond its limits
SAME = 1e-3  # of the box; gains closer than this count as equal
BETWEEN, PASSED = (0.25, 0.5, 0.75), 2.0  # shares of a step, and times the limit that its peak may reach on the way
REPEATED = 2  # recordings at one set; more of them hardly tell more


@dataclass(frozen=True, eq=False)
class Advice:
    """What to record next, or why to stop.

    Attributes:
        task: The tuning task, with the goal.
        sets: The recorded gain sets.
        shown: What each set showed; None where it failed or tells nothing.
        claimed: What each set reaches, by its own recordings; None where it failed or tells nothing.
        identified: The identified rig; None before any set levitated.
        next: Gains to try next; None to stop.
        prediction: What they promise, unless they are the start.
        why: Why these gains.
        kind: "start", "climb", "calm", "repeat", "designed" or "diagnose"; "stop".
        excitations: Those of a diagnosing recording; None for those of the rig's protocol.
        diagnosis: What `maglev diagnose` says, where model and recordings disagree.
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
    claimed: tuple[Prediction | None, ...]
    identified: IdentifiedRig | None
    next: Gains | None = None
    prediction: Prediction | None = None
    why: str = ""
    kind: str = "stop"
    excitations: tuple[Excitation, ...] | None = None
    diagnosis: Disagreement | None = None
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
    rig: Rig,
    sets: Sequence[GainSet],
    tuned: Sequence[str] = TUNED,
    budget: int = 10,
    seed: int = 0,
    goal: str | None = None,
    diagnosis: Callable[[], Disagreement] | None = None,
) -> Advice:
    """Decide what to record next on a rig, or that it is time to stop.

    Args:
        rig: Nominal rig of one axis.
        sets: Recorded gain sets.
        tuned: Names of the tuned gains.
        budget: Number of recordings in all, except those with the role holdout.
        seed: Seed of every choice.
        goal: What gains are judged by, see `design.goals.with_goal`; None: the rig's own.
        diagnosis: Diagnoses the campaign, where its recordings contradict the model.

    Raises:
        ValueError: The rig has two axes or no controlled magnet, the sets differ in gains that are not tuned, or the
            goal is not understood.
    """
    task, corners = tuning_task(rig, sets, tuned, goal)
    good = [i for i, s in enumerate(sets) if s.failed is None]
    nothing: tuple[None, ...] = (None,) * len(sets)
    notes = tuple(f"{', '.join(s.files)}: {s.failed or s.untold}" for s in sets if s.failed or s.untold)
    if not good:
        failed = Advice(task, tuple(sets), nothing, nothing, None, notes=notes)
        if failed.recordings >= budget:
            return replace(failed, stop=f"the budget of {budget} recordings is used up, and none of them held")
        return _start(failed, with_defaults(rig).gains)
    if all(sets[i].untold for i in good):
        last = sets[good[-1]]
        untried = Advice(task, tuple(sets), nothing, nothing, None, notes=notes)
        return _designed(untried, last, last.untold or "", budget)
    held = [None if s.failed or s.untold else s for s in sets]
    told = [s for s in held if s]
    identified, found = fit_rig(task.rig, told), None
    if identified.contradicted and diagnosis:
        found = diagnosis()
        identified = _explained(task, told, identified, found)
    if identified.contradicted:
        notes = (
            f"the recordings contradict the rig's model: they miss it by {np.sqrt(identified.misfit):.0f} times what "
            "noise and 1 % of model error explain; gains are judged by the measured responses, and large signals "
            "(events, noise) by the nearest model"
            + (f". {found.sentence}" if found else "; `maglev diagnose` on this campaign says where and why"),
            *notes,
        )
    if identified.other_mass:
        notes = (
            f"the recordings look like those of another mass than the stated {task.rig.mass:.4g} kg, by more than its "
            "tolerance and that of the probe: weigh the rotor, and check the scales of force and displacement; gains "
            "are judged by the stated mass",
            *notes,
        )
    if task.layout.goal and task.layout.goal.rigs:
        notes = (f"worst of {task.layout.goal.rigs} rigs: judged on what the recordings leave of this one rig", *notes)
    model = model_of(task, corners, identified, carried(identified, told, seed), told, seed)
    seen = tuple(s and shown(s, task.rig.target.band, task.rig.mass, seed) for s in held)
    claimed = tuple(s and predict(model, s.gains, carried(identified, [s], seed), s) for s in held)
    advice = Advice(task, tuple(sets), seen, claimed, identified, diagnosis=found, notes=notes)
    if advice.recordings >= budget:
        return _stopped(advice, f"the budget of {budget} recordings is used up")
    if (asked := _diagnosing(advice, model, budget)) is not None:
        return asked
    return _onward(advice, model, seed, budget)


def tuning_task(
    rig: Rig, sets: Sequence[GainSet], tuned: Sequence[str], goal: str | None = None
) -> tuple[Task, np.ndarray]:
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
    task = make_task(rig, tuned, goal=goal)
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


def _designed(advice: Advice, held: GainSet, why: str, budget: int) -> Advice:
    """The rig's protocol at gains that held, where what was recorded without a period does not tell enough."""
    if advice.recordings >= budget:
        return replace(advice, stop=f"the budget of {budget} recordings is used up, and they tell no margins: {why}")
    words = (
        f"these gains held, but what was recorded at them does not tell how far one may go ({why}); record the "
        "designed excitation below at the same gains"
    )
    return replace(advice, next=held.gains, why=words, kind="designed")


def _start(advice: Advice, preset: Gains) -> Advice:
    if not advice.sets:
        return replace(advice, next=preset, kind="start", why="the rig's preset gains, from which tuning starts")
    if all(s.gains != preset for s in advice.sets):
        return replace(
            advice, next=preset, kind="start", why="nothing recorded so far held; these are the rig's preset gains"
        )
    return replace(
        advice,
        stop="nothing recorded so far held, the rig's preset gains among it: reduce the excitation, check scales and "
        "signs of the channels, and ask `maglev diagnose` how the rig differs from its model",
    )


def _explained(task: Task, told: Sequence[GainSet], identified: IdentifiedRig, found: Disagreement) -> IdentifiedRig:
    """The rig fitted anew with the effects that the diagnosis names, where the recordings then contradict it less."""
    if found.rig is None:
        return identified
    named = replace(found.rig, gains=task.rig.gains, target=task.rig.target, protocol=task.rig.protocol)
    again = fit_rig(named, told)
    return again if again.misfit < identified.misfit else identified


def _diagnosing(advice: Advice, model: Model, budget: int) -> Advice | None:
    """The recording that the diagnosis asks for; None where nothing is to be diagnosed, or it is not safe."""
    found = advice.diagnosis
    if found is None or not advice.identified.contradicted or advice.recordings + 1 >= budget:
        return None
    best = _ranked(advice)[0]
    stated = diagnosing(found, advice.sets[best].gains, advice.task.rig.protocol, advice.sets)
    if stated is None:
        return None
    gains, excitations = stated
    prediction = predict(model, gains)
    if gains != advice.sets[best].gains and _unsafe(advice, model, best, prediction) is not None:
        return None
    words = f"the recordings contradict the model, and {found.what} tells which effect it is"
    own = None if excitations == advice.task.rig.protocol.excitations else excitations
    return replace(advice, next=gains, prediction=prediction, why=words, kind="diagnose", excitations=own)


def _ranked(advice: Advice) -> list[int]:
    """Indices of the sets that held, the best first; those with thin margins follow the others."""
    good = [i for i, p in enumerate(advice.claimed) if p]
    return sorted(good, key=lambda i: (advice.claimed[i].reason is not None, -advice.claimed[i].expected))


def _stopped(advice: Advice, why: str, **changes: object) -> Advice:
    order = _ranked(advice)
    keep = order[0] if order and advice.claimed[order[0]].reason is None else None
    kept = -np.inf if keep is None else advice.claimed[keep].expected
    refused = tuple((i, p.reason) for i in order if (p := advice.claimed[i]).reason is not None and p.expected > kept)
    goal = advice.task.layout.goal
    if keep is not None and goal and (missed := advice.claimed[keep].missed):
        by_name = {r.name: in_words(r) for r in goal.requirements}
        why = f"{why}; not met: {', '.join(by_name[name] for name in missed)}"
    return replace(advice, stop=why, keep=keep, refused=refused, **changes)


def _onward(advice: Advice, model: Model, seed: int, budget: int) -> Advice:
    """The farthest worthwhile step that is surely allowed; a calmer one, or the same again, where there is none."""
    best = _ranked(advice)[0]
    goal, promised = optimum(
        model, model.point(advice.sets[best].gains), _limit(advice, best), np.random.default_rng(seed)
    )
    good = [i for i, p in enumerate(advice.claimed) if p]
    sound = [i for i in good if advice.claimed[i].reason is None] or good
    anchor = min(sound, key=lambda i: float(np.linalg.norm(model.point(advice.sets[i].gains) - goal)))
    origin = model.point(advice.sets[anchor].gains)
    limited = None
    for share in SHARES:
        point = np.clip(origin + share * (goal - origin), *model.corners)
        prediction, why = _tried(advice, model, anchor, point)
        if why is None:
            if _worth(advice, model, best, prediction):
                return _climb(advice, best, prediction, share, limited)
            break
        limited = why
    else:
        share = 0.0
    thin = advice.claimed[best].reason
    around = nearby(model, model.point(advice.sets[best].gains), np.log(LOUDER), seed)
    if share == 0.0 and thin is None and len(around):
        scores = search_scores(model, around[:: max(1, len(around) // (3 * TRIED))], _limit(advice, best))
        for i in np.argsort(-scores)[:3]:
            point = around[:: max(1, len(around) // (3 * TRIED))][i]
            prediction, why = _tried(advice, model, best, point)
            if why is None and _worth(advice, model, best, prediction):
                return _climb(advice, best, prediction, 0.0, limited)
    if thin is not None and len(around):
        for i in np.argsort(peak_bounds(model, around))[:3]:
            prediction, why = _tried(advice, model, best, around[i])
            if why is None and not _near(advice, model, prediction.gains):
                words = f"the best recorded gains are not to be kept ({thin}); these calm the loop first"
                return replace(advice, next=prediction.gains, prediction=prediction, why=words, kind="calm")
    if (
        (thin is not None or share == 0.0)
        and len(advice.sets[best].files) < REPEATED
        and advice.recordings + 1 < budget
    ):
        words = "the same gains again: what was recorded leaves too wide a range to go on or to keep them"
        same = advice.sets[best].gains
        return replace(
            advice, next=same, prediction=advice.claimed[best], why=words, kind="repeat", share=0.0, limited=limited
        )
    bound = f"; farther on, {limited}" if limited else ""
    words = (
        f"no gains that may be tried promise more than an experiment can tell ({GAINED:g} in score) over the best "
        f"recorded ones, {promised - advice.claimed[best].expected:+.3f} on the way to the optimum{bound}"
    )
    return _stopped(advice, words, share=share, limited=limited)


def _climb(advice: Advice, best: int, prediction: Prediction, share: float, limited: str | None) -> Advice:
    gained = prediction.expected - advice.claimed[best].expected
    words = f"they promise a score of {prediction.score.value:.3f}, {gained:+.3f} over the best so far"
    return replace(
        advice, next=prediction.gains, prediction=prediction, why=words, kind="climb", share=share, limited=limited
    )


def _worth(advice: Advice, model: Model, best: int, prediction: Prediction) -> bool:
    """Whether gains promise so much more than the best recorded ones that an experiment can tell."""
    if _near(advice, model, prediction.gains):
        return False
    return advice.claimed[best].reason is not None or prediction.expected - advice.claimed[best].expected >= GAINED


def _near(advice: Advice, model: Model, gains: Gains) -> bool:
    point = model.point(gains)
    return min(float(np.linalg.norm(model.point(s.gains) - point)) for s in advice.sets) < SAME


def _tried(advice: Advice, model: Model, anchor: int, point: np.ndarray) -> tuple[Prediction | None, str | None]:
    """What a point promises, and why it must not be tried, or None."""
    gains = model.gains(point)
    if (why := _beyond(advice, model, anchor, point)) is not None:
        return None, why
    prediction = predict(model, gains)
    return prediction, _unsafe(advice, model, anchor, prediction)


def _beyond(advice: Advice, model: Model, anchor: int, point: np.ndarray) -> str | None:
    """Why a point is too far from gains that levitated, whatever a model predicts."""
    apart = [float(np.linalg.norm(model.point(s.gains) - point)) for s in advice.sets]
    nearest = int(np.argmin(apart))
    if advice.sets[nearest].failed:
        return f"the gains come nearer to those of {advice.sets[nearest].files[0]}, which failed, than to any that held"
    change = float(np.exp(louder(advice.sets[anchor].gains, model.gains(point), model.task.rig.control_rate)))
    if change > LOUDER * (1 + 1e-9):
        return f"the controller would change {change:.2g}-fold at once, more than {LOUDER:g}-fold"
    return None


def _limit(advice: Advice, anchor: int) -> float:
    """Largest peak sensitivity that a step may reach."""
    early = sum(p is not None for p in advice.claimed) < EARLY
    # Where the loop is certainly beyond the aim already, a step must at least not make it worse.
    low = float(np.nan_to_num(advice.claimed[anchor].peak.low))
    return float(np.clip(low, AIM, PEAK_SENSITIVITY)) if early else PEAK_SENSITIVITY


def _unsafe(advice: Advice, model: Model, anchor: int, prediction: Prediction) -> str | None:
    """Why gains must not be tried: peak sensitivity or margins that may exceed their limits, touchdown, instability."""
    known, high = advice.claimed[anchor], prediction.peak.high
    origin, point = model.point(advice.sets[anchor].gains), model.point(prediction.gains)
    # A loop that is stable at recorded gains stays so on a way along which its peak remains finite.
    way = peak_bounds(model, np.array([origin + share * (point - origin) for share in BETWEEN]))
    if way.max() > PASSED * max(PEAK_SENSITIVITY, known.peak.high):
        return f"on the way there the peak sensitivity may reach {way.max():.3g}"
    if known.reason is not None and prediction.held and high <= CALMER * known.peak.high:
        return None  # the loop is already beyond its limits, and these gains calm it
    if prediction.reason is not None:
        return prediction.reason
    limit = _limit(advice, anchor)
    return f"the peak sensitivity may reach {high:.3g}, above {limit:.3g}" if high > limit else None
