"""What a diagnosis names because the rig leaves it out: a pole that nobody stated is no fault of the rig."""

from sim2real.result import Diagnosis
from sim2real.search.hypotheses import REPLACED


def unstated(diagnosis: Diagnosis) -> list[str]:
    """A sentence for each lag that every named hypothesis has, and that the rig states no time constant for."""
    causes = [set(name.split("+")) for name in diagnosis.cause]
    found = []
    for effect, name in REPLACED.items():
        values = diagnosis.corrected.effects.get(effect)
        stated = getattr(diagnosis.rig, name) or name in diagnosis.rig.tolerance
        if stated or values is None or not causes or not all(effect in cause for cause in causes):
            continue
        value = float(f"{values['time_constant']:.3g}")
        found.append(
            f"the rig states no {name}, so that {effect} may be no fault but what was left out: with {name} = "
            f"{value!r} (s) in rig.toml, if that is right, `maglev diagnose` says what else differs"
        )
    return found
