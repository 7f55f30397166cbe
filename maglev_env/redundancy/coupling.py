"""A channel that is AC coupled: recorded through a high-pass of first order, which takes the lowest lines away."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from estimation.lines.frequency_response import pooled_variance
from maglev_env.channels import SHOWN_BY
from maglev_env.loop.controller_forms import Pid, StateFeedback
from maglev_env.loop.gains import Gains, controller_output, controller_response, gain_values, with_gains
from maglev_env.recordings.derived import under_voltage
from maglev_env.recordings.measurement_chain import coupled as uncoupled
from maglev_env.redundancy.controller import READ, applies, at_control_rate, compared, limited_in
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import LEVEL, MODEL
from maglev_env.redundancy.view import Lines, View

SEEN = 0.05  # of the lowest frequency: a corner below turns that line by less than 3 degrees
EXPLAINS = 0.5  # share of the misfit beyond noise that the corner must explain
PARTS, SLOW, FAST = 24, 0.2, 0.005  # of a record; shares of the command's slow parts, and of all of it
EFFECTS = ("friction", "hysteresis", "eddy_current")
LEAST = 8  # lines
NOISE = 3.0  # times what chance leaves of noise alone, a line
LINEAR = (
    1e-6  # share of what a gain adds to the controller by which twice as much of it may add another amount than twice
)
INTEGRALS, PER_SAMPLE = ("ki", "integral", "outer_ki"), 0.05  # gains by name; of the control rate
_ONE_INTEGRAL = (Gains, Pid, StateFeedback)  # controllers of which a constant error makes a ramp at most


@dataclass(frozen=True)
class Relation:
    """A channel, and what it is made of: mean spectra (n,) by channel; the variance (n,) of its mean.

    `beside`: what else may be in the channel, with any gain, (n,).
    """

    name: str
    out: np.ndarray
    made: Mapping[str, np.ndarray]
    variance: np.ndarray
    against: str
    beside: tuple[np.ndarray, ...] = ()


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
        integral = _gain(view, of_command) if of_command is not None else None
        if integral is not None and integral.clearly and integral.whole:
            return [_gain_finding(view, integral)]
        return _of_the_design(view, least)
    exact = [one for one in found if one[3].name != "displacement"]
    corner, se, name, relation = (exact or found)[0]
    integral = _gain(view, relation) if relation.name == "command" else None
    if integral is not None and (integral.clearly or _unit_of_time(view, integral)):
        return [_gain_finding(view, integral)]
    if len({other for _, _, other, _ in exact}) > 1:
        name = "command"  # what both relations hold
    text = (
        f"{name}: it looks AC coupled, high-pass filtered at {corner:.3g} +- {2 * se:.1g} Hz, against "
        f"{relation.against}; record column {view.columns.get(name, name)!r} with its mean"
    )
    if integral is not None:
        text += f", or correct {integral.gain}, which would be {integral.value:.4g}{_of_time(view, integral)}"
        name += " or gains"
    if not exact:
        text += f", or an effect ({', '.join(EFFECTS)}): run `maglev diagnose`"
    kind = "wiring" if exact else "effect"
    return [Finding("filter", view.recording, name, corner, (corner - 2 * se, corner + 2 * se), text, kind)]


@dataclass(frozen=True)
class _Gain:
    """A gain that explains what a high-pass does: its name, stated and found value, and its error.

    `clearly`: better than any high-pass. `whole`: it leaves noise alone.
    """

    gain: str
    stated: float
    value: float
    se: float
    clearly: bool
    whole: bool


def _gain(view: View, relation: Relation) -> _Gain | None:
    """The integral gain of the stated controller under which the relation of the command agrees; None: none does.

    What is integrated lacks in the command as what a high-pass takes from the displacement does. Where another gain of
    the controller explains more, it is that one.
    """
    lines, dt = view.lines, 1 / view.rig.control_rate
    gains = gain_values(view.gains)
    integral = next((name for name in INTEGRALS if name in gains), None)
    if integral is None:
        return None
    w, z, y = 2 * np.pi * lines.frequency, np.exp(2j * np.pi * lines.frequency * dt), lines.parts["displacement"]
    own = controller_response(view.gains, z, dt)
    weight = 1 / np.maximum(relation.variance + (MODEL * np.abs(relation.out)) ** 2, 1e-300)
    free = [v for term in relation.made.values() for v in (term, -1j * w * term)]
    _, coupled_left, _ = _squares(relation.out, [*free, -1j / w * relation.made["displacement"]], weight)
    misfit = relation.out - sum(relation.made.values())
    found: dict[str, tuple[float, float, float, float]] = {}
    for name, stated in gains.items():
        step = float(np.abs(own[0]) * w[0]) if name == integral else 0.5 * stated
        once, twice = (
            controller_response(with_gains(view.gains, **{name: stated + n * step}), z, dt) - own for n in (1, 2)
        )
        if not once.any() or np.abs(twice - 2 * once).max() > LINEAR * np.abs(once).max():
            continue  # nothing, or the constant of a filter: what another one would do is not in proportion to it
        more = -(once * y.mean(axis=0)) / step
        by, left, se = _squares(relation.out, [*free, more], weight)
        _, alone, _ = _squares(misfit, [more], weight)
        found[name] = (*_of_gain(by[-1], se, by[2 * list(relation.made).index("displacement")]), left, alone)
    if integral not in found:
        return None
    best = min(found, key=lambda name: found[name][2] + (0.0 if name == integral else LEVEL**2))
    size, se, left, alone = found[best]
    if left > coupled_left + LEVEL**2 or abs(size) < LEVEL * se:
        return None
    whole = left < NOISE * weight.size
    if best != integral and not alone < NOISE * weight.size:
        return None  # beside another scale: several gains are wrong, or something else
    return _Gain(best, gains[best], gains[best] + size, se, left < coupled_left - LEVEL**2, whole)


def _gain_finding(view: View, found: _Gain) -> Finding:
    text = (
        f"gains: the command is what the stated controller makes of the displacement with {found.gain} = "
        f"{found.value:.4g} +- {2 * found.se:.1g} in place of {found.stated:g}{_unit_of_time(view, found)}; correct "
        f"{found.gain}{_of_time(view, found)}"
    )
    return Finding("filter", view.recording, "gains", found.value,
                   (found.value - 2 * found.se, found.value + 2 * found.se), text, "wiring")  # fmt: skip


def _of_time(view: View, found: _Gain) -> str:
    """The integral gain behind one that multiplies a low-pass of unit gain: of both, lines far above tell no more."""
    ti = gain_values(view.gains).get("ti") if view.gains is not None else None
    return f" (ki / ti, the integral gain, is {found.value / ti:.4g} A/(m s))" if ti and found.gain == "ki" else ""


def _unit_of_time(view: View, found: _Gain) -> str:
    """What is said of an integral gain that counts in samples."""
    times = found.value / found.stated if found.stated else 0.0
    if not abs(times / view.rig.control_rate - 1) < PER_SAMPLE:
        return ""
    return ", which is that one times the control rate: it is stated for one sample, and counts for one second"


def decoupled(view: View, found: Finding) -> View:
    """The view with what a finding of `coupled` names as it should be: a channel before its high-pass, or a gain."""
    if found.channel == "gains" and view.gains is not None and found.value is not None:
        relation = _controller(view)
        gain = _gain(view, relation) if relation is not None else None
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
    _, without, _ = _squares(out, free, weight)
    noise = 2.0 * out.size
    best = (0.0, 0.0, "")
    least = max((1 - EXPLAINS) * without, min(noise, without - LEVEL**2))
    for i, (who, lacks) in enumerate({relation.name: -out, **relation.made}.items()):
        found, left, se = _squares(out, [*free, -1j / w * lacks], weight)
        size, se = _of_gain(found[-1], se, found[2 * (i - 1)] if i else 1.0)
        if left < least and size > 0:
            least, best = left, (size / (2 * np.pi), se / (2 * np.pi), who)
    return best


def _of_gain(size: float, error: float, gain: float) -> tuple[float, float]:
    """What a channel lacks and its error, where it enters with a gain, which is not 1 behind a wrong scale or sign."""
    return (size / gain, error / abs(gain)) if gain else (0.0, error)


def _squares(out: np.ndarray, parts: list[np.ndarray], weight: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Least squares of spectra with real coefficients: these, the cost that is left, and the error of the last one."""
    root = np.sqrt(weight)
    columns = np.stack(parts) * root
    scale = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    real = np.concatenate([columns.real, columns.imag], axis=1) / scale[:, None]
    wanted = np.concatenate([(out * root).real, (out * root).imag])
    found, *_ = np.linalg.lstsq(real.T, wanted, rcond=None)
    left = float(((wanted - found @ real) ** 2).sum())
    error = np.sqrt(max(np.linalg.pinv(real @ real.T)[-1, -1], 0.0) * max(left / wanted.size, 0.5))
    return found / scale, left, float(error / scale[-1])
