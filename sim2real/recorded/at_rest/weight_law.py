"""The force law that carries a weight: fitted to levels of displacement and current, and balanced over a motion."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw, force, linearise
from maglev_env.rig.rig import Rig
from sim2real.recorded.along_motion import NEAREST
from sim2real.recorded.at_rest.levels import Levels

TINY = 1e-9  # of the weight: least scatter of the pull
BALANCED = 1e-4  # of the bias current: step of its slope in the search for what carries the weight
NEWTON = 5  # steps of that search; the pull is linear or quadratic in the current
LACKING = 0.05  # of the bias current: a mean that lacks more is said; that much a pull off by a tenth makes


def departures(law: SingleSidedLaw, levels: Levels, several: bool, drift: float) -> np.ndarray:
    """Currents (n,) beyond those at which the fitted law carries the weight, A."""
    own, factor, _ = _law(law, levels, several, drift)
    y, i = levels.displacement, levels.current
    step = 1e-5 * max(abs(law.bias_current), 1e-9)
    pulls = [factor * (force(own, y, at) + law.weight) for at in (i, i + step, i - step)]
    return (pulls[0] - law.weight) / ((pulls[1] - pulls[2]) / (2 * step))


def fitted(law: SingleSidedLaw, levels: Levels, several: bool, drift: float = 0.0) -> np.ndarray:
    """Actuator gain (N/A) and, with several levels, stiffness (N/m) at the centre."""
    own, factor, offset = _law(law, levels, several, drift)
    start = float(np.mean(levels.current - offset))
    found = balanced(law, lambda at, i: factor * (force(own, at, i) + law.weight), law.weight, start)
    return found[: 1 + several]


def _law(law: SingleSidedLaw, levels: Levels, several: bool, drift: float) -> tuple[SingleSidedLaw, float, np.ndarray]:
    """The law of the fitted gap, the factor on its whole pull, and the offset of each level's current (n,), A."""
    same = np.zeros(levels.count, int)
    p, left = _solved(law, levels, several, same, 0.0, 1.0)
    if drift:
        _, of_recording = np.unique(levels.recording, return_inverse=True)
        count = of_recording.max() + 1
        within = sum(left[of_recording == n].var() * (of_recording == n).sum() for n in range(count))
        scatter = max(float(np.sqrt(within / max(left.size - count, 1))), TINY)
        p, _ = _solved(law, levels, several, of_recording, drift, scatter)
        return _stretched(law, p, several), float(np.exp(p[0])), drift * p[1 + several :][of_recording]
    return _stretched(law, p, several), float(np.exp(p[0])), np.zeros(levels.count)


def _solved(
    law: SingleSidedLaw, levels: Levels, several: bool, of_recording: np.ndarray, drift: float, scatter: float
) -> tuple[np.ndarray, np.ndarray]:
    """Least squares for ln of the factor, relative change of the gap and, with a drift, offsets in units of it.

    Args:
        law: nominal.
        levels: of all recordings.
        several: whether the gap is fitted.
        of_recording: (n,), number of the recording of each level, from 0.
        drift: standard deviation of the offsets, A; 0 for none.
        scatter: standard deviation of a level's pull over the weight.

    Returns:
        The parameters, and what they leave of each pull over the weight (n,).
    """
    y, i = levels.displacement, levels.current

    def left(p: np.ndarray) -> np.ndarray:
        own = i - drift * p[1 + several :][of_recording] if drift else i
        return np.exp(p[0]) * (force(_stretched(law, p, several), y, own) + law.weight) / law.weight - 1

    start = np.zeros(1 + several + (of_recording.max() + 1 if drift else 0))
    start[0] = np.log(law.weight / float(np.mean(force(law, y, i) + law.weight)))
    p = least_squares(lambda p: np.append(left(p) / scatter, p[1 + several :] if drift else []), start, x_scale=0.1).x
    return p, left(p)


def _stretched(law: SingleSidedLaw, p: np.ndarray, several: bool) -> SingleSidedLaw:
    """The law with the fitted gap; the gap of an exponential decay only scales the pull, so its length is fitted."""
    if not several:
        return law
    return replace(law, decay=law.decay * (1 + p[1])) if law.decay else replace(law, gap=law.gap * (1 + p[1]))


def balanced(
    law: SingleSidedLaw, pull: Callable[[float, float], np.ndarray | float], weight: float, start: float
) -> np.ndarray:
    """Actuator gain (N/A) and stiffness (N/m) at the centre, (2,), with the current that carries a weight there.

    Args:
        law: gives the sizes of the differences.
        pull: N at a displacement (m) and control current (A); it grows with the current.
        weight: N.
        start: current from which Newton's steps go, A.
    """
    di, dy, current = 1e-5 * max(abs(law.bias_current), 1e-9), 1e-5 * law.gap, start

    def gain(at: float) -> float:
        return float((pull(0.0, at + di) - pull(0.0, at - di)) / (2 * di))

    for _ in range(50):
        current -= (float(pull(0.0, current)) - weight) / gain(current)
    return np.array([gain(current), -float(pull(dy, current) - pull(-dy, current)) / (2 * dy)])


def balancing(rig: Rig, current: np.ndarray, displacement: np.ndarray) -> float:
    """What a current (1, samples) lacks, A, so that the nominal magnet carries the weight on average over the motion.

    What a mean says of a suspended mass is evidence of its own (`static_evidence`). Here the weight of a rig whose
    gain is not the nominal one would only pull the simulated mass off its place, up to touching down. The pull is that
    of the force law along the recorded motion: its curvature moves the mean of a large motion to where gain and
    stiffness are others by some percent.
    """
    law = force_law(rig)
    gain, stiffness = linearise(law)
    place = np.clip(displacement, -NEAREST * rig.gap, NEAREST * rig.gap)
    lacks = float(stiffness / gain * displacement.mean() - current.mean())
    step = BALANCED * max(abs(law.bias_current), float(np.ptp(current)))
    for _ in range(NEWTON):
        pull, less, more = (float(np.mean(force(law, place, current + lacks + by))) for by in (0.0, -step, step))
        if more == less:
            break
        lacks -= pull * 2 * step / (more - less)
    return lacks


def lacking_in_words(rig: Rig, channel: str, lacks: float) -> str | None:
    """What a mean current lacks (A, see `balancing`), as a clause; None where that is little.

    It is not evidence as long as nobody states how well the offsets of the channels are known.
    """
    share = lacks / abs(force_law(rig).bias_current)
    if abs(share) < LACKING:
        return None
    return (
        f"the mean {channel} is {abs(lacks):.3g} A ({abs(share):.0%} of the bias) {'below' if lacks > 0 else 'above'} "
        "what the nominal magnet needs to carry the weight"
    )
