"""A channel that is AC coupled: recorded through a high-pass of first order, which takes the lowest lines away."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy

from estimation.lines.frequency_response import pooled_variance
from maglev_env.channels import SHOWN_BY
from maglev_env.loop.controller_forms import Pid, StateFeedback
from maglev_env.loop.gains import Gains, controller_output, with_gains
from maglev_env.recordings.derived import under_voltage
from maglev_env.recordings.measurement_chain import coupled as uncoupled
from maglev_env.redundancy.controller import READ, applies, at_control_rate, compared, limited_in
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.relation import Relation, of_gain, squares
from maglev_env.redundancy.rows import LEVEL, MODEL
from maglev_env.redundancy.view import Lines, View
from maglev_env.redundancy.wrong_gain import finding_of, of_time, unit_of_time, wrong_gain

SEEN = 0.05  # of the lowest frequency: a corner below turns that line by less than 3 degrees
EXPLAINS = 0.5  # share of the misfit beyond noise that the corner must explain
PARTS, SLOW, FAST = 24, 0.2, 0.005  # of a record; shares of the command's slow parts, and of all of it
EFFECTS = ("friction", "hysteresis", "eddy_current")
LEAST = 8  # lines
_ONE_INTEGRAL = (Gains, Pid, StateFeedback)  # controllers of which a constant error makes a ramp at most


def coupled(view: View) -> list[Finding]:
    """The corner of a high-pass on the command, the current, the displacement or the injection.

    A channel behind it lacks w_c / (j w) times itself, a shape that no gain, delay or low-pass has. Its size w_c is
    normal about zero if all is well. The nominal plant is known less well: there the corner may also be an effect.
    """
    lines = view.lines
    if lines.frequency.size < LEAST:
        return []
    least, found = SEEN * float(lines.frequency.min()), []
    of_command = _controller(view)
    for relation in (of_command, _amplifier(view), _plant(view)):
        if relation is not None:
            corner, se, name = _corner(lines.frequency, relation)
            if name and corner > max(LEVEL * se, least):
                found.append((corner, se, name, relation))
    if not found:  # an integral gain that is far too large bends the command otherwise than any high-pass
        gain = wrong_gain(view, of_command) if of_command is not None else None
        if gain is not None and gain.clearly and gain.whole:
            return [finding_of(view, gain)]
        return _of_the_design(view, least)
    exact = [one for one in found if one[3].name != "displacement"]
    corner, se, name, relation = (exact or found)[0]
    gain = wrong_gain(view, relation) if relation.name == "command" else None
    if gain is not None and (gain.clearly or unit_of_time(view, gain)):
        return [finding_of(view, gain)]
    if len({other for _, _, other, _ in exact}) > 1:
        name = "command"  # what both relations hold
    text = (
        f"{name}: it looks AC coupled, high-pass filtered at {corner:.3g} +- {2 * se:.1g} Hz, against "
        f"{relation.against}; record column {view.columns.get(name, name)!r} with its mean"
    )
    if gain is not None:
        text += f", or correct {gain.gain}, which would be {gain.value:.4g}{of_time(view, gain)}"
        name += " or gains"
    if not exact:
        text += f", or an effect ({', '.join(EFFECTS)}): run `maglev diagnose`"
    kind = "wiring" if exact else "effect"
    return [Finding("filter", view.recording, name, corner, (corner - 2 * se, corner + 2 * se), text, kind)]


def decoupled(view: View, found: Finding) -> View:
    """The view with what a finding of `coupled` names as it should be: a channel before its high-pass, or a gain."""
    if found.channel == "gains" and view.gains is not None and found.value is not None:
        relation = _controller(view)
        gain = wrong_gain(view, relation) if relation is not None else None
        return view if gain is None else replace(view, gains=with_gains(view.gains, **{gain.gain: gain.value}))
    name = found.channel.partition(" or ")[0]
    values = view.channels.get(name)
    if values is None or found.value is None:
        return view
    values = uncoupled(values - values.mean(), view.rate, (found.value,))
    return replace(view, channels={**view.channels, name: values})


def slow_parts(view: View) -> list[Finding]:
    """In a record that never repeats: slow parts of the command that the controller does not make of what it reads.

    What a PID was at the beginning, and a constant error that it integrates, leave a constant and a ramp behind. Asked
    only where no comparison is off, because a wrong scale leaves slow parts, too.
    """
    if view.periodic or not isinstance(view.gains, _ONE_INTEGRAL) or not applies(view):
        return []
    if limited_in(view, view.gains):
        return []
    read = {name: view.channels[name] for name in READ if name in view.channels}
    made = controller_output(view.gains, dt=1 / view.rig.control_rate, **read) + view.channels.get("injection", 0.0)
    command = view.channels["command"]
    begun = command.size // 4  # what other states of a controller forget
    rest, whole = (
        scipy.signal.detrend([part.mean() for part in np.array_split(x[begun:], PARTS)]).std()
        for x in (command - made, command)
    )
    if not rest > max(SLOW * whole, FAST * float(command.std())):
        return []
    text = (
        f"displacement or command: {rest / max(whole, 1e-300):.0%} of the command's slow parts are not what the stated "
        "controller makes of the displacement: one of the columns is AC coupled or drifts, or ki and ti are not stated "
        "right; record both with their means"
    )
    return [Finding("filter", view.recording, "displacement or command", rest / max(whole, 1e-300), None, text,
                    "wiring")]  # fmt: skip


def _of_the_design(view: View, least: float) -> list[Finding]:
    """The lowest lines of a recorded excitation, smaller than its others where the design has equal ones.

    Behind a high-pass the inverse squares of equal lines are a + (f_c / f)^2.
    """
    for e in view.excitations:
        name = SHOWN_BY[e.at]
        if not e.periodic or e.kind == "low_crest" or name not in view.recorded:
            continue
        lines = view.lines.at(np.isin(view.lines.harmonics, e.lines))
        parts, f = lines.parts[name], lines.frequency
        mean = np.abs(parts.mean(axis=0))
        if f.size < LEAST or not mean.all():
            continue
        share = np.hypot(np.sqrt(parts.var(axis=0, ddof=1) / len(parts)) / mean, MODEL)
        y, error = (np.median(mean) / mean) ** 2, 2 * share
        level, square = np.polynomial.polynomial.polyfit(f**-2.0, y, 1, w=1 / error)
        off = (y - level - square * f**-2.0) / error
        spread = (f**-2.0 - np.average(f**-2.0, weights=error**-2.0)) / error
        se = float(np.sqrt(max(np.mean(off**2), 1.0) / (spread**2).sum()))
        if level <= 0 or square <= LEVEL * se or np.sqrt(square / level) < 3 * least or np.median(np.abs(off)) > LEVEL:
            continue
        corner = float(np.sqrt(square / level))
        text = (
            f"{name}: its lowest lines are smaller than the others, as behind a high-pass at {corner:.3g} Hz: AC "
            f"coupling of column {view.columns.get(name, name)!r}, or the exciter's own response"
        )
        return [Finding("shape", view.recording, name, corner, None, text, "quality")]
    return []


def _controller(view: View) -> Relation | None:
    if not view.periodic or not applies(view) or (found := compared(view, view.gains)) is None:
        return None
    made = {"displacement": found.back, **({"injection": found.drive} if found.driven else {})}
    return _means(view.lines, "command", made, "what the controller makes")


def _amplifier(view: View) -> Relation | None:
    if view.rig is None or not view.rig.controlled or not {"command", "current"} <= view.recorded:
        return None
    if not view.periodic and not at_control_rate(view):
        return None
    lines = view.lines
    command, induced = (_amplified(view, of) for of in (view.channels["command"], _induced(view)))
    if lines.periodic:
        found = _means(lines, "current", {"command": command}, "what the amplifier makes")
        return replace(found, beside=(induced.mean(axis=0),) if induced.any() else ())
    # Where nothing repeats: the response that all segments have in common.
    power, out = (np.abs(command) ** 2).sum(axis=0), lines.parts["current"]
    if not power.all() or len(out) < LEAST:
        return None
    response, beside = ((one * command.conj()).sum(axis=0) / power for one in (out, induced))
    rest = (np.abs(out - response * command) ** 2).sum(axis=0) / (len(out) - 1)
    return Relation("current", response, {"command": np.ones_like(response)}, rest / power, "what the amplifier makes",
                    (beside,) if beside.any() else ())  # fmt: skip


def _amplified(view: View, values: np.ndarray) -> np.ndarray:
    """Spectra (s, n) of what the nominal amplifier makes of a command (samples,).

    Where nothing repeats, a segment holds what came before it, and a slow command much of it: the amplifier runs
    through the whole record.
    """
    assert view.rig is not None
    lag = view.rig.amplifier_time_constant
    if not view.periodic and lag:
        decay = np.exp(-1 / (view.rate * lag))
        values = scipy.signal.lfilter([0.0, 1 - decay], [1.0, -decay], values, zi=[decay * values[0]])[0]
    own = replace(view, channels={**view.channels, "command": values}).lines
    return own.parts["command"] * (view.nominal(own.frequency).amplifier if view.periodic else 1.0)


def _induced(view: View) -> np.ndarray:
    """The velocity (samples,), which a coil under a voltage answers by an induced one; zeros where there is none."""
    if view.rig is None or "displacement" not in view.recorded or not under_voltage(view.rig):
        return np.zeros(view.channels["command"].size)
    y = view.channels["displacement"]
    return view.rate * np.diff(y, append=y[-1:])


def _plant(view: View) -> Relation | None:
    """The displacement by the nominal magnets and mass; where a force acts, too, the controller's relation tells."""
    if view.rig is None or not view.rig.controlled or not {"displacement", "current"} <= view.recorded:
        return None
    lines = view.lines
    if not lines.periodic or any(e.at == "force" for e in view.excitations):
        return None
    nominal = view.nominal(lines.frequency)
    made = {"current": nominal.plant / nominal.amplifier * lines.parts["current"]}
    return _means(lines, "displacement", made, "what the current moves")


def _means(lines: Lines, name: str, made: Mapping[str, np.ndarray], against: str) -> Relation:
    """A relation of spectra (s, n)."""
    out = lines.parts[name]
    variance = pooled_variance((out - sum(made.values())).var(axis=0, ddof=1)) / len(out)
    return Relation(name, out.mean(axis=0), {n: v.mean(axis=0) for n, v in made.items()}, variance, against)


def _corner(frequency: np.ndarray, relation: Relation) -> tuple[float, float, str]:
    """Corner (Hz), its standard error, and the channel whose high-pass explains most; "" where none explains enough."""
    w, out = 2 * np.pi * frequency, relation.out
    if not np.any(out):
        return 0.0, 0.0, ""
    weight = 1 / np.maximum(relation.variance + (MODEL * np.abs(out)) ** 2, 1e-300)
    free = [v for term in relation.made.values() for v in (term, -1j * w * term)]  # gains and delays
    free += relation.beside
    _, without, _ = squares(out, free, weight)
    noise = 2.0 * out.size
    best = (0.0, 0.0, "")
    least = max((1 - EXPLAINS) * without, min(noise, without - LEVEL**2))
    for i, (who, lacks) in enumerate({relation.name: -out, **relation.made}.items()):
        found, left, se = squares(out, [*free, -1j / w * lacks], weight)
        size, se = of_gain(found[-1], se, found[2 * (i - 1)] if i else 1.0)
        if left < least and size > 0:
            least, best = left, (size / (2 * np.pi), se / (2 * np.pi), who)
    return best
