"""A recording of the benchmark made again as a diagnosis asks for it."""

from collections.abc import Mapping
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np

from sim2real.blind.benchmark.drives import Drive
from sim2real.blind.benchmark.generate import Made, disturbed
from sim2real.blind.benchmark.simulate import Recording, simulate
from sim2real.blind.benchmark.write import Recorded


def again(made: Made, of: str, change: Mapping[str, Any], number: int, seed: int) -> Recorded:
    """The recording that a change of one that was made asks for.

    Args:
        made: The case.
        of: File of the recording to be changed; empty: the first.
        change: As `next_experiments` of a diagnosis states it.
        number: Of the new recording, from 1 on.
        seed: Of the set.

    Raises:
        LoopFailed: The rotor touches its stops.
        KeyError: The change is not known.
    """
    base = next((r for r in made.recordings if f"{r.name}.npz" == of), made.recordings[0])
    rng = np.random.default_rng([seed, made.case.number, 1000 + number])
    if unknown := set(change) - {"amplitude", "length", "offset", "gains", "excitation", "channels", "speed"}:
        raise KeyError(f"what is changed by {', '.join(unknown)} is not known")
    times = change.get("length", 1)
    drives = {"drive": _longer(base.drive, times), "beside": base.beside and _longer(base.beside, times)}
    changed = replace(base, name=f"next{number}", role="fit", **drives)
    if "amplitude" in change:
        changed = replace(changed, drive=replace(changed.drive, wave=change["amplitude"] * changed.drive.wave))
    if "offset" in change:
        changed = replace(changed, offset=change["offset"])
    if "gains" in change:
        kp, kd = change["gains"]
        pid = {**base.controller.pid, "kp": kp * base.controller.pid["kp"], "kd": kd * base.controller.pid["kd"]}
        changed = replace(changed, controller=replace(base.controller, pid=pid))
    if "speed" in change:
        changed = replace(changed, speed=change["speed"] * base.speed)
    if "excitation" in change:
        changed = _excited(changed, change["excitation"], made.truth.rig.parameters["control_rate"], rng)
    noise, drops = (int(n) for n in rng.integers(2**62, size=2))
    # A drive that is not stored says nothing of what was added to it.
    return Recorded(changed, True, simulate(disturbed(made), changed, noise, drops), tuple(change.get("channels", ())))


def _longer(drive: Drive, times: int) -> Drive:
    """A drive that repeats itself so many times, with as many more periods where it has any."""
    return replace(drive, wave=np.tile(drive.wave, times), periods=times * drive.periods)


def _excited(base: Recording, asked: Mapping[str, Any], rate: float, rng: np.random.Generator) -> Recording:
    """With a multisine of random phases: on lines that nothing else drives any more, or beside what never repeats."""
    own, samples = base.drive, base.drive.wave.size
    if "lines" in asked:
        period = samples // own.periods
        spectrum = np.fft.rfft(own.wave[-period:])
        spectrum[list(asked["lines"])] = 0.0
        kept = tuple(n for n in own.lines if n not in asked["lines"])
        left = replace(own, wave=np.tile(np.fft.irfft(spectrum, period), own.periods), lines=kept)
        lines, shape, fundamental = tuple(asked["lines"]), "multisine", rate / period
        frequency = np.array(lines) * fundamental
    else:
        left, frequency = own, np.array(asked["frequencies"])
        lines, shape, fundamental = (), "noise", 0.0
    phase = rng.uniform(0, 2 * pi, (frequency.size, 1))
    wave = np.cos(2 * pi * np.outer(frequency, np.arange(samples) / rate) + phase).sum(axis=0)
    wave *= asked["peak"] / np.abs(wave).max()
    added = Drive(shape, asked["at"], wave, lines, fundamental, own.direction, own.periods)
    if shape == "noise" and own.at == asked["at"]:
        return replace(base, drive=replace(own, shape=shape, wave=own.wave + added.wave))
    if not left.lines and shape == "multisine":
        return replace(base, drive=added)
    return replace(base, drive=left, beside=added)
