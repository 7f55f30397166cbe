"""The findings of rows that are off: their cause in words, or what differs where no cause explains them all."""

from collections.abc import Sequence

import numpy as np

from maglev_env.loop.gains import reads_current
from maglev_env.redundancy.cause import PARAMETERS, Cause, causes, two_causes
from maglev_env.redundancy.finding import Finding, Kind
from maglev_env.redundancy.newton import STIFFNESS
from maglev_env.redundancy.rows import LEVEL, Row
from maglev_env.redundancy.view import View

MOST_EFFECTS = 6  # that a sentence names
OF_CONTROLLER = ("controller", "injection to command", "reference to command")
HALF = 0.2  # of half a sample: how near to it a delay is taken for it
LARGEST = 8.0  # factor that an effect may be: D measures an actuator gain of 4.5 times the computed one
UNIT = 30.0  # factor from which on what is stated or recorded is in another unit


def explained(view: View, rows: Sequence[Row]) -> list[Finding]:
    """The findings of rows of which at least one is off."""
    off = [row for row in rows if row.off]
    if not off:
        return []
    if filtered := _filtered(view, rows):
        return filtered
    if any(row.shape_off for row in off if not row.delay_effects and row.code.startswith("controller")):
        return _controller(view, rows)
    bent = [row for row in off if row.shape_off and not (row.gain_off() or row.delay_off())]
    if len(bent) == len(off):
        return [_bent(view, row) for row in bent]
    if all(row.code.startswith("designed") for row in off):
        return [_stated_peak(view, row, rows) for row in off]
    found, together = causes(rows, view.rate), _with_their_peak(rows, view.rate)
    if found:
        return [_one(view, found, rows, together)]
    if together:
        return [_one(view, [], rows, together)]
    if len(off) > 1 and all(row.code in OF_CONTROLLER for row in off):
        return _controller(view, rows)  # wrong gains bend both, and are one mistake
    if both := two_causes(rows, view.rate):
        return [_one(view, [cause], rows) for cause in both]
    exact = [row for row in off if not or_effect(row)]
    if not exact:
        return [_row(view, row) for row in off]
    # The rows of exact relations alone may have one cause, while an effect moves the others.
    sure = [row for row in rows if not (row.gain_effects or row.delay_effects)]
    if any(row.off for row in sure) and (found := causes(sure, view.rate)):
        rest = [_row(view, row) for row in off if row not in sure and not {c.name for c in found} & row.powers.keys()]
        return [_one(view, found, sure), *rest]
    return [_several(view, off)]


def _with_their_peak(rows: Sequence[Row], rate: float) -> list[Cause]:
    """Excitations that explain all rows if their stated peak is wrong alike: by one sensor, or before a gain."""
    stated = {name for row in rows if row.code.startswith("designed") and not row.off for name in row.powers}
    return [c for c in causes([r for r in rows if not r.code.startswith("designed")], rate) if c.name in stated]


def or_effect(row: Row) -> bool:
    """Whether effects can cause all that is off in a row; none reverses a sign that is told, or is so large."""
    told = row.gain > 0 or not row.signed
    gain = not row.gain_off() or (bool(row.gain_effects) and told and abs(row.size) < np.log(LARGEST))
    return gain and (not (row.delay_off() or row.shape_off) or bool(row.delay_effects))


def _effects(rows: Sequence[Row]) -> str:
    names: dict[str, None] = {}
    for row in rows:
        if row.gain_off():
            names |= dict.fromkeys(row.gain_effects)
        if row.delay_off() or row.shape_off:
            names |= dict.fromkeys(row.delay_effects)
    return ", ".join(list(names)[:MOST_EFFECTS])


def _one(view: View, found: Sequence[Cause], rows: Sequence[Row], together: Sequence[Cause] = ()) -> Finding:
    channels = [c for c in found if c.name not in PARAMETERS] or list(found)
    named = [*channels, *(c for c in found if c not in channels)]
    lead = (named or together)[0]
    off = [row for row in rows if row.off and lead.name in row.powers] or [row for row in rows if row.off]
    sure = any(not or_effect(row) for row in off)
    factor = (-1 if lead.negative else 1) * float(np.exp(lead.size))
    reach = 2 * lead.size_se * abs(factor)
    mass = next((row.notes for row in off if "mass" in row.notes), None)
    if lead.name == "mass" and mass:
        factor, reach = mass["mass"], 2 * mass["mass_se"]
    elif lead.name in ("mass", "actuator gain"):
        reach += STIFFNESS / 2 * abs(factor)  # all that the stiffness may do
    says, code, value, interval = [], "scale", factor, (factor - reach, factor + reach)
    gained = lead.negative or any(row.gain_off() for row in off)
    if lead.negative and not any(abs(row.size) > row.tolerance + LEVEL * row.gain_se for row in off):
        says.append("its sign is reversed")
        code = "sign"
    elif gained:
        size_words = _with_reach(factor, reach)
        if lead.name in PARAMETERS:
            says.append(f"what is stated is {size_words} times what is shown")
            contrary = [c.name for c in named if c.name in PARAMETERS and c.size * lead.size < 0]
            if contrary:  # twice the mass is half the gain
                says[-1] += f" ({' and '.join(contrary)}: {_with_reach(1 / factor, reach / factor**2)})"
        else:
            says.append(f"factor {size_words}")
            if mass and any(c.name == "mass" for c in named):
                says[-1] += (
                    f", or the stated mass is {_with_reach(mass['mass'], 2 * mass['mass_se'])} times what is shown"
                )
    if lead.name not in PARAMETERS and any(row.delay_off() for row in off):
        samples, error = lead.delay * view.rate, 2 * lead.delay_se * view.rate
        other = [c.name for c in channels if c.delay * lead.delay < 0]
        when, contrary = ("late", "early") if samples > 0 else ("early", "late")
        either = f"{lead.name} {when}, or {' or '.join(other)} {contrary}," if other else when
        says.append(f"{either} by {abs(samples):.3g} +- {error:.1g} samples")
        if not gained:
            code, value, interval = (
                "delay",
                lead.delay,
                (lead.delay - 2 * lead.delay_se, lead.delay + 2 * lead.delay_se),
            )
    together = [c for c in together if c.name not in {other.name for other in named}]
    names = " or ".join([*(c.name for c in named), *(f"{c.name} with its stated peak" for c in together)])
    against = " and ".join(dict.fromkeys(row.against for row in off))
    text = f"{names}: {' and '.join(says) or 'differs'} against {against}; {_advice(view, code, lead)}"
    if not named:
        text += ", and whether a gain lies between it and what acts"
    for cause in found if code == "delay" else ():
        if cause.name == "force":
            text += _between_samples(view, cause.delay, cause.delay_se)
    holding = [row for row in rows if row.known and lead.name in row.powers]
    channel = " or ".join(c.name for c in (*named, *together))
    if lead.name == "displacement" and code == "scale" and {r.code for r in holding} <= {*OF_CONTROLLER}:
        text += ", or each of the gains: nothing else that is recorded holds the displacement"
        channel += "" if "gains" in channel else " or gains"
    kind: Kind = "wiring"
    if not sure:
        kind = "effect"
        text += f"; or an effect ({_effects(off)}): run `maglev diagnose`"
    elif (
        len({row.code for row in off if lead.name in row.powers}) > 1 or lead.negative or abs(lead.size) > np.log(UNIT)
    ):
        kind = "contradiction"
    return Finding(code, view.recording, channel, float(value), interval, text, kind)


def _between_samples(view: View, delay: float | None, error: float) -> str:
    """What is said of a force (delay and standard error in s) that is late or early by half a sample: so is a smooth
    force that is taken as held between samples, and a held one that is taken as smooth."""
    half = 0.5 / (view.hold_rate or view.rate)
    if delay is None or abs(abs(delay) - half) > max(LEVEL * error, HALF * half):
        return ""
    if (delay > 0) != (view.hold_rate is not None):
        return ""
    stated, acts = ("bl", "is smooth") if delay > 0 else ("zoh", "is held by a converter")
    return f', or state intersample = "{stated}" of this recording if the force {acts} between samples'


def _with_reach(value: float, reach: float) -> str:
    return f"{value:.3g} +- {reach:.1g}"


def _advice(view: View, code: str, cause: Cause) -> str:
    if cause.name in PARAMETERS:
        both = "displacement" if "reference" not in view.recorded else "displacement and reference together"
        advice = {
            "mass": "check [parameters] mass",
            "gains": "check the stated gains" + (f", or the sign of {both}" if code == "sign" else ""),
        }
        said = advice.get(cause.name, "check the rig's actuator_gain")
        if cause.name == "gains" or view.gains is None or "displacement" not in view.recorded:
            return said
        # Gains that count in a wrong unit agree with it, as those do that were told from the recording.
        column = view.columns.get("displacement", "displacement")
        return f"{said}, or the scale of column {column!r}, if the stated gains count in it"
    column = view.columns.get(cause.name, cause.name)
    return {
        "scale": f"check the scale of column {column!r}",
        "sign": f"check the sign of column {column!r}",
        "delay": f"check when column {column!r} is sampled",
    }[code]


def _filtered(view: View, rows: Sequence[Row]) -> list[Finding]:
    """A low-pass on one channel."""
    for row in rows:
        if row.shape_off and row.lag:
            names = list(row.powers)
            name = names[0] if row.lag > 0 else names[1]
            if row.notes.get("twist"):
                name = "injection"
            corner = 1 / (2 * np.pi * abs(row.lag))
            text = f"{name}: it looks low-pass filtered at {corner:.4g} Hz against {row.against}; take the filter out"
            if other := sorted(view.corrected & {*names} - {name}):
                text += f", or the filter that is stated of {' or '.join(other)}"
                name = " or ".join([name, *other])
            elif row.code == "controller" and name != "injection":
                text += ", or correct kd and td"
                name += " or gains"
            kind: Kind = "wiring"
            if row.delay_effects:
                kind = "effect"
                text += f", or an effect ({', '.join(row.delay_effects[:MOST_EFFECTS])}): run `maglev diagnose`"
            return [Finding("filter", view.recording, name, corner, None, text, kind)]
    return []


def _controller(view: View, rows: Sequence[Row]) -> list[Finding]:
    row = next(r for r in rows if r.code == "controller")
    read = ["displacement", *(["current"] if reads_current(view.gains, 1 / view.rig.control_rate) else [])]
    read += ["reference"] if "reference" in view.recorded else []
    added = [n for n in ("injection",) if n in view.recorded]
    names = " or ".join(["command", *read, *added, "gains"])
    amplifier = next((r for r in rows if r.code == "amplifier"), None)
    if amplifier is not None and amplifier.off and not or_effect(amplifier):
        both = "command or current" if "current" in read else "command"
        text = (
            f"{both}: column {view.columns.get('command', 'command')!r} is neither what the stated controller makes of "
            f"the {' and the '.join(read)} ({row.misfit:.0%} are left) nor what drives the stated amplifier "
            f"({amplifier.misfit:.0%} of the current are left): it is another quantity"
            f"{', or the current has another scale' if 'current' in read else ''}. The command of a cascade is its "
            "voltage over the resistance; where the wanted current is recorded, state the outer controller alone, and "
            "the lag of the inner loop as the rig's amplifier_time_constant"
        )
        return [Finding("mismatch", view.recording, both, row.gain, None, text, "contradiction")]
    text = (
        f"{names}: the command is not what the stated controller makes of the {' and the '.join(read)} (factor "
        f"{row.gain:.3g}, {row.misfit:.0%} are left): check the gains, td, ti and control_rate, whether the controller "
        "limits or filters otherwise than is stated, and that these columns belong to this loop"
    )
    if not added:
        text += "; or something was added to the command that no column holds"
    return [Finding("controller", view.recording, names, row.gain, None, text, "wiring")]


def _bent(view: View, row: Row) -> Finding:
    if row.code.startswith("designed"):
        name = next(iter(row.powers))
        text = (
            f"{name}: its lines are unequal by {row.misfit:.0%} where the design has equal ones (they change as "
            f"frequency to the power {row.notes['slope']:.2g}): a filter on column {view.columns.get(name, name)!r}, "
            "or the exciter's own response"
        )
        return Finding("shape", view.recording, name, row.misfit, None, text, "quality")
    return _row(view, row)


def _row(view: View, row: Row) -> Finding:
    says = []
    if row.gain_off():
        says.append(f"factor {row.gain:.3g} +- {2 * row.gain_se * abs(row.gain):.1g}")
    if row.delay_off():
        says.append(f"{'late' if row.delay > 0 else 'early'} by {abs(row.delay) * view.rate:.3g} samples")
    if row.shape_off:
        says.append(f"{row.misfit:.0%} are left unexplained")
    # A mass or a gain makes nothing late.
    late = row.delay_off() and not (row.gain_off() or row.shape_off)
    names = " or ".join(name for name in row.powers if not (late and name in PARAMETERS))
    text = f"{names}: {', '.join(says)} against {row.against}"
    effects = _effects([row])
    wrong = "check when each is sampled; it may be" if late else "a scale, or" if row.gain_off() else "a filter, or"
    if row.code == "newton force" and late:  # its power there is -1, so that a late force makes the row early
        text += _between_samples(view, -row.delay if row.delay is not None else None, row.delay_se)
    text += f": {wrong} an effect ({effects}): run `maglev diagnose`" if effects else "; check both"
    kind: Kind = "effect" if or_effect(row) else "wiring"
    se = 2 * row.gain_se * abs(row.gain)
    return Finding(row.code, view.recording, names, row.gain, (row.gain - se, row.gain + se), text, kind)


def _stated_peak(view: View, row: Row, rows: Sequence[Row]) -> Finding:
    """An excitation that differs from its stated peak alone: the statement is wrong where another row, which agrees,
    would show it if the channel had that factor."""
    name = next(iter(row.powers))
    se = 2 * row.gain_se * abs(row.gain)
    text = f"{name}: factor {row.gain:.3g} +- {se:.1g} against {row.against}; "
    holding = [other for other in rows if name in other.powers and not other.code.startswith("designed")]
    if any(other.tolerance + LEVEL * other.gain_se < abs(row.size) for other in holding):
        text += (
            f"column {view.columns.get(name, name)!r} agrees with what it does, so correct the stated amplitude (peak)"
        )
    else:
        text += f"check the scale of column {view.columns.get(name, name)!r}, or the stated amplitude (peak)"
    return Finding("scale", view.recording, name, row.gain, (row.gain - se, row.gain + se), text, "wiring")


def _several(view: View, off: Sequence[Row]) -> Finding:
    parts = "; ".join(
        f"{next(iter(row.powers))} is {row.gain:.3g} times {row.against}"
        + (f" and {row.misfit:.0%} off in shape" if row.shape_off else "")
        for row in off[:3]
    )
    names = " or ".join(dict.fromkeys(name for row in off for name in row.powers if name not in PARAMETERS))
    text = (
        f"{names}: no single cause explains this: {parts}. The file of another rig or recording, swapped columns, or "
        "several errors: check file, columns and rig"
    )
    sure = len([row for row in off if not or_effect(row)]) > 1
    return Finding("mismatch", view.recording, names, None, None, text, "contradiction" if sure else "wiring")
