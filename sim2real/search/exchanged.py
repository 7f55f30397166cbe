"""Effects that act alike: where one was found in a pair, the pair with another in its place is fitted, too."""

from collections.abc import Collection

from maglev_env.loop.effect import EFFECTS
from sim2real.search.hypotheses import RESONANCES

LAGS = ("delay", "amplifier_lag", "sensor_lag", "eddy_current")
SCALES = ("mass", "sensor_gain")  # without a force, and nearly with one, the motion is less in proportion
SPRINGS = ("negative_stiffness", "support_stiffness", "force_law")


def resembling(effects: Collection[str]) -> list[frozenset[str]]:
    """The same effects with one of them replaced by one that it is like, or that is like it."""
    pairs = [(name, card.like) for name, card in EFFECTS.items() if card.like]
    swaps = [*pairs, *((other, name) for name, other in pairs)]
    return [frozenset({*effects} - {old} | {new}) for old, new in swaps if old in effects and new not in effects]


def exchanged(effects: Collection[str]) -> list[frozenset[str]]:
    """As `resembling`, and with one of a group that acts alike in a narrow band replaced by another one of it."""
    found = resembling(effects)
    for group in (LAGS, RESONANCES, SCALES, SPRINGS):
        olds, news = [n for n in group if n in effects], [n for n in group if n not in effects]
        found += [frozenset({*effects} - {old} | {new}) for old in olds for new in news]
    return list(dict.fromkeys(found))
