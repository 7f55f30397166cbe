"""The recorded current against what the nominal amplifier makes of the recorded command."""

from dataclasses import replace

import numpy as np

from maglev_env.loop.gains import reads_current
from maglev_env.redundancy.controller import at_control_rate
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import MODEL, Fit, Row, fit, local_power, low_pass
from maglev_env.redundancy.view import Lines, View
from maglev_env.rig.rig import PARAMETERS

GAIN = 0.1  # of an amplifier and its current sensor
LAG = 0.1  # relative standard deviation of the amplifier's time constant where the rig states no tolerance
WIDE = 4.0  # standard deviations of a tolerance that count as possible
SHAPE = 0.1
POINTS = 17  # time constants that are tried
REACH, BESIDE = (0.05, 50.0), 1.3  # samples: a time constant that is not known at all, and its grid's finer part
ALLOWED = 16.0  # rise of the cost within which a time constant is possible: four standard deviations
DELAY = 0.3  # of a sample
KNOWN = 0.4  # relative width of what is possible, up to which a time constant is worth stating
NOTHING, BY_CHANCE = 0.3, 2.0  # share of the expected current, and of what chance alone makes, that are no relation
STILL = 0.03  # of the expected power of a current, below which it does not move
EFFECTS, LEADS = ("delay", "amplifier_lag", "amplifier_voltage_limit"), ("amplifier_lag",)


def amplified(view: View) -> list[Row]:
    """Gain and delay from the command to the current.

    Eddy currents and all that follows act behind the current; delay and roll-off are those of `delay`, `amplifier_lag`
    and `amplifier_voltage_limit`. A dead band of the command makes the current smaller; so does a limit of the voltage,
    which bends it too, as no scale does. No effect of the library makes the current larger. Only a loop of second order
    with a lead makes it early, by no more than the nominal amplifier's own lag.
    """
    if not _comparable(view) or (lines := _driven(view)) is None:
        return []
    found = _within(view, lines)
    if found is None:
        return []
    lag = 0.0
    if found.misfit > SHAPE:
        source = view.nominal(lines.frequency).amplifier * lines.parts["command"]
        lag, _ = low_pass(lines.parts["current"], source, lines.frequency, view.rate, lines.periodic, found.misfit)
    cut: tuple[str, ...] = ()
    if found.gain[0] < 1:
        cut = ("deadband", "amplifier_voltage_limit") if found.misfit > SHAPE else ("deadband",)
    leads = LEADS if _may_lead(view, found) else ()
    return [
        Row("amplifier", {"current": 1, "command": -1}, float(found.gain[0]), float(found.gain_se[0]), GAIN,
            "the command through the nominal amplifier", float(found.delay[0]), float(found.delay_se[0]),
            DELAY / view.rate, found.misfit, SHAPE, cut, EFFECTS if found.delay[0] > -DELAY / view.rate else leads, lag)
    ]  # fmt: skip


def _may_lead(view: View, found: Fit) -> bool:
    """Whether nothing but the time differs, by no more than the nominal lag, behind a controller without a loop of its
    own about the current."""
    if view.gains is not None and reads_current(view.gains, 1 / view.rig.control_rate):
        return False
    alike = found.misfit <= SHAPE and abs(np.log(np.abs(found.gain[0]))) <= GAIN
    return bool(alike and found.delay[0] > -view.rig.amplifier_time_constant)


def _comparable(view: View) -> bool:
    """Whether command and current are recorded as the amplifier had them."""
    if view.rig is None or not view.rig.controlled or not {"command", "current"} <= view.recorded:
        return False
    return view.periodic or at_control_rate(view)


def _driven(view: View) -> Lines | None:
    """The lines; of a record without a period whose controller reads the current, what the injection or the reference
    drives of them.

    Such a controller feeds the noise of the current back into the command, so that both have it in common.
    """
    lines = view.lines
    if lines.periodic or view.gains is None or not reads_current(view.gains, 1 / view.rig.control_rate):
        return lines
    drives = [name for name in ("injection", "reference") if name in lines.parts and np.ptp(view.channels[name]) > 0]
    if not drives:
        return None
    parts = {name: spectra * lines.parts[drives[0]].conj() for name, spectra in lines.parts.items()}
    return replace(lines, parts=parts, periodic=True)  # means over the segments are compared


def unrelated(view: View) -> list[Finding]:
    """A current that has no part of what the nominal amplifier makes of the command, where that should show."""
    if not _comparable(view) or (lines := _driven(view)) is None or not lines.frequency.size:
        return []
    made = view.nominal(lines.frequency).amplifier * lines.parts["command"]
    power = np.sum(abs(made) ** 2)
    if not power > 0:
        return []
    read = lines.parts["current"]
    if np.sum(abs(read) ** 2) < STILL * power:  # a dead band, or nothing in the channel, and not another coil
        return []
    # Along every line the current may be late, so the lines' sizes are added and not their phases.
    size = abs(np.sum(np.conj(made) * read, axis=0))
    error = np.sqrt(np.sum(abs(made) ** 2 * abs(read) ** 2, axis=0))  # of that size without any relation
    share, chance = float(size.sum() / power), float(error.sum() / power)
    if share > NOTHING or share > BY_CHANCE * chance or chance > NOTHING:
        return []
    text = (
        f"current: column {view.columns.get('current', 'current')!r} has nothing of what the amplifier makes of the "
        f"command ({share:.0%} of it, {chance:.0%} by chance): it is the current of another coil, or another quantity"
    )
    return [Finding("mismatch", view.recording, "current", share, None, text, "contradiction")]


def unstated_pole(view: View) -> list[Finding]:
    """The amplifier's time constant by command and current, where the rig leaves it out and one pole describes them."""
    if not _comparable(view) or not view.amplifier_open or (lines := _driven(view)) is None:
        return []
    found = _tried(view, lines, _times(view, lines))
    if not found:
        return []
    costs = _costs(lines, found)
    best = int(np.argmin(costs))
    time, _, made = found[best]
    possible = [one for one, cost in zip((t for t, *_ in found), costs, strict=True) if cost <= _most(costs, lines)]
    known = 0 < time < max(t for t, *_ in found) and max(possible) - min(possible) <= KNOWN * time
    if not known or made.misfit > SHAPE or abs(made.gain[0] - 1) > GAIN:
        return []
    late, about = float(made.delay[0]) * view.rate, float(f"{time:.2g}")
    beside = f", beside a delay of {late:.1f} samples" if abs(late) > DELAY else ""
    text = (
        f"amplifier_time_constant is not stated: from command to current it is about {about!r} s{beside}; state it in "
        "[parameters] if that is right, or `maglev diagnose` spends an effect on it (amplifier_lag)"
    )
    return [Finding("unstated", view.recording, "current", about, None, text, "not checkable")]


def _within(view: View, lines: Lines) -> Fit | None:
    """Of the fits with a time constant within its tolerance that the lines allow, the nearest to gain 1 and delay 0.

    Where the rig leaves the time constant out, it may be any.
    """
    found = _tried(view, lines, _times(view, lines))
    if not found:
        return None
    costs = _costs(lines, found)
    allowed = [one for (*_, one), cost in zip(found, costs, strict=True) if cost <= _most(costs, lines)]
    return min(allowed, key=lambda f: abs(np.log(abs(f.gain[0]))) / GAIN + abs(f.delay[0]) * view.rate / DELAY)


_Tried = list[tuple[float, np.ndarray, Fit]]  # time constant (s), what the amplifier makes of the command, and the fit


def _tried(view: View, lines: Lines, times: np.ndarray) -> _Tried:
    """A fit of the current for each of the time constants that can be fitted."""
    found = []
    for one in map(float, times):
        amplifier = replace(view, rig=replace(view.rig, amplifier_time_constant=one)).nominal(lines.frequency).amplifier
        source = amplifier * lines.parts["command"]
        made = fit(lines.parts["current"], [source], lines.frequency, view.rate, lines.periodic)
        found += [] if made is None else [(one, source, made)]
    return found


def _times(view: View, lines: Lines) -> np.ndarray:
    """The time constants that are tried, s: within the tolerance, or any with more of them about the best."""
    rig = view.rig
    t, share = rig.amplifier_time_constant, WIDE * rig.tolerance.get("amplifier_time_constant", LAG)
    if not view.amplifier_open:
        return t * (1 + np.linspace(-min(share, 0.9), share, POINTS)) if t else np.zeros(1)
    least, most = (reach / view.rate for reach in REACH)
    most = min(most, PARAMETERS["amplifier_time_constant"]["high"])  # which a slow recording reaches
    times = np.array([0.0, *np.geomspace(least, most, POINTS)])
    found = _tried(view, lines, times)
    best = found[int(np.argmin(_costs(lines, found)))][0] if found else 0.0
    beside = np.minimum(best * np.geomspace(1 / BESIDE, BESIDE, 2 * POINTS), most)
    return np.concatenate([times, beside]) if best else times


def _most(costs: np.ndarray, lines: Lines) -> float:
    """The cost up to which a time constant is possible."""
    return float(costs.min() + ALLOWED * max(1.0, costs.min() / lines.frequency.size))


def _costs(lines: Lines, found: _Tried) -> np.ndarray:
    """Power that each fit leaves, over the noise that the best one leaves: (fits,).

    A fit's own cost is measured by the noise that it leaves itself, by which a bad one looks as good as any.
    """
    out, w = lines.parts["current"], 2 * np.pi * lines.frequency
    rests = [out - one.gain[0] * np.exp(-1j * w * one.delay[0]) * source for _, source, one in found]
    left = [rest.mean(axis=0)[None] if lines.periodic else rest for rest in rests]
    size = (np.abs(out) ** 2).mean(axis=0)
    best = rests[int(np.argmin([(np.abs(rest) ** 2 / np.maximum(size, 1e-300)).sum() for rest in left]))]
    variance = best.var(axis=0, ddof=1)[None] / len(best) if lines.periodic else local_power(best)
    weight = 1 / np.maximum(variance + MODEL**2 * size, 1e-300)
    return np.array([(weight * np.abs(rest) ** 2).sum() for rest in left])
