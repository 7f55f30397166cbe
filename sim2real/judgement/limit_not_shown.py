"""What is said of an effect that explains as much as what is named, but without the limit that tells it from others."""

from collections.abc import Collection

from sim2real.judgement.evidence import Evidence
from sim2real.judgement.within_reach import LIMITS


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
