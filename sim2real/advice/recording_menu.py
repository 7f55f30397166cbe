"""Recordings that could be made after one that was made: louder, elsewhere, other gains, channels or excitations."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimation.lines.line_windows import WIDTH
from maglev_env.experiment import axis_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import PidGains, with_gains
from maglev_env.loop.magnets.kinds import geometric_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.rig.rig import Rig
from sim2real.recorded.nominal import outputs_of
from sim2real.recorded.open_record import TOP, OpenRecord
from sim2real.recorded.records import Record

GAINS = (0.8, 1.3)  # factors on kp and kd
OFFSETS = {0.1: 1.0, 0.16: 1.1, 0.25: 1.2}  # share of the gap -> effort: farther out a touchdown is nearer
ROOM = 0.5  # of the clearance that an offset may use
INJECTED, LINES = 0.02, 40  # peak of a multisine in the bias current, where the rig has no protocol, and its lines
EFFORT = {"current": 1.0, "force": 3.0}  # of an excitation there, see `Item`
WIRED = 2.0  # effort of a channel that is wired for the recording
SPARE = 0.3  # of the largest command that the converter can give: what an injection may use of it
ABOVE = 0.2  # peak, in the bias current, of a multisine above the band that was driven: it hardly moves the rotor


@dataclass(frozen=True)
class Item:
    """A recording that could be made.

    Attributes:
        what: In words.
        effort: Relative: 1 for a change of software, 2 of wiring, 3 of hardware.
        record: The recording as it would be.
        outputs: Outputs that it would show.
        change: What differs from the one that was made, see `proposal.Choice`.
    """

    what: str
    effort: float
    record: Record | OpenRecord
    outputs: tuple[str, ...]
    change: Mapping[str, Any]


def menu(base: Record | OpenRecord) -> list[Item]:
    """Recordings that could be made in addition to one that was made."""
    return _open_menu(base) if isinstance(base, OpenRecord) else _periodic_menu(base)


def _open_menu(base: OpenRecord) -> list[Item]:
    """Beside a recording that never repeats. What a stand-in controller would do at other gains nobody knows."""
    rig, outputs = base.nominal, outputs_of("current" in base.series, base.experiment)
    items = [Item("the same at twice the amplitude", 1.0, _scaled(base, 2.0), outputs, {"amplitude": 2.0})]
    if not rig.controlled:
        return items
    peak = next((e.amplitude for e in rig.protocol.excitations if e.at == "current"), 0.0) if rig.protocol else 0.0
    peak = peak or _injected(rig, INJECTED)
    centre = base.windows.centre
    band = np.geomspace(centre[0], centre[-1], min(LINES, centre.size))
    if peak:
        items.append(_with_sines(base, outputs, "current", peak, band))
    items += (above := _open_above(base, outputs))
    if "current" not in base.series:
        items += [_with_current(base), *map(_with_current_too, above)]
    if not np.ptp(base.waves["force"], axis=1).any() and (force := _shaken(base, band)):
        items.append(_with_sines(base, outputs, "force", force, band))
    if base.bias is None and isinstance(base.experiment.gains, PidGains):  # its own controller is known
        items += _elsewhere(base, outputs)
    return items


def _with_current(base: Record | OpenRecord) -> Item:
    beside, outputs = {"channels": ["current"]}, outputs_of(True, base.experiment)
    return Item("the coil current beside the same channels", WIRED, base, outputs, beside)


def _with_current_too(item: Item) -> Item:
    """An item of the menu where the coil current is wired for it."""
    outputs = outputs_of(True, item.record.experiment)
    what = f"{item.what}, the coil current recorded too"
    return Item(what, WIRED, item.record, outputs, {**item.change, "channels": ["current"]})


def _shaken(base: Record | OpenRecord, frequency: np.ndarray) -> float:
    """Peak of a force (N) at frequencies (Hz) that moves the rotor about as far as it moved; 0 where no shaker reaches
    it, as a ball below its coil.
    """
    if isinstance(geometric_law(base.nominal), SingleSidedLaw):
        return 0.0
    moved = base.series["displacement"]
    peak = float(abs(moved - moved.mean(axis=1, keepdims=True)).max())
    answer = np.array(
        [loop_response(axis_experiment(base.experiment, a), frequency).receptance for a in range(base.axes)]
    )
    return peak / float(np.sqrt(np.mean(abs(answer) ** 2)))


def _open_above(base: OpenRecord, outputs: tuple[str, ...]) -> list[Item]:
    """The same with a multisine above the band that is compared, where all of its coordinates are."""
    peak, windows = _injected(base.nominal, ABOVE), base.windows
    count = int((TOP * windows.samples - 1) // WIDTH)
    if not peak or count <= windows.count or windows.turned is not None or not base.excited.all() or base.unsure:
        return []
    wider = replace(windows, count=count)
    frequency = np.geomspace(windows.centre[-1], wider.centre[-1], min(LINES, count - windows.count) + 1)[1:]
    return [_with_sines(replace(base, windows=wider), outputs, "current", peak, frequency)]


def _injected(rig: Rig, share: float) -> float:
    """Peak (A) of an injection: a share of the bias current, as far as the converter has room for it."""
    ideal = rig.adc_bits == rig.dac_bits == 0
    most = np.inf if ideal else rig.voltage_range * rig.amplifier_gain
    return min(share * geometric_law(rig).bias_current, SPARE * most)


def _with_sines(base: OpenRecord, outputs: tuple[str, ...], place: str, peak: float, frequency: np.ndarray) -> Item:
    """The same with a random-phase multisine at a place beside what drove the loop."""
    samples = base.waves[place].shape[1]
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, (base.axes, frequency.size, 1))
    turn = 2 * np.pi * np.outer(frequency, np.arange(samples)) / base.experiment.rig.control_rate
    wave = np.cos(turn + phase).sum(axis=1)
    wave *= peak / abs(wave).max()
    driven = replace(base, waves={**base.waves, place: base.waves[place] + wave})
    change = {"excitation": {"at": place, "frequencies": frequency.round(3).tolist(), "peak": peak}}
    where = f"{peak:.3g} A peak added to the current" if place == "current" else f"{peak:.3g} N peak, a measured force"
    what = (
        f"a multisine of {where}, {frequency.size} lines from {frequency[0]:.3g} to {frequency[-1]:.3g} Hz, beside the "
        "same"
    )
    return Item(what, EFFORT[place], driven, outputs, change)


def _periodic_menu(base: Record) -> list[Item]:
    """Beside a periodic recording."""
    rig, has_current = base.nominal, "current" in base.periods
    outputs = ("plant", "amplifier") if has_current else ("plant",)
    items = [Item("the same at twice the amplitude", 1.0, _scaled(base, 2.0), outputs, {"amplitude": 2.0})]
    if rig.controlled:
        items += (above := _above(base, outputs))
        if not has_current:
            items += [_with_current(base), *map(_with_current_too, above)]
        items += _elsewhere(base, outputs)
    if rig.protocol:
        peaks = {e.at: e.amplitude for e in rig.protocol.excitations}
    else:
        peaks = {"force": _shaken(base, base.frequency)} if rig.controlled else {}
    for place, what in (
        ("force", "a shaker's force beside the injection"),
        ("current", "an injection into the current beside the force"),
    ):
        if peaks.get(place) and not base.driven[place].any() and (rig.controlled or place == "force"):
            driven = _excited(base, place, peaks[place])
            lines = base.lines[driven.driven[place].any(axis=0)].tolist()
            added = {"excitation": {"at": place, "lines": lines, "peak": peaks[place]}}
            items.append(Item(what, EFFORT[place], driven, outputs, added))
    return items


def _above(base: Record, outputs: tuple[str, ...]) -> list[Item]:
    """The same with a multisine above the lines that were driven, which tells apart what lags in another manner."""
    peak, n = _injected(base.nominal, ABOVE), base.waves["current"].shape[1]
    e = base.experiment
    last, highest = int(TOP * e.recorded_per_period), int(base.lines[base.excited].max(initial=0))
    lines = np.unique(np.geomspace(highest, last, LINES + 1).round().astype(int)[1:]) if 0 < highest < last else []
    if not peak or len(lines) < 2:
        return []
    all_lines = np.arange(1, last + 1)
    driven = {at: np.pad(on, ((0, 0), (0, last - on.shape[1]))) for at, on in base.driven.items()}
    driven["current"] = driven["current"] | np.isin(all_lines, lines)
    spectrum = np.zeros((base.axes, n // 2 + 1), complex)
    spectrum[:, lines] = np.exp(2j * np.pi * np.random.default_rng(0).random((base.axes, len(lines))))
    wave = np.fft.irfft(spectrum, n, axis=1)
    waves = {**base.waves, "current": base.waves["current"] + wave * (peak / abs(wave).max())}
    record = replace(base, lines=all_lines, frequency=all_lines * e.fundamental, driven=driven, waves=waves)
    what = (
        f"a multisine of {peak:.3g} A peak added to the current, {len(lines)} lines from "
        f"{lines[0] * e.fundamental:.3g} to {last * e.fundamental:.3g} Hz, beside the same"
    )
    change = {"excitation": {"at": "current", "lines": [int(n) for n in lines], "peak": peak}}
    return [Item(what, 1.0, record, outputs, change)]


def _elsewhere(base: Record | OpenRecord, outputs: tuple[str, ...]) -> list[Item]:
    """The same at a static offset, and at other gains."""
    items = []
    for share, effort in OFFSETS.items():
        offset = share * base.nominal.gap
        if offset > ROOM * base.nominal.clearance:
            continue
        moved = replace(base, waves={**base.waves, "reference": base.waves["reference"] + offset})
        what = f"the same at a static offset of {100 * share:.2g} % of the gap, the reference recorded"
        items.append(Item(what, effort, moved, outputs, {"offset": offset}))
    gains = base.experiment.gains
    if isinstance(gains, PidGains):
        kp, kd = GAINS
        experiment = replace(base.experiment, gains=with_gains(gains, kp=kp * gains.kp, kd=kd * gains.kd))
        other = replace(base, experiment=experiment)
        items.append(Item(f"the same with kp x {kp}, kd x {kd}", 1.0, other, outputs, {"gains": list(GAINS)}))
    return items


def _scaled(base: Record | OpenRecord, factor: float) -> Record | OpenRecord:
    reference = base.waves["reference"]
    waves = {place: wave * factor for place, wave in base.waves.items() if place != "reference"}
    steady = reference.mean(axis=1, keepdims=True)
    return replace(base, waves={**waves, "reference": steady + factor * (reference - steady)})


def _excited(base: Record, place: str, peak: float) -> Record:
    """The record with a random-phase multisine on lines that nothing drives, odd ones if there are any.

    Where all lines are driven, every second one is taken over.
    """
    rng = np.random.default_rng(0)
    free = base.lines[~base.excited]
    lines = odd if (odd := free[free % 2 == 1]).size else free
    if not lines.size:
        lines = base.lines[base.excited][1::2]
    n = base.waves[place].shape[1]
    waves = {at: _without(wave, lines) if at != "reference" else wave for at, wave in base.waves.items()}
    spectrum = np.zeros((base.axes, n // 2 + 1), complex)
    spectrum[:, lines] = np.exp(2j * np.pi * rng.random((base.axes, lines.size)))
    wave = np.fft.irfft(spectrum, n, axis=1)
    wave *= peak / abs(wave).max()
    taken = np.isin(base.lines, lines)
    driven = {at: on & ~taken for at, on in base.driven.items()}
    driven[place] = np.repeat(taken[None], base.axes, axis=0)
    return replace(base, waves={**waves, place: wave}, driven=driven)


def _without(wave: np.ndarray, lines: np.ndarray) -> np.ndarray:
    spectrum = np.fft.rfft(wave, axis=1)
    spectrum[:, lines] = 0.0
    return np.fft.irfft(spectrum, wave.shape[1], axis=1)
