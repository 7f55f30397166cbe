"""What is said of an effect that explains as much as what is named, but without the limit that tells it from others.

And of one that could not be asked.
"""

from collections.abc import Collection

from maglev_env.loop.effect import EFFECTS, NEEDS
from maglev_env.rig.rig import Rig
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.meaning.within_reach import LIMITS


def without_limit_in_words(evidence: Evidence, named: Collection[int]) -> list[str]:
    """A sentence for each effect that explains as much as what is named, but without its limit.

    Args:
        evidence: What was weighed.
        named: Indices of the candidates that are named.
    """
    if evidence.refused is None or not named:
        return []
    most = min(evidence.cost[i] for i in named)
    alike = [names[0] for names, cost in zip(evidence.effects, evidence.refused, strict=True) if cost <= most]
    return [
        f"{name} would explain as much, but as {LIMITS[name].without}: no recording shows the limit that tells it from "
        "others, so it is not named; record larger motion"
        for name in alike
        if name in LIMITS
    ]


def not_asked_in_words(rig: Rig) -> list[str]:
    """A sentence for each effect of the coil on a rig whose file does not state its inductance, though it has one."""
    return [
        f"{name} was not asked, because it needs {NEEDS['coil']}, which the rig's file does not state"
        for name, card in EFFECTS.items()
        if not card.not_fitted and set(card.needs) - rig.capabilities == {"coil"}
    ]
