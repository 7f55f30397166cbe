"""Recordings that could be made after one that was made: louder, elsewhere, other gains, channels or excitations."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from maglev_env.loop.gains import Gains, with_gains
from maglev_env.loop.magnets.kinds import geometric_law
from sim2real.recorded.nominal import outputs_of
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record

OFFSET, GAINS = 0.1, (0.8, 1.3)  # offset as a share of the gap; factors on kp and kd
INJECTED, LINES = 0.02, 40  # peak of a multisine in the bias current, where the rig has no protocol, and its lines


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
    peak = peak or INJECTED * geometric_law(rig).bias_current
    if peak:
        items.append(_beside(base, outputs, peak))
    if base.bias is None and isinstance(base.experiment.gains, Gains):  # its own controller is known
        items += _elsewhere(base, outputs)
    return items


def _beside(base: OpenRecord, outputs: tuple[str, ...], peak: float) -> Item:
    """A random-phase multisine at the current, over the band that is compared, beside what drove the loop."""
    centre, samples = base.windows.centre, base.waves["current"].shape[1]
    frequency = np.geomspace(centre[0], centre[-1], min(LINES, centre.size))
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, (base.axes, frequency.size, 1))
    turn = 2 * np.pi * np.outer(frequency, np.arange(samples)) / base.experiment.rig.control_rate
    wave = np.cos(turn + phase).sum(axis=1)
    wave *= peak / abs(wave).max()
    driven = replace(base, waves={**base.waves, "current": base.waves["current"] + wave})
    change = {"excitation": {"at": "current", "frequencies": frequency.round(3).tolist(), "peak": peak}}
    what = (
        f"a multisine of {peak:.3g} A peak added to the current, {frequency.size} lines from {frequency[0]:.3g} to "
        f"{frequency[-1]:.3g} Hz, beside the same"
    )
    return Item(what, 1.0, driven, outputs, change)


def _periodic_menu(base: Record) -> list[Item]:
    """Beside a periodic recording."""
    rig, has_current = base.nominal, "current" in base.periods
    outputs = ("plant", "amplifier") if has_current else ("plant",)
    items = [Item("the same at twice the amplitude", 1.0, _scaled(base, 2.0), outputs, {"amplitude": 2.0})]
    if rig.controlled:
        if not has_current:
            beside = {"channels": ["current"]}
            items.append(Item("the coil current beside the same channels", 2.0, base, ("plant", "amplifier"), beside))
        items += _elsewhere(base, outputs)
    peaks = {e.at: e.amplitude for e in rig.protocol.excitations} if rig.protocol else {}
    for place, effort, what in (
        ("force", 3.0, "a shaker's force beside the injection"),
        ("current", 1.0, "an injection into the current beside the force"),
    ):
        if place in peaks and not base.driven[place].any() and (rig.controlled or place == "force"):
            driven = _excited(base, place, peaks[place])
            lines = base.lines[driven.driven[place].any(axis=0)].tolist()
            added = {"excitation": {"at": place, "lines": lines, "peak": peaks[place]}}
            items.append(Item(what, effort, driven, outputs, added))
    return items


def _elsewhere(base: Record | OpenRecord, outputs: tuple[str, ...]) -> list[Item]:
    """The same at a static offset, and at other gains."""
    offset = OFFSET * base.nominal.gap
    moved = replace(base, waves={**base.waves, "reference": base.waves["reference"] + offset})
    what = f"the same at a static offset of {OFFSET:.0%} of the gap, the reference recorded".replace("%", " %")
    items = [Item(what, 1.0, moved, outputs, {"offset": offset})]
    gains = base.experiment.gains
    if isinstance(gains, Gains):
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
