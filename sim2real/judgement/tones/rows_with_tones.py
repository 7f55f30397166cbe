"""Hypotheses beside tones and trends: what explains those, alone or with a fitted effect, and what is left of them."""

from collections.abc import Mapping

from sim2real.compared.commands_seen import SEEN
from sim2real.compared.drift import DRIFT
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.lost_commands import LOST
from sim2real.judgement.tones.sightings import FOREIGN, LOUD
from sim2real.recorded.drifting import DRIFTING

TOO_LOUD = "too loud"  # the family of noise beyond what the rig states
OPEN = (FOREIGN, LOUD, DRIFT, SEEN, TOO_LOUD)  # families of what varies over time that need not have a known cause
OF_LOST = (LOUD, SEEN)  # those that lost commands explain
Row = tuple[tuple[str, ...], float, float, int | None]  # names, cost, prior and candidate of a hypothesis
KNOWN_TONES = ("pickup", "runout", "unbalance")  # of lines that are known beforehand


def with_tones(rows: list[Row], evidence: Evidence, priors: Mapping[int, float]) -> list[Row]:
    """The hypotheses with and without tones as causes.

    Without them a hypothesis costs what the tones weigh. Calibration and single effects may have them explained; those
    of an OPEN family without a known cause only the unknown one explains. A pair may stand beside a tone of the mains
    or of the rotation, which has lines of its own: a rotor that turns is out of balance, whatever else is off.
    """
    found: dict[tuple[str, ...], Row] = {}

    def propose(row: Row) -> None:
        """Of rows with the same names the best counts."""
        key = tuple(sorted(row[0]))
        if key not in found or row[1] < found[key][1]:
            found[key] = row

    for names, cost, prior, candidate in rows:
        base = () if candidate is None else evidence.effects[candidate]
        explained = [f for f in OF_LOST if _explained_by_lost(f, evidence)] if LOST in base else []
        tones = {f: weight for f, weight in tones_of(evidence, base).items() if f not in explained}
        propose((names, cost + sum(tones.values()), prior, candidate))
        for added, off in _named(tones, evidence):
            both = _joined(base, added)
            most = 3 if len(added) == 1 and added[0] in KNOWN_TONES else 2
            if candidate is not None and added and len(both) <= most and len(both) == len({*both}):
                propose((both, cost + off, prior * priors[len(both)] / priors[len(base)], candidate))
    return list(found.values())


def _explained_by_lost(family: str, evidence: Evidence) -> bool:
    """Whether lost commands explain a family of OF_LOST: not where each command is told, and none is seen lost."""
    return LOST not in evidence.causes.get(family, {})


def _named(tones: Mapping[str, float], evidence: Evidence) -> list[tuple[tuple[str, ...], float]]:
    """The effects that may explain tones, and what they cost together with the tones that they leave."""
    named: list[tuple[tuple[str, ...], float]] = [((), 0.0)]
    if "pickup" in tones:
        named = [((*names, "pickup"), cost) for names, cost in named]
    if "spin" in tones:
        named = [((*names, effect), cost + off) for names, cost in named for effect, off in evidence.spin.items()]
    for family in (f for f in OPEN if f in tones):
        causes = [(effect, off) for effect, off in evidence.causes.get(family, {}).items() if effect != LOST]
        named = [(names, cost + tones[family]) for names, cost in named] + [
            (names if effect in names else (*names, effect), cost + off)
            for names, cost in named
            for effect, off in causes
        ]
    return named


def left_of_known(names: tuple[str, ...], evidence: Evidence) -> float:
    """What these effects leave of the tones of the mains and of the rotation."""
    left = 0.0 if "pickup" in names else evidence.tones.get("pickup", 0.0)
    own = [off for effect, off in evidence.spin.items() if effect in names]
    return left + min([evidence.tones.get("spin", 0.0), *own])


def _joined(base: tuple[str, ...], added: tuple[str, ...]) -> tuple[str, ...]:
    """Fitted effects and those of tones: a gain that drifts may also be another one in the mean."""
    kept = (name for name in base if name != "actuator_gain" or "gain_drift" not in added)
    return (*kept, *added)


def tones_of(evidence: Evidence, base: tuple[str, ...]) -> dict[str, float]:
    """What tones weigh beside fitted effects: a drift that was fitted leaves of the trends what a drift may."""
    left = evidence.causes.get(DRIFT, {}).get(DRIFTING)
    return {**evidence.tones, DRIFT: left} if DRIFTING in base and left is not None else dict(evidence.tones)


def unnamed(names: tuple[str, ...], candidate: int | None, evidence: Evidence) -> float:
    """What these effects leave of what the OPEN families weigh."""
    left, tones = 0.0, tones_of(evidence, () if candidate is None else evidence.effects[candidate])
    for family in (f for f in OPEN if f in tones):
        causes = {**({LOST: 0.0} if family in OF_LOST else {}), **evidence.causes.get(family, {})}
        left += min([tones[family], *(off for effect, off in causes.items() if effect in names)])
    return left
