"""What no rotor and no loop can do: move farther than its clearance, or suppress disturbances at every frequency."""

import numpy as np
import scipy

from estimation.lines.frequency_response import pooled_variance
from maglev_env.channels import unit_of
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.masking import MOST_MASKED
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.view import View
from maglev_env.rig.rig import Rig

LARGEST = 0.3  # m, from end to end of the motion of anything that a rig levitates
FREE = 1.05  # of the clearance to both sides
BEYOND = 1.01  # of a converter's range: how well its ends are known
QUIET = 0.1  # of a sensor's noise: how well that is known
LEVEL = 4.0  # standard errors
SETTLED = 0.25  # |S - S of the highest lines| from which the sensitivity has reached its end
LEAST_LINES = 8
LEVELS = 100  # values of a waveform that is no sequence of steps
OFTEN = 8  # times as many samples as at the next level; a sine's outermost level has 2.4 times as many
TOGETHER, STEPPED = 0.95, 10.0  # correlation of slow parts that shows a sign; their range over the stated noise
PARTS, APART = 8, 0.3  # of a record, for a drift; of the command's standard deviation
OF_ONE_COIL = 0.1  # of the bias current: how far the mean current of one coil may be from it
COILS = "electromagnet_pair"  # magnets whose currents are the bias plus and minus that of control
CENTRED, MOVED = 0.04, 1.0  # offsets that count: of the gap, and of the motion's standard deviation


def clearance(view: View) -> list[Finding]:
    """The displacement within the rig's clearance: its range cannot be larger than the way from stop to stop.

    Below a single magnet the clearance is that to the magnet; how far a rotor may fall, no rig file says.
    """
    if "displacement" not in view.recorded:
        return []
    y, column = view.channels["displacement"], view.columns.get("displacement")
    way, farthest = float(np.ptp(y)), float(y[np.argmax(np.abs(y))])
    if view.rig is None:
        text = (
            f"displacement: it moves over {way:.4g} m, farther than anything levitated; state the scale of column "
            f"{column!r}, m per unit of the file"
        )
        far = way > LARGEST
        return [Finding("clearance", view.recording, "displacement", way, None, text, "contradiction")] if far else []
    free = view.rig.clearance
    hangs = view.rig.controlled and "pair" not in view.rig.capabilities
    if hangs and y.mean() > -FREE * free:  # else it is counted from another place than where it rests
        farthest = float(y.max())
    if way > (LARGEST if hangs else 2 * FREE * free):
        text = (
            f"displacement: it moves over {way:.4g} m, and the rig's clearance leaves {2 * free:.4g} m, "
            f"{way / (2 * free):.3g} times less; check the scale (the unit) of column {column!r}"
        )
        return [Finding("clearance", view.recording, "displacement", way / (2 * free), None, text, "contradiction")]
    if abs(farthest) > FREE * free:
        text = (
            f"displacement: it reaches {farthest:.4g} m (its mean is {y.mean():.4g} m), beyond the clearance of "
            f"{free:.4g} m; check the offset of column {column!r}"
        )
        return [Finding("clearance", view.recording, "displacement", float(y.mean()), None, text, "wiring")]
    return []


def still(view: View) -> list[Finding]:
    """A displacement that is quieter than its sensor's noise."""
    if view.rig is None or "displacement" not in view.recorded:
        return []
    moved, noise = float(view.channels["displacement"].std()), view.rig.noise.displacement
    if not 0 < moved < QUIET * noise:
        return []
    text = (
        f"displacement: it moves by {moved:.3g} m rms, and the rig's sensor has a noise of {noise:.3g} m; check the "
        f"scale (the unit) of column {view.columns.get('displacement')!r}"
    )
    return [Finding("scale", view.recording, "displacement", moved / noise, None, text, "wiring")]


def ranges(view: View) -> list[Finding]:
    """Readings and commands within the range of the rig's converters, at which every simulation clips them.

    Converters without a resolution (`adc_bits` = `dac_bits` = 0) have no range.
    """
    rig, found = view.rig, []
    if rig is None or not (rig.adc_bits or rig.dac_bits):
        return []
    ends = {"displacement": (rig.voltage_range / rig.probe_gain, "voltage_range / probe_gain")}
    if rig.controlled:
        ends["command"] = (rig.voltage_range * rig.amplifier_gain, "voltage_range * amplifier_gain")
    for name in ends.keys() & view.recorded:
        (end, of), values = ends[name], np.abs(view.channels[name])
        share = float(np.mean(values > BEYOND * end))
        if not share:
            continue
        unit, size = unit_of(name), float(values.max())
        text = (
            f"{name}: it reaches {size:.4g} {unit}, in {share:.2%} of the samples beyond the +-{end:.4g} {unit} of the "
            f"rig's converters ({of}), where the simulation clips it; correct {of.split()[0]}, {of.split()[-1]} or the "
            f"scale of column {view.columns.get(name)!r}, or set adc_bits = dac_bits = 0 for converters without a range"
        )
        if name == "displacement" and end < rig.clearance:
            text += f"; the clearance is {rig.clearance:.4g} m"
        # A command may be recorded before its converter clips it; a reading comes from behind one.
        refused = name == "displacement" and share > MOST_MASKED
        kind = "contradiction" if refused else "wiring"
        found.append(Finding("range", view.recording, name, size / end, None, text, kind))
    return found


def reversed_coils(view: View) -> list[Finding]:
    """A current beyond the bias of opposed coils, of which one would then have to be reversed."""
    rig, name = view.rig, "current" if "current" in view.recorded else "command"
    if rig is None or rig.magnet != COILS or not rig.bias_current or name not in view.recorded:
        return []
    size, bias = float(np.abs(view.channels[name]).max()), abs(rig.bias_current)
    share = float(np.mean(np.abs(view.channels[name]) > BEYOND * bias))
    if not share:
        return []
    text = (
        f"{name}: it reaches {size:.4g} A, in {share:.2%} of the samples beyond the bias of {bias:.4g} A: one coil's "
        "current changes its sign there, and pulls again; an amplifier that cannot reverse a current leaves that coil "
        "without any: record with less amplitude"
    )
    return [Finding("bias", view.recording, name, size / bias, None, text, "quality")]


def rails(view: View) -> list[Finding]:
    """A channel whose extreme value comes again and again, and hardly any value next to it: it is cut off there.

    Unlike a converter's rail (`masking.clipped_samples`) the signal need not stay there, as a noisy one does not.
    """
    found = []
    for name in ("injection", "command", "current", "displacement", "force"):
        if name not in view.recorded or name in view.railed:  # an alarm says it of those that stay there
            continue
        levels, counts = np.unique(view.channels[name], return_counts=True)
        if levels.size < LEVELS:
            continue  # steps and squares
        ends = [(levels[i], counts[i]) for i, j in ((-1, -2), (0, 1)) if counts[i] >= OFTEN * max(counts[j], 2)]
        if name == "force":  # between the blows of a hammer it rests
            ends = [end for end in ends if end[0] != np.median(view.channels[name])]
        share = sum(count for _, count in ends) / view.channels[name].size
        if not ends:
            continue
        unit = unit_of(name)
        text = (
            f"{name}: it is cut off at {' and '.join(f'{level:.4g}' for level, _ in ends)} {unit}, in {share:.2%} of "
            "the samples; record with less amplitude, or what acted"
        )
        found.append(Finding("rail", view.recording, name, float(share), None, text, "wiring"))
    return found


def balance(view: View) -> list[Finding]:
    """Mean displacement and mean current of a pair of magnets: at rest the current's pull balances the stiffness.

    Only for recordings that never repeat, whose operating point enters the comparison with a simulation.
    """
    rig = view.rig
    if (
        view.periodic
        or rig is None
        or "pair" not in rig.capabilities
        or not {"displacement", "current"} <= view.recorded
    ):
        return []
    gain, stiffness = linearise(force_law(rig))
    held = stiffness + rig.support_stiffness
    y, i = view.channels["displacement"], view.channels["current"]
    off = y - gain * i / held if held else np.zeros_like(y)  # where the current alone holds the rotor, any fits
    found = []
    if said := _apart(off, max(CENTRED * rig.gap, MOVED * float(y.std())), 0.5 * CENTRED * rig.gap, "m"):
        text = (
            f"displacement or current: their means ({y.mean():.3g} m, {i.mean():.3g} A) {said[1]}; check both columns"
            f"{_of_one_coil(rig, i)}; or an effect (eccentricity, actuator_offset) or a static load: run `maglev "
            "diagnose`"
        )
        found.append(Finding(said[0], view.recording, "displacement or current", said[2], None, text, "effect"))
    means = [np.array([part.mean() for part in np.array_split(v, PARTS)]) for v in (y, i)]
    together = float(np.corrcoef(*means)[0, 1]) if min(map(np.ptp, means)) > 0 else 0.0
    expected = np.sign(gain * held)
    if together * expected < -TOGETHER and np.ptp(means[0]) > STEPPED * rig.noise.displacement:
        text = (
            "displacement or current: its sign is reversed: their slow parts move "
            f"{'together' if together > 0 else 'against each other'}, where nominal magnets do the opposite: "
            "check the signs of both columns"
        )
        found.append(Finding("sign", view.recording, "displacement or current", -1.0, None, text, "wiring"))
    if "command" in view.recorded:
        u = view.channels["command"]
        least = max(APART * float(u.std()), 5 * rig.noise.current)
        if said := _apart(i - u, least, least, "A"):
            text = (
                f"command or current: their means ({u.mean():.3g} and {i.mean():.3g} A) {said[1]}, and an amplifier "
                f"keeps the mean; check both columns{_of_one_coil(rig, i)}"
            )
            found.append(Finding(said[0], view.recording, "command or current", said[2], None, text, "wiring"))
    return found


def _of_one_coil(rig: Rig, current: np.ndarray) -> str:
    """What is said of the mean of a pair's current (samples,) that is the bias: it is the whole one of one coil."""
    mean, bias = float(current.mean()), rig.bias_current
    if not bias or abs(abs(mean) - bias) > OF_ONE_COIL * bias:
        return ""
    more = f"{-np.copysign(bias, mean):.3g}"
    return f" (the mean current is the bias, as in one coil: offset = {more} A more makes it the deviation)"


def _apart(off: np.ndarray, level: float, least: float, unit: str) -> tuple[str, str, float] | None:
    """Code, words and size of a difference (samples,) that should be zero: a drift above `least`, or a mean above
    `level`; None where it is neither."""
    parts = np.array([part.mean() for part in np.array_split(off, PARTS)])
    drift, _, _, _, se = scipy.stats.linregress(np.linspace(-0.5, 0.5, PARTS), parts)
    mean, drift = float(parts.mean()), float(drift)
    if abs(drift) > max(least, LEVEL * se, abs(mean)):
        return "drift", f"drift apart, by {drift:.3g} {unit} over the recording", drift
    if abs(mean) > level:
        return "balance", f"do not fit each other, by {mean:.3g} {unit}", mean
    return None


def sensitivity(view: View) -> list[Finding]:
    """Command per injection: far above the loop's bandwidth it is 1, and its peak is at least 1.

    The integral of ln|S| over all frequencies is zero or positive for every loop whose gain falls off like a rotor's
    (Bode; Freudenberg and Looze 1985 with unstable poles). So where |S| is below 1 at all measured lines, and has
    come to rest at the highest of them, command and injection have different scales.
    """
    if not view.periodic or not {"command", "injection"} <= view.recorded:
        return []
    lines = view.lines.at(view.place("current"))
    if lines.frequency.size < LEAST_LINES:
        return []
    u, j = lines.parts["command"], lines.parts["injection"]
    if not np.abs(j.mean(axis=0)).all():
        return []
    s = u.mean(axis=0) / j.mean(axis=0)
    rest = (u - s * j).var(axis=0, ddof=1) / len(u) / np.abs(j.mean(axis=0)) ** 2
    error = np.sqrt(pooled_variance(rest))
    size = np.abs(s)
    peak = float((size + LEVEL * error).max())
    if peak >= 1:
        return []
    top = slice(-max(LEAST_LINES // 2, s.size // 10), None)
    end = float(np.mean(size[top]))
    text = (
        f"command or injection: the peak of |S| over {s.size} lines is {size.max():.3g}, below 1, which no loop with a "
        "rotor can have (Bode's integral)"
    )
    if np.abs(s[top] - s[top].mean()).max() < SETTLED * end:
        text += f"; at {lines.frequency[-1]:.4g} Hz it rests at {end:.3g} and should be 1; check both scales"
        return [Finding("sensitivity", view.recording, "command or injection", float(size.max()), None, text,
                        "contradiction")]  # fmt: skip
    text = (
        f"injection: |S| stays below 1 ({size.max():.3g} at most) up to {lines.frequency[-1]:.4g} Hz: its peak lies "
        "higher, so the peak and the zone that are printed are too good; inject at higher frequencies"
    )
    return [Finding("sensitivity", view.recording, "injection", float(size.max()), None, text, "quality")]
