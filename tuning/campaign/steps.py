"""One step of a campaign: calmer where margins are thin, farther where it is worth it, never stuck."""

from dataclasses import replace

import numpy as np

from maglev_env.loop.gains import PidGains
from tuning.campaign.advice import Advice, ranked, stopped
from tuning.campaign.candidates import Prediction, predict, search_scores
from tuning.campaign.carried import louder
from tuning.campaign.disagreement import diagnosing
from tuning.campaign.model import Model
from tuning.campaign.search import TRIED, nearby, optimum, peak_bounds
from tuning.study.recommendation import PEAK_SENSITIVITY

EARLY, AIM = 3, 3.0  # for the first gain sets, the peak sensitivity must stay in zone A of ISO 14839-3
LOUDER = 2.0  # largest factor by which one step may change the controller's response, at any frequency
SHARES = (1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1)  # shares of the way to the optimum that are tried, in this order
GAINED, CALMER = 0.01, 0.9  # least gain in score worth an experiment; factor on the peak of a loop beyond its limits
TOLD = 0.5  # of the larger standard deviation of the two scores, likewise: less is within what is not known
# Where the best recorded gains miss a limit by far their score is nearly zero, and so is all that one step can add to
# it: there a factor tells what a difference does not.
RISEN = 1.3
# What the best estimate must promise beyond what is known, so that a step is made to learn whether it is so, and the
# number of sets from which on the recordings have told.
HOPED, LEARNT = 0.03, 4
SURER = 0.2  # by which the probability that every requirement is met must rise, if the score may gain less than that
SAME = 1e-3  # of the box; gains closer than this count as equal
BETWEEN, PASSED = (0.25, 0.5, 0.75), 2.0  # shares of a step, and times the limit that its peak may reach on the way
REPEATED = 2  # recordings at one set; more of them hardly tell more
LOOKED, ALLOWED = 3, 3  # points nearby that are simulated, times TRIED, and the best of them that are looked at closely


def onward(advice: Advice, model: Model, seed: int, budget: int) -> Advice:
    """The farthest worthwhile step that is surely allowed; a calmer one, or the same again, where there is none."""
    best = ranked(advice)[0]
    goal = optimum(model, model.point(advice.sets[best].gains), _limit(advice, best), np.random.default_rng(seed))
    good = [i for i, p in enumerate(advice.claimed) if p]
    sound = [i for i in good if advice.claimed[i].reason is None] or good
    anchor = min(sound, key=lambda i: float(np.linalg.norm(model.point(advice.sets[i].gains) - goal)))
    origin = model.point(advice.sets[anchor].gains)
    limited, allowed = None, 0.0
    for share in SHARES:
        point = np.clip(origin + share * (goal - origin), *model.corners)
        prediction, why = _tried(advice, model, anchor, point)
        if why is None:
            if _worth(advice, model, best, prediction):
                return _climb(advice, best, prediction, share, limited)
            allowed = allowed or share
            # The search saw one rig. Where others that the recordings allow do worse, less of the way may be worth it.
            if not _more(prediction.score.value, advice.claimed[best].score.value):
                break
            why = f"a score of {prediction.score.value:.3f} is not sure enough: it may be {prediction.score.low:.3f}"
        limited = why
    share, thin = allowed, advice.claimed[best].reason
    around = nearby(model, model.point(advice.sets[best].gains), np.log(LOUDER), seed)
    if limited and thin is None and len(around):
        some = around[: LOOKED * TRIED]
        for point in some[np.argsort(-search_scores(model, some, _limit(advice, best)))[:ALLOWED]]:
            prediction, why = _tried(advice, model, best, point)
            if why is None and _worth(advice, model, best, prediction):
                return _climb(advice, best, prediction, 0.0, limited)
    if thin is None and (learnt := _learning(advice, model, best, seed)) is not None:
        return learnt
    if thin is not None and len(around):
        for point in around[np.argsort(peak_bounds(model, around))[:ALLOWED]]:
            prediction, why = _tried(advice, model, best, point)
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
    words = f"no gains that may be tried promise more than an experiment can tell over the best recorded ones{bound}"
    words += _out_of_reach(advice, model, best, goal)
    return stopped(advice, words, share=share, limited=limited)


def _learning(advice: Advice, model: Model, best: int, seed: int) -> Advice | None:
    """A safe step toward gains that promise much by the best estimate, though little is sure of them yet.

    What a first recording leaves open keeps the search away from the goal's limits; one nearer to them tells more.
    """
    known, origin = advice.claimed[best], model.point(advice.sets[best].gains)
    if sum(p is not None for p in advice.claimed) >= LEARNT:
        return None
    hoped = optimum(model, origin, _limit(advice, best), np.random.default_rng((seed, 1)), draws=1)
    promise = predict(model, model.gains(hoped)).score.value
    if promise - known.score.value < HOPED:
        return None
    for share in SHARES:
        prediction, why = _tried(advice, model, best, np.clip(origin + share * (hoped - origin), *model.corners))
        if why is not None or _near(advice, model, prediction.gains):
            continue
        if prediction.score.value - known.score.value < GAINED or prediction.expected < known.expected - known.spread:
            continue
        words = (
            f"they promise a score of {prediction.score.value:.3f} by the best estimate, and tell how sure the "
            f"{promise:.3f} are that it promises at most"
        )
        return replace(advice, next=prediction.gains, prediction=prediction, why=words, kind="climb", share=share)
    return None


def _out_of_reach(advice: Advice, model: Model, best: int, goal: np.ndarray) -> str:
    """What is to be said where the best recorded gains miss a requirement, and so do the best of the ranges (k,)."""
    if not advice.claimed[best].missed or not (missed := predict(model, model.gains(goal)).missed):
        return ""
    names = model.task.box.names
    ends = [n for n, v, low, high in zip(names, goal, *model.corners, strict=True) if min(v - low, high - v) < SAME]
    where = (
        f", with {' and '.join(ends)} at the end of its range: [bounds] of the rig may be too narrow" if ends else ""
    )
    return f"; the best gains that a search on the fitted rig finds miss {', '.join(missed)}, too{where}"


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
    known = advice.claimed[best]
    gained = prediction.expected - known.expected
    if known.met is not None and gained >= 0 and prediction.met - known.met >= SURER:
        return True
    doubt = TOLD * max(known.spread, prediction.spread)
    return known.reason is not None or (_more(prediction.expected, known.expected) and gained >= doubt)


def _more(score: float, known: float) -> bool:
    """Whether a score is so much above a known one that it is worth an experiment."""
    return score - known >= GAINED or score > RISEN * known


def _near(advice: Advice, model: Model, gains: PidGains) -> bool:
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


def asked_by_diagnosis(advice: Advice, model: Model, budget: int) -> Advice | None:
    """The recording that the diagnosis asks for; None where nothing is to be diagnosed, or it is not safe."""
    found = advice.diagnosis
    if found is None or not advice.identified.contradicted or advice.recordings + 1 >= budget:
        return None
    best = ranked(advice)[0]
    stated = diagnosing(found, advice.sets[best].gains, advice.task.rig.protocol, advice.sets)
    if stated is None:
        return None
    what, gains, excitations = stated
    prediction = predict(model, gains)
    if gains != advice.sets[best].gains and _unsafe(advice, model, best, prediction) is not None:
        return None
    words = f"the recordings contradict the model, and {what} tells which effect it is"
    own = None if excitations == advice.task.rig.protocol.excitations else excitations
    return replace(advice, next=gains, prediction=prediction, why=words, kind="diagnose", excitations=own)
