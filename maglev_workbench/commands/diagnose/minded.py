"""What is to be minded of a diagnosis: recordings that are not what is stated, what the rig leaves out, and what looks
like the effects that it names."""

from collections.abc import Mapping, Sequence
from typing import Any

from sim2real.compared.commands_seen import LOST, stalled
from sim2real.report import causes_of, corrections
from sim2real.result import Diagnosis
from sim2real.search.hypotheses import REPLACED, added_lag

KNEE = 0.005  # relative standard error of a stop's distance, below which it is a knee
LATE, OR_EFFECT = "delay", "; or an effect"  # code of a warning, and what it says for those who have no diagnosis yet
SPIKE = "spike", "current"  # code and channel of another one
BENT = ("force_law", "cubic_spring", "soft_stop")  # forces that bend with the position


def minded(diagnosis: Diagnosis, warnings: Sequence[Mapping[str, Any]] = ()) -> list[str]:
    """Sentences on a controller or a recording that is not what is stated, a lag that may have been left out, and a
    force that a curved reading may look like.

    Args:
        diagnosis: the diagnosis.
        warnings: of the command's JSON, on its recordings.
    """
    mistyped = [] if diagnosis.wrong_gain is None else [diagnosis.wrong_gain.in_words()]
    return [*mistyped, *_not_as_stated(diagnosis, warnings), *unstated(diagnosis), *curved(diagnosis)]


def _not_as_stated(diagnosis: Diagnosis, warnings: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence where a warning says what no effect does, or that a column is late which no known effect explains: the
    gap may be nothing else. A late current may as well be what lags before it, unless its readings alone explain as
    much as that, which is said elsewhere (`Diagnosis.misread`)."""
    if diagnosis.verdict == "no_gap":
        return []
    unknown = diagnosis.verdict == "unexplained"
    own = [w for w in warnings if w["kind"] == "wiring" or (unknown and w["code"] == LATE and _kind(w) != "current")]
    if LOST in causes_of(diagnosis) or stalled(diagnosis.notes):
        own = [w for w in own if (w["code"], w.get("channel")) != SPIKE]  # a command that is lost makes one
    if not own:
        return []
    first, more = own[0], f" ({len(own) - 1} more such warnings)" if len(own) > 1 else ""
    said = first["message"].partition(OR_EFFECT)[0]
    return [
        f"the gap may be that a recording is not what its campaign states{more}: {first['recording']}: {said}; "
        "put that right first, and diagnose again"
    ]


def _kind(warning: Mapping[str, Any]) -> str:
    """Of the channel that a warning is on, without its axis."""
    return str(warning.get("channel", "")).partition("_")[0]


def curved(diagnosis: Diagnosis) -> list[str]:
    """A sentence where every named hypothesis bends with the position, as the reading of a probe may."""
    causes = [set(name.split("+")) for name in diagnosis.cause]
    named = sorted(set().union(*causes) & {*BENT})
    if not causes or not all(cause & {*BENT} for cause in causes):
        return []
    if named == ["soft_stop"] and _has_knee(diagnosis):
        return []
    return [
        f"{' and '.join(named)} may be the probe's: a reading that is no straight line (1 / gap, as of hall and "
        "inductive probes) looks alike, and is none of the known effects; compare it with a calibration at three "
        "distances or more"
    ]


def _has_knee(diagnosis: Diagnosis) -> bool:
    """Whether the distance of a stop is known so sharply as no smooth curve would have it."""
    at = next((c for c in corrections(diagnosis) if c.name == "soft_stop.distance"), None)
    return at is not None and at.se is not None and at.se < KNEE * at.value


def unstated(diagnosis: Diagnosis) -> list[str]:
    """A sentence for each lag that every named hypothesis has, and that the rig states no time constant for."""
    causes = [set(name.split("+")) for name in diagnosis.cause]
    found = []
    for effect, name in REPLACED.items():
        values = diagnosis.corrected.effects.get(effect)
        stated = getattr(diagnosis.rig, name) or name in diagnosis.rig.tolerance
        if stated or values is None or not causes or not all(effect in cause for cause in causes):
            continue
        lag = added_lag(diagnosis.corrected.effects, effect, causes_of(diagnosis), diagnosis.rig.effects)
        value = float(f"{lag:.3g}")
        found.append(
            f"the rig states no {name}, so that {effect} may be no fault but what was left out: with {name} = "
            f"{value!r} (s) in rig.toml, if that is right, `maglev diagnose` says what else differs"
        )
    return found
