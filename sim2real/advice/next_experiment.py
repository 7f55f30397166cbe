"""What to measure next: up to three recordings of a menu that together separate what is left, for the least effort."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from sim2real.advice.made_already import made_already
from sim2real.advice.proposal import Choice, Plan, Proposal
from sim2real.advice.recording_menu import Item, menu
from sim2real.advice.separation import Differences, differences, longer, separation
from sim2real.advice.slower_rotation import slower
from sim2real.compared.problem import Part
from sim2real.compared.reached import moved
from sim2real.gap.locate import Where
from sim2real.judgement.judge import Entry
from sim2real.judgement.tones.sightings import Sighting
from sim2real.judgement.verdict import CLASS_SHARE, alternatives, with_effects
from sim2real.recorded.open_record import OpenRecord, most_samples
from sim2real.recorded.records import Record
from sim2real.search.candidates import Attribution
from sim2real.search.fit import Fit
from sim2real.search.fitting import differentiate

REMAINING = 4  # candidates to be separated
SEPARATED = 4.7  # cost between two candidates below which they count as alike (a likelihood ratio of about ten)
ENOUGH = 25.0  # separation above which more effort is not worthwhile
MOST = 3  # recordings that are asked for at once
LENGTHS = {1: 0.0, 4: 0.5, 16: 1.0}  # times as long -> what that adds to the effort of a recording
LONGEST = 300.0  # s that a longer recording with a period may last
WORTHWHILE = 1.0  # separation that a further recording must add
TURNING = {"runout", "unbalance"}  # alike at one speed of rotation
BEFORE_FORCE = {"controller", "amplifier"}  # blocks that do not know where the rotor is
Separation = tuple[float, tuple[Fit, ...]]  # the least of any two candidates, and these two
Told = Callable[[Sequence[int], int], Separation]  # of recordings of the menu together that last so many times as long
# What the kind of a change shows of a cause that is unknown; of two that tell as much, the first one is asked for.
SHOWS = {
    "channels": "shows whether it acts before the current or behind it",
    "amplitude": "what is linear stays as it is, a limit, a law or a dead band does not",
    "offset": "shows whether it depends on where the rotor is",
    "gains": "shows whether it depends on the loop",
    "excitation": "shows how it goes with the frequency",
}


def propose(
    attribution: Attribution, found: Sequence[Entry], seen: Sequence[Sighting], unknown: Where | None = None
) -> Plan | None:
    """The recordings that decide best what is left; None where nothing is left to decide, or nothing decides it.

    Args:
        attribution: The candidates, fitted.
        found: All hypotheses with their probabilities.
        seen: The tones that were seen.
        unknown: Where the gap lies, if nothing of the library explains the recordings.
    """
    if unknown is not None:
        return _of_the_unknown(attribution, unknown)
    alike = [set(e.effects) for e in alternatives([e for e in with_effects(found) if e.probability > 0])]
    slowly = ()
    if set().union(*alike) >= TURNING:
        base = attribution.simplest.fit
        slowly = tuple(filter(None, [slower(attribution.problem, seen, base.hypothesis.point(base.u))]))
    if slowly and all(names - TURNING == alike[0] - TURNING for names in alike):
        return Plan(slowly)  # they differ in nothing else
    between = _between(attribution, found)
    if not slowly:
        return between
    return Plan(slowly) if between is None else replace(between, proposals=(*slowly, *between.proposals)[:MOST])


def _base(attribution: Attribution) -> Part:
    """The recording that others are made after: the loudest of those with the most outputs, with a period if any."""
    parts = attribution.problem.parts
    periodic = [p for p in parts if isinstance(p.record, Record)]
    return max(periodic or parts, key=lambda part: (len(part.opened.outputs), moved(part.record)))


def _lengths(record: Record | OpenRecord, recordings: int) -> list[int]:
    """How many times as long a recording may last beside so many others, and be compared as a whole."""
    samples = record.series["displacement"].shape[1]
    if isinstance(record, OpenRecord):
        most = most_samples(record.experiment, record.windows.sample_rate, recordings + 1)
    else:
        most = int(LONGEST * record.experiment.recorded_rate)
    return [n for n in LENGTHS if n == 1 or n * samples <= most]


def _of_the_unknown(attribution: Attribution, where: Where) -> Plan | None:
    """What shows where an unknown cause acts, and of what it depends; nothing predicts how much.

    First what tells most of a gap that lies there. What was varied already is not asked for, unless all of it was.
    """
    base, made = _base(attribution), made_already([part.record for part in attribution.problem.parts])
    items = menu(base.record)
    kinds = {kind: item for item in reversed(items) for kind in item.change}
    able = [(kind, kinds[kind], why) for kind, why in SHOWS.items() if kind in kinds]
    left = [row for row in able if row[0] not in made] or able
    asked = sorted(left, key=lambda row: -_tells(row[0], where))[:MOST]
    found = (Proposal(i.what, why, i.effort, None, i.change, base.record.name) for _, i, why in asked)
    return Plan(tuple(found), tuple(Choice(i.what, i.effort, None, i.change) for i in items)) if asked else None


def _tells(kind: str, where: Where) -> float:
    """How much a kind of change tells of a gap that lies there, 0 .. 1."""
    linear = where.kind.get("linear", 0.0) if where.between else 0.5
    moved = sum(share for block, share in where.blocks.items() if block.partition("+")[0] not in BEFORE_FORCE)
    return {"channels": 1.0, "amplitude": 1 - linear, "offset": moved, "excitation": linear}.get(kind, 0.5)


def _rivals(attribution: Attribution, found: Sequence[Entry]) -> list[Fit]:
    """The fits of what is left."""
    likely: list[Fit] = []
    best = max((e.probability for e in found if e.candidate), default=0.0)
    for e in found:
        if e.probability == 0 or (len(likely) >= 2 and e.probability < CLASS_SHARE * best):
            break  # what is refuted or already separated needs no further recording
        fit = attribution.candidates[e.candidate].fit if e.candidate else None
        # The same effects with a superfluous one added are not a rival hypothesis.
        if fit and not any(set(fit.hypothesis.effects) >= set(f.hypothesis.effects) for f in likely):
            likely.append(fit)
    return likely[:REMAINING]


def _between(attribution: Attribution, found: Sequence[Entry]) -> Plan | None:
    """The recordings that best separate the fits of what is left; None with fewer than two, or where none does."""
    fits = _rivals(attribution, found)
    if len(fits) < 2:
        return None
    p, base = attribution.problem, _base(attribution)
    differentiate([f for f in fits if f.jacobian is None], p.data, p.simulate, True)  # far behind, and only simulated
    items = [i for i in menu(base.record) if i.outputs]
    looks = {n: found for n, item in enumerate(items) if (found := differences(item, base, fits)) is not None}
    looks = {n: found for n, found in looks.items() if np.isfinite(separation([found], fits)[0])}
    if not looks:
        return None
    lengths = _lengths(base.record, len(p.parts))
    untold = _untold([longer(look, lengths[-1]) for look in looks.values()], fits)
    # What nothing tells apart must not hide what can be told.
    looks = {n: {pair: v for pair, v in look.items() if tuple(sorted(pair)) not in untold} for n, look in looks.items()}
    names = tuple(_from((fits[i], fits[j])) for i, j in untold)
    if not next(iter(looks.values())):
        return Plan((), untold=names)
    lasting = {length: {n: longer(look, length) for n, look in looks.items()} for length in lengths}

    def told(chosen: Sequence[int], length: int) -> Separation:
        return separation([lasting[length][n] for n in chosen], fits)

    length, order = _chosen({n: items[n].effort for n in looks}, told, lengths)
    proposals = []
    for count in range(1, len(order) + 1):
        item, (value, pair) = items[order[count - 1]], told(order[:count], length)
        surely = "tells" if value > SEPARATED else "does not surely tell"
        why = f"{'it' if count == 1 else 'together with those before, it'} {surely} {_from(pair)}"
        what, effort, change = _lasting(item, length)
        proposals.append(Proposal(what, why, effort, value, change, base.record.name))
    choices = []
    for n in looks:
        what, effort, change = _lasting(items[n], length)
        choices.append(Choice(what, effort, told([n], length)[0], change))
    ordered = sorted(choices, key=lambda c: -(c.expected_separation or 0.0))
    return Plan(tuple(proposals), tuple(ordered), names)


def _lasting(item: Item, length: int) -> tuple[str, float, Mapping[str, Any]]:
    """What to record, its effort and its change where it lasts so many times as long as the one that was made."""
    if length == 1:
        return item.what, item.effort, item.change
    return f"{item.what}, {length} times as long", item.effort + LENGTHS[length], {**item.change, "length": length}


def _from(pair: Sequence[Fit]) -> str:
    return " from ".join("+".join(f.hypothesis.effects) for f in pair)


def _untold(looks: Sequence[Differences], fits: Sequence[Fit]) -> list[tuple[int, int]]:
    """Pairs of candidates (by number, increasing) that all recordings of the menu together would not tell apart."""
    pairs = [pair for pair in looks[0] if pair[0] < pair[1]]
    both = [[{p: look[p] for p in (pair, pair[::-1])} for look in looks] for pair in pairs]
    return [pair for pair, own in zip(pairs, both, strict=True) if separation(own, fits)[0] <= SEPARATED]


def _chosen(efforts: Mapping[int, float], told: Told, lengths: Sequence[int]) -> tuple[int, list[int]]:
    """The length and, in their order, the recordings that certainly separate for the least effort.

    Where none do, the longest ones that add most for their effort.

    Args:
        efforts: Of the recordings that can be chosen.
        told: How well they separate.
        lengths: How many times as long they may last.
    """
    sure = []
    for own in (s for size in range(1, MOST + 1) for s in combinations(efforts, size)):
        for length in lengths:
            if (value := told(own, length)[0]) >= ENOUGH:
                sure.append((sum(efforts[n] + LENGTHS[length] for n in own), -value, length, own))
                break
    if not sure:
        return lengths[-1], _in_order(efforts, told, lengths[-1])[:MOST]
    _, _, length, own = min(sure)
    return length, _in_order({n: efforts[n] for n in own}, told, length)


def _in_order(efforts: Mapping[int, float], told: Told, length: int) -> list[int]:
    """Recordings in the order in which they add most for their effort, without those that add nothing worthwhile."""
    found: list[int] = []
    while left := [n for n in efforts if n not in found]:
        had = told(found, length)[0] if found else 0.0
        gain, best = max(((told([*found, n], length)[0] - had) / efforts[n], -n) for n in left)
        if found and gain * efforts[-best] < WORTHWHILE:
            break
        found.append(-best)
    return found
