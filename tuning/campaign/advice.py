"""What to record next on a real rig, or why to stop."""

from dataclasses import dataclass, replace

import numpy as np

from maglev_env.evaluation.goal_score import in_words, scale_in_words
from maglev_env.loop.gains import PidGains
from maglev_env.rig.excitation import Excitation
from maglev_env.task.task import Task
from tuning.campaign.candidates import Prediction
from tuning.campaign.disagreement import Disagreement
from tuning.campaign.gain_set import GainSet, Shown
from tuning.campaign.rig_fit import IdentifiedRig


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
    next: PidGains | None = None
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
        """Number of the recordings that are used; one that was left out does not count."""
        return sum(len(s.files) for s in self.sets)


def ranked(advice: Advice) -> list[int]:
    """Indices of the sets that held, the best first; those with thin margins follow the others."""
    good = [i for i, p in enumerate(advice.claimed) if p]
    return sorted(good, key=lambda i: (advice.claimed[i].reason is not None, -advice.claimed[i].expected))


def stopped(advice: Advice, why: str, **changes: object) -> Advice:
    order = ranked(advice)
    keep = order[0] if order and advice.claimed[order[0]].reason is None else None
    kept = -np.inf if keep is None else advice.claimed[keep].expected
    refused = tuple((i, p.reason) for i in order if (p := advice.claimed[i]).reason is not None and p.expected > kept)
    goal = advice.task.layout.goal
    if keep is not None and goal and (missed := advice.claimed[keep].missed):
        by_name = {r.name: in_words(r) for r in goal.requirements}
        why = f"{why}; not met: {', '.join(by_name[name] for name in missed)}"
    if keep is not None and goal and goal.best:
        words = scale_in_words(goal, advice.claimed[keep].values[goal.best.name].value)
        advice = replace(advice, notes=(*advice.notes, words)) if words else advice
    return replace(advice, stop=why, keep=keep, refused=refused, **changes)
