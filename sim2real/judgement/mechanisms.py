"""Which effects are one mechanism on a rig, and so have one name."""

from collections.abc import Sequence
from dataclasses import replace

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.judgement.judge import Entry

# A single magnet pulls with one law of current and gap. A stiffness that is off beside its gain is another such law;
# of opposed magnets the two are told apart by what a bias, or a permanent magnet, makes of the stiffness alone.
OF_ONE_MAGNET = {"negative_stiffness": "force_law"}


def by_mechanism(found: Sequence[Entry], rig: Rig) -> list[Entry]:
    """Hypotheses by the names of their mechanisms, the most probable first.

    Of hypotheses that become the same the most probable one stays, with the probability of all of them.

    Args:
        found: hypotheses, the most probable first.
        rig: the nominal rig.
    """
    if not rig.controlled or not isinstance(force_law(axis_rig(rig, 0)), SingleSidedLaw):
        return list(found)
    kept: dict[frozenset[str], Entry] = {}
    for e in found:
        names = tuple(dict.fromkeys(OF_ONE_MAGNET.get(name, name) for name in e.effects))
        first = kept.get(key := frozenset(names))
        kept[key] = (
            replace(e, effects=names)
            if first is None
            else replace(first, probability=first.probability + e.probability)
        )
    return sorted(kept.values(), key=lambda e: -e.probability)


def renamed(entry: Entry, effects: Sequence[str]) -> str | None:
    """A sentence where a fitted hypothesis with these effects has the name of their mechanism; else None."""
    other = [name for name in effects if name not in entry.effects and name in OF_ONE_MAGNET]
    if not other:
        return None
    return (
        f"below a single magnet, {other[0]} beside its gain is another {OF_ONE_MAGNET[other[0]]} (its exponent, or an "
        f"offset of its gap), and has that name; it is simulated as a change of {other[0]}"
    )
