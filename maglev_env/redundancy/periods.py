"""Period against period: samples that are missing, two records joined, spikes, drift."""

from itertools import pairwise

import numpy as np
import scipy

from estimation.lines.periods import period_spectra, split_periods
from maglev_env.channels import unit_of
from maglev_env.redundancy.finding import Finding, Kind
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import lines_at

LEAST = 4  # periods
HELD = 0.05  # of a channel's variance that its lines must hold
FAINT = 1e-3  # of the strongest line's power: lines that place no shift
CLEAR = 6.0  # standard errors of a shift between periods
SHIFTED, COPY = 0.5, 0.2  # samples; share of a block's power that may differ from a shifted copy
SPIKE = 14.0  # robust standard deviations; of 1e8 Gaussian samples the largest is 6, a sum of a few sines has 2
STEPS = 4.0  # of a channel's converter: where its steps are larger than the noise, it goes to and fro by single ones
FEW = 3  # periods of which one may be unlike both others by what turns, or hums, beside the lines
OTHER = 20.0  # times the usual power of a period's difference from the others
LEVEL = 1e-5  # probability of a drift under noise alone
AGAIN, COINCIDE = 2, 0.4  # samples at an extreme value; share of the departures beside one of them
LONG = 8  # samples at an extreme value, where there is but one departure
TAPS = 6  # commands from which the current is predicted
JUMP = 0.03  # of the current's range
BENT = 3.0  # standard errors of the lowest lines that a drift bends them by


def jumps(view: View) -> list[Finding]:
    """Where the excitation goes on at another phase: missing or double samples, or another record."""
    if not view.periodic:
        return []
    names, blocks = view.blocks
    if len(blocks) < 3:
        return []
    name = next(
        (n for n in ("injection", "force", "reference", "displacement") if n in view.recorded and n in names), ""
    )
    if not name:
        return []
    samples, every = view.block
    lines = lines_at(view.excitations, {"injection": "current", "force": "force", "reference": "reference"}.get(name))
    if lines.size < 4:
        return []
    spectra = period_spectra(blocks[:, names.index(name)], lines * every)
    held = (np.abs(spectra) ** 2).sum(axis=1) / 2
    if np.median(held / np.maximum(blocks[:, names.index(name)].var(axis=1), 1e-300)) < HELD:
        return []  # the stated lines do not hold the channel's power: another rule says so
    # The block that most others are copies of is the reference: the jump may lie in any one of them.
    tried = [[(p, *_shift(one, other, lines * every, samples)) for p, one in enumerate(spectra)]
             for other in (spectra[1], spectra[-1])]  # fmt: skip
    shifts = max(tried, key=lambda found: sum(rest < COPY for *_, rest in found))
    # A block in which the jump lies is no shifted copy of the others. The rotor's first periods hold its transient.
    first = max(1, view.lines.first) if name == "displacement" else 0
    whole_ones = [(p, shift) for p, shift, rest in shifts[first:] if rest < COPY]
    size = np.abs(spectra[1]) ** 2
    spread = np.sqrt((size * (2 * np.pi * lines * every / samples) ** 2).sum() / size.sum())
    error = float(np.sqrt(np.median([rest for *_, rest in shifts]) / lines.size) / spread)  # of one shift, samples
    loud = size > FAINT * size.max(initial=0.0)
    around = samples / int(np.gcd.reduce((lines * every)[loud]))  # after so many samples these lines repeat
    steps = [(p, q, (b - a + around / 2) % around - around / 2) for (p, a), (q, b) in pairwise(whole_ones)]
    found = [step for step in steps if abs(step[2]) > SHIFTED + CLEAR * error]
    if not found:
        return []
    kind: Kind = "wiring" if name == "displacement" else "contradiction"  # a rotor's phase may change by itself
    halves = [abs(abs(step) - around / 2) < 2 for *_, step in found]
    if all(halves) or len(found) > max(2, len(steps) / 3):
        text = (
            f"time: {name} does not repeat every {samples} samples as stated; check sample_rate ({view.rate:g} Hz) and "
            "the excitation's fundamental"
        )
        return [Finding("lines", view.recording, "time", float(len(found)), None, text, kind)]
    before, after, _ = found[0]
    total = sum(shift for *_, shift in found)
    whole = round(total)
    if not whole:
        return []  # it comes back: noise, or a period that something else disturbed
    what = f"{whole} samples are missing" if whole > 0 else f"{-whole} samples are there twice"
    begin, end = (before + 1) * samples / view.rate, after * samples / view.rate
    text = (
        f"all channels: {what} between {begin:.4g} and {end:.4g} s: from there on {name} runs "
        f"{abs(total):.4g} samples {'ahead' if total > 0 else 'behind'}; two records may be joined there; use a "
        "stretch before or after it (start, samples)"
    )
    return [Finding("missing samples", view.recording, "all channels", float(total), None, text, kind)]


def _shift(one: np.ndarray, other: np.ndarray, lines: np.ndarray, samples: int) -> tuple[float, float]:
    """Samples by which a period runs ahead of another, and the share of its power that is no shifted copy."""
    product = one * other.conj()
    correlation = np.zeros(samples // 2 + 1, complex)
    correlation[lines] = product
    at = int(np.argmax(np.fft.irfft(correlation, samples)))
    shift = -(at if at <= samples // 2 else at - samples)
    w = 2 * np.pi * lines / samples
    for _ in range(5):  # the angles that are left give the fraction
        rest = np.angle(product * np.exp(-1j * w * shift))
        weight = np.abs(product)
        shift += float((weight * w * rest).sum() / (weight * w**2).sum())
    power = (np.abs(one) ** 2).sum()
    left = (np.abs(one - other * np.exp(1j * w * shift)) ** 2).sum()
    return float(shift), float(left / power) if power else 1.0


def _step(view: View, name: str) -> float:
    """Step of the converter that rounds a channel, in its unit; 0 where none is stated."""
    if view.rig is None:
        return 0.0
    steps = {"displacement": view.rig.reading_step} | dict.fromkeys(("command", "current"), view.rig.command_step)
    return steps.get(name, 0.0)


def outliers(view: View) -> list[Finding]:
    """Samples or whole periods of a channel, of those that are used, that are far from those of the other periods."""
    if not view.periodic:
        return []
    names, blocks = view.blocks
    found: list[tuple[int, Finding]] = []
    if len(blocks) < LEAST:
        return []
    samples, first = view.block[0], max(1, view.lines.first)  # a rotor that still rings is left out anyway
    bridged = np.zeros(samples, bool)  # where one channel told nothing, none is as it was read
    if view.masked is not None:
        bridged = split_periods(view.masked[None], samples)[:, 0].any(axis=0)
    for i, name in enumerate(names):
        if name not in view.recorded:
            continue
        rest = blocks[first:, i] - np.median(blocks[first:, i], axis=0)
        rest = rest - np.median(rest, axis=1, keepdims=True)
        rest[:, bridged] = 0.0
        kept = [p for p in range(len(rest)) if p + first not in view.left_out]
        rest = rest[kept]
        if not len(rest):
            continue
        # Of three periods the median is one of them, which then has no noise of its own: neighbours have all of it.
        noise = np.diff(rest, axis=0) / np.sqrt(2) if len(rest) > 1 else rest
        sigma = 1.4826 * float(np.median(np.abs(noise)))
        size = float(np.ptp(blocks[first:, i]))
        if sigma <= 1e-9 * size:
            sigma = max(float(np.median(np.abs(rest[rest != 0]))) if rest.any() else 0.0, 1e-4 * size)
        power, unlike = np.mean(rest**2, axis=1), _unlike(rest)
        worst = float(np.abs(rest).max())
        p, k = np.unravel_index(int(np.argmax(np.abs(rest))), rest.shape)
        when = ((kept[p] + first) * samples + k) / view.rate
        unit = unit_of(name)
        far = worst > max(SPIKE * sigma, 0.01 * size, STEPS * _step(view, name))
        if far and power.max() < OTHER * max(np.median(power), sigma**2):
            text = (
                f"{name}: a spike of {worst:.3g} {unit} at {when:.5g} s, {worst / sigma:.0f} times the noise; leave "
                "its period out (start, samples)"
            )
            found.append((kept[p] + first, Finding("spike", view.recording, name, worst, None, text, "wiring")))
        elif (
            (ratio := float(unlike.max() / max(np.median(unlike), 1e-300))) > OTHER
            and unlike.max() > (0.01 * size) ** 2
            and len(rest) > FEW
        ):
            at = kept[int(np.argmax(unlike))] + first
            text = (
                f"{name}: the period from {at * samples / view.rate:.4g} s on differs from the others by "
                f"{np.sqrt(unlike.max()):.3g} {unit} rms, {np.sqrt(ratio):.0f} times as much as usual; something "
                "happened there, or two records are joined: leave it out (start, samples)"
            )
            found.append((at, Finding("period", view.recording, name, float(np.sqrt(ratio)), None, text, "wiring")))
    return _together(view, found)


def _unlike(periods: np.ndarray) -> np.ndarray:
    """Mean square (P,) of the difference between each of some periods (P, samples) and the one that is most like it,
    for one of the two.

    What turns, or hums, beside the lines differs from period to period, and may be reversed in each second one; but
    none is then unlike all others.
    """
    size = np.mean(periods**2, axis=1)
    apart = size[:, None] + size - 2 * periods @ periods.T / periods.shape[1]
    np.fill_diagonal(apart, np.inf)
    return np.maximum(apart.min(axis=1), 0.0) / 2


def _together(view: View, found: list[tuple[int, Finding]]) -> list[Finding]:
    """Findings of periods; what several channels show in one period is no matter of one channel."""
    at = {period for period, _ in found}
    if len(found) < 2 or len(at) > 1:
        return [f for _, f in found]
    names = " and ".join(f.channel for _, f in found)
    text = (
        f"all channels: the period from {at.pop() * view.block[0] / view.rate:.4g} s on differs from the others in "
        f"{names}: samples are missing there, two records are joined, or something happened; leave it out (start, "
        "samples)"
    )
    return [Finding("period", view.recording, "all channels", found[0][1].value, None, text, "wiring")]


def drifts(view: View) -> list[Finding]:
    """A drift of a channel's mean that bends its lowest lines: d per period adds d / (pi n) to harmonic n."""
    if not view.periodic:
        return []
    names, blocks = view.blocks
    found = []
    if len(blocks) < LEAST:
        return found
    kept = [p for p in range(1, len(blocks)) if p not in view.left_out]
    if len(kept) < LEAST - 1:
        return found
    lines = view.lines
    for i, name in enumerate(names):
        if name not in view.recorded or name not in lines.parts:
            continue
        means = blocks[kept, i].mean(axis=1)
        slope, _, _, p, se = scipy.stats.linregress(kept, means)
        if not (p < LEVEL and slope):
            continue
        parts = lines.parts[name]
        amplitude, noise = np.abs(parts.mean(axis=0)), np.sqrt(parts.var(axis=0).mean(axis=-1) / len(parts))
        bent = abs(slope) / (np.pi * lines.harmonics * view.block[1])
        bad = (bent > BENT * noise) & (bent > 0.01 * amplitude)
        if bad.any():
            top = float(lines.frequency[bad].max())
            unit = unit_of(name)
            text = (
                f"{name}: its mean drifts by {slope:.3g} {unit} per period, which bends its lines up to {top:.4g} Hz "
                f"by {(bent / amplitude).max():.0%}; let it settle, or do not use these lines"
            )
            found.append(
                Finding("drift", view.recording, name, float(slope), (slope - 2 * se, slope + 2 * se), text, "wiring")
            )
    return found


def breaks(view: View) -> list[Finding]:
    """In a recording that never repeats: samples at which the current jumps away from what the command explains.

    What it explains is learned from the record itself: a linear prediction from the last two currents and the commands
    around them, so that a lag or delay of the amplifier is no jump. In a recording slower than its controller, a step
    of the reference acts between two samples in a way that no recorded command tells: what happens there is none.
    """
    if view.periodic or not {"command", "current"} <= view.recorded:
        return []
    u, i = view.channels["command"], view.channels["current"]
    if i.size < 100 * TAPS or not np.ptp(i) or not np.ptp(u):
        return []
    at = np.arange(TAPS, i.size - 1)
    past = np.stack([i[at - 1], i[at - 2], *(u[at - k] for k in range(-1, TAPS)), np.ones(at.size)], axis=1)
    rest = i[at] - past @ np.linalg.lstsq(past, i[at], rcond=None)[0]
    if view.masked is not None:  # a bridge ends in a jump
        rest[np.convolve(view.masked, np.ones(2 * TAPS + 1), "same")[at] > 0] = 0.0
    sigma = 1.4826 * float(np.median(np.abs(rest)))
    worst = float(np.abs(rest).max())
    events = np.flatnonzero(np.abs(rest) > max(SPIKE * sigma, JUMP * float(np.ptp(i))))
    if not events.size:
        return []
    again = np.ptp(events) > TAPS + 2
    found = _cut_off(view, at[events], AGAIN if again else LONG)
    if found or again:  # a nonlinear amplifier departs from any linear prediction again and again
        return found
    wanted = view.channels.get("reference")
    if wanted is not None and np.abs(np.diff(wanted[at[events[0]] - TAPS : at[events[-1]] + 2])).max() > (
        JUMP * np.ptp(wanted)
    ):
        return []
    when = float(at[events[0]]) / view.rate
    text = (
        f"all channels: the current jumps by {worst:.3g} A at {when:.5g} s, {worst / max(sigma, 1e-300):.0f} times as "
        "far as the command explains elsewhere; samples are missing there, or two records are joined"
    )
    return [Finding("missing samples", view.recording, "all channels", None, None, text, "wiring")]


def _cut_off(view: View, events: np.ndarray, least: int) -> list[Finding]:
    """The channel that stands at one extreme value whenever the current departs from what the command explains."""
    for name in ("command", "current"):
        values = view.channels[name]
        near = values[np.minimum(np.maximum(events[:, None] + np.arange(-TAPS, 2), 0), values.size - 1)]
        for level in (values.max(), values.min()):
            times = int((values == level).sum())
            if times >= least and (near == level).any(axis=1).mean() > COINCIDE:
                text = (
                    f"{name}: it is cut off at {level:.4g} A, {times} times, and the current does not follow it there; "
                    "record with less amplitude, or what acted"
                )
                return [Finding("rail", view.recording, name, float(level), None, text, "wiring")]
    return []
