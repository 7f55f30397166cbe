"""What drives the simulation of a recording without a period, and the controller under which it is simulated.

Where the controller is known and its command is recorded at every control sample, what was added to the command is
known exactly: w = command - C(-displacement). Otherwise a stand-in controller C' closes the simulated loop, and the
recorded current (or command) u drives it: u_s = u + C'(y - y_s), with the recorded displacement y and the simulated one
y_s. That holds for any C' that stabilises the loop. Sensor noise n that the true controller C has fed back is then part
of the drive as (C' - C) n, so C' is fitted to the record where a linear controller explains it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, pi, sqrt

import numpy as np
from scipy.interpolate import CubicSpline

from maglev_env.design.default_gains import default_gains, pole_placed
from maglev_env.experiment import Experiment, sampling
from maglev_env.linear.loop import closed_loop_poles, without_noise
from maglev_env.loop.effect import EFFECTS
from maglev_env.loop.gains import NO_CONTROLLER, Controller, Gains, limited, of_axis, reads_current
from maglev_env.loop.linear_controller import LinearController
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.rig.rig import Rig, axis_rig
from sim2real.controller_output import controller_output, referred

STIFF, DAMPED = 8.0, 0.8  # of the designed stand-in: net stiffness in that of the magnets, and damping ratio
FASTEST = 30.0  # its control samples in a cycle of the mode that it makes
TAPS = 4  # present and past readings that a fitted controller uses
PAST = 2  # past outputs that it uses
FITTED = 0.9  # share of the current's variance from which a fitted controller is the stand-in
LEAK = 100.0  # time constant of the designed stand-in's leak, in integral times
UNLIMITED = 1e4  # V: range of the converters of a stand-in
NEAREST = 0.98  # of the gap: how near the simulated rotor may come to a magnet
INSIDE = 0.9999  # largest pole of a fitted controller


@dataclass(frozen=True)
class Driving:
    """What drives a simulation.

    Args:
        waves: place -> (axes, samples * every) of "force" (N), "current" (A) and "reference" (m), at the control rate.
        command: (axes, samples), of the controller from the recorded readings, with the injection.
        added: (axes, samples), what of the command does not depend on the readings.
    """

    waves: Mapping[str, np.ndarray]
    command: np.ndarray
    added: np.ndarray


@dataclass(frozen=True)
class Drive:
    """What a recording is simulated with.

    Args:
        experiment: the rig without noise and converters, under the controller that closes the simulated loop.
        source: the channel, "command" or "current", from which the injection follows; None: the recorded injection and
            reference drive the loop.
        stand_in: whether the controller stands in for one that is not known.
        held: whether the source and the force are held between samples; else they are straight lines.
        multiple: every how many recorded samples one is compared.
        every: control samples of the experiment for each compared sample.
        upstream: effects that act before what drives the loop, and therefore do not show.
        notes: what was assumed.
    """

    experiment: Experiment
    source: str | None = None
    stand_in: bool = False
    held: bool = True
    multiple: int = 1
    every: int = 1
    upstream: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()

    def driving(self, channels: Mapping[str, np.ndarray]) -> "Driving":
        """What drives the simulation of channels -> (axes, samples), every `multiple`-th recorded sample."""
        e, y = self.experiment, channels["displacement"]
        dt, samples, nothing = 1 / e.rig.control_rate, y.shape[1], np.zeros_like(y)
        ticks = {name: channels[name] for name in ("displacement", "current") if name in channels}
        if self.every > 1:
            at = np.arange(samples * self.every) / self.every
            ticks = {"displacement": CubicSpline(np.arange(samples), y, axis=1)(at)}
        reference = self._between(channels.get("reference", nothing))
        if self.source is not None and not limited(e.gains, dt):
            reference = np.zeros_like(reference)  # what it causes is part of the injection that follows
        of = [of_axis(e.gains, axis) for axis in range(len(y))]
        output = np.array([
            controller_output(c, dt=dt, reference=r, **{name: values[axis] for name, values in ticks.items()})
            for axis, (c, r) in enumerate(zip(of, reference, strict=True))
        ])  # fmt: skip
        if self.source is None:
            injection = self._between(channels.get("injection", nothing))
        else:
            injection = self._between(channels[self.source]) - output
        caused = np.array([referred(c, r, dt) for c, r in zip(of, reference, strict=True)])
        waves = {
            "force": self._between(channels.get("force", nothing)),
            "current": injection,
            "reference": reference,
        }
        sampled = slice(None, None, self.every)
        return Driving(waves, (output + injection)[:, sampled], (injection + caused)[:, sampled])

    def between(self, frequency: np.ndarray) -> np.ndarray:
        """Spectrum of the drive at the control rate over that of its samples, at frequencies in Hz, any shape."""
        rate = self.experiment.rig.control_rate / self.every
        share = np.arange(self.every) / self.every
        z = np.exp(2j * pi * frequency[..., None] / rate)
        toward = np.zeros(self.every) if self.held else share + 0.5 / self.every
        return np.mean(z**-share * (1 + toward * (z - 1)), axis=-1)

    def _between(self, series: np.ndarray) -> np.ndarray:
        """Values (axes, samples * every) over each control sample: held, or the mean of a straight line over it."""
        if self.held:
            return np.repeat(series, self.every, axis=1)
        following = np.concatenate([series[:, 1:], series[:, -1:]], axis=1)
        share = (np.arange(self.every) + 0.5) / self.every
        return (series[..., None] + (following - series)[..., None] * share).reshape(len(series), -1)


def drive_of(rig: Rig, spec: RecordingSpec, channels: Mapping[str, np.ndarray], known: bool = True) -> Drive:
    """What drives a recording.

    Args:
        rig: as the campaign states it.
        spec: the recording.
        channels: channel -> (axes, samples) at the recording's rate.
        known: whether the stated controller is what made the command of these channels.

    Raises:
        ValueError: nothing that is known drives the recording; the message says what to record.
    """
    try:
        multiple, every = sampling(spec.sample_rate, rig.control_rate)
    except ValueError:
        multiple, every = 1, 0
    if known and every == 1 and (spec.gains is not None or rig.support_stiffness > 0 or not rig.controlled):
        gains = spec.gains if spec.gains is not None else NO_CONTROLLER
        if not rig.adc_bits and not rig.dac_bits:  # ideal converters have no range either
            rig = replace(rig, voltage_range=UNLIMITED)
        e = without_noise(Experiment(rig, gains, (), speed_rpm=spec.speed_rpm))
        if reads_current(gains, 1 / rig.control_rate) and "current" not in channels:
            raise ValueError(
                "its controller reads the current, but the channel current is missing: the command does not follow "
                "from the displacement alone; record the current that the controller reads"
            )
        if rig.controlled and "command" in channels:
            read = "displacement and the current" if reads_current(gains, 1 / rig.control_rate) else "displacement"
            note = f"what drove the loop is the command less what the stated controller makes of the {read}"
            return Drive(e, "command", multiple=multiple, notes=(note,))
        if any(
            np.ptp(channels[name], axis=1).any() for name in ("force", "injection", "reference") if name in channels
        ):
            return Drive(e, multiple=multiple)
    source = next((name for name in ("current", "command") if rig.controlled and name in channels), None)
    if source is None and rig.controlled:
        raise ValueError(
            "nothing that is known drives this recording; record the current in the coil, or the command at the "
            "control rate (with the gains, what was added to it follows), or the injection, reference or force"
        )
    return _stood_in(rig, spec, channels, source, every)


def _stood_in(
    rig: Rig, spec: RecordingSpec, channels: Mapping[str, np.ndarray], source: str | None, every: int
) -> Drive:
    """The loop under a stand-in controller, driven by the measured current or command, or by the force alone.

    Args:
        source: "current", "command", or None for a rig without magnets.
        every: control samples of the rig for each recorded one; 0 where the rates do not fit.
    """
    finer = _finer(rig, spec.sample_rate)
    upstream = frozenset(n for n, card in EFFECTS.items() if card.block in ("controller", "amplifier"))
    upstream = upstream if source == "current" else frozenset()
    rig = replace(
        rig,
        control_rate=finer * spec.sample_rate,
        voltage_range=UNLIMITED,
        clearance=NEAREST * rig.gap if rig.controlled else rig.clearance,  # the recorded rotor did not touch down
        gains=None,
        amplifier_time_constant=0.0 if source == "current" else rig.amplifier_time_constant,
        effects={name: values for name, values in rig.effects.items() if name not in upstream},
    )
    held = spec.intersample == "zoh" or (spec.intersample is None and source == "command" and every == 1)
    between = "held" if held else "straight lines"
    if source is None:
        e = without_noise(Experiment(rig, NO_CONTROLLER, (), speed_rpm=spec.speed_rpm))
        return Drive(e, held=held, every=finer, notes=(f"the force is taken as {between} between samples",))
    y = channels["displacement"]
    reference = channels.get("reference", np.zeros_like(y))
    controllers, how = [], []
    for axis, series in enumerate(zip(channels[source], reference, y, strict=True)):
        own, found = axis_rig(rig, axis), fitted_controller(*series)
        fits = found is not None and _stable(own, _slowed(found, finer))
        controllers.append(_slowed(found, finer) if fits else _designed(own))
        how.append("one fitted to this recording" if fits else "one designed for the nominal rig")
    gains = controllers[0] if rig.axes == 1 else tuple(controllers)
    e = without_noise(Experiment(rig, gains, (), speed_rpm=spec.speed_rpm))
    note = (
        f"the recorded {source} drives the simulation ({between} between samples); "
        f"{' and '.join(sorted(set(how)))} stands in for the controller"
    )
    return Drive(e, source, True, held, every=finer, upstream=upstream, notes=(note,))


def fitted_controller(command: np.ndarray, reference: np.ndarray, displacement: np.ndarray) -> LinearController | None:
    """The linear controller that explains a command or current by the readings; None where none explains it.

    The least-squares regression of each sample on PAST earlier ones and on TAPS readings and references.

    Args:
        command: (samples,), A.
        reference: (samples,), m.
        displacement: (samples,), m.
    """
    n = command.size - TAPS
    if n < 20 * (PAST + 2 * TAPS):
        return None

    def past(signal: np.ndarray, first: int, count: int) -> np.ndarray:
        return np.stack([signal[TAPS - k : TAPS - k + n] for k in range(first, first + count)], axis=1)

    columns = np.concatenate(
        [past(command, 1, PAST), past(-displacement, 0, TAPS), past(reference, 0, TAPS), np.ones((n, 1))], axis=1
    )
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    target = command[TAPS:]
    found = np.linalg.lstsq(columns / scale, target, rcond=None)[0] / scale
    left = target - columns @ found
    if left.var() > (1 - FITTED) * target.var():
        return None
    denominator = np.array([1.0, *-found[:PAST]])
    roots = np.roots(denominator)
    if np.abs(roots).max(initial=0.0) > INSIDE:
        roots = np.where(np.abs(roots) > INSIDE, roots * (INSIDE / np.abs(roots)), roots)
        denominator = np.real(np.poly(roots))
    denominator = np.pad(denominator, (0, max(0, TAPS - denominator.size)))
    return LinearController(tuple(map(float, found[PAST : PAST + TAPS])), tuple(map(float, denominator)))


def _designed(rig: Rig) -> Gains:
    """Stiff gains with an integrator that hardly leaks: the simulated mass follows the recorded one closely, whatever
    the offsets of the channels are; default gains where lags forbid that."""
    gain, stiffness = linearise(force_law(rig))
    stiff = pole_placed(rig, gain, stiffness or -rig.support_stiffness, STIFF, DAMPED, 0.1, 2.0)
    for gains in (stiff, default_gains(rig)):
        slow = LEAK * gains.ti
        found = replace(gains, ki=LEAK * gains.kp, ti=slow)
        if _stable(rig, found):
            return found
    return default_gains(rig)


def _slowed(controller: LinearController, finer: int) -> LinearController:
    """The controller with the same response at a control rate `finer` times as high: z becomes z^finer."""
    if finer == 1:
        return controller

    def spread(values: tuple[float, ...]) -> tuple[float, ...]:
        found = np.zeros((len(values) - 1) * finer + 1)
        found[::finer] = values
        return tuple(map(float, found))

    return LinearController(spread(controller.numerator), spread(controller.denominator))


def _stable(rig: Rig, controller: Controller) -> bool:
    return bool(np.abs(closed_loop_poles(Experiment(rig, controller, ()))).max() < INSIDE)


def _finer(rig: Rig, rate: float) -> int:
    """Control samples of the stand-in for each recorded one."""
    own = [axis_rig(rig, axis) for axis in range(rig.axes)]
    stiffness = [abs(r.support_stiffness + (linearise(force_law(r))[1] if r.controlled else 0.0)) for r in own]
    fastest = max(sqrt(STIFF * k / r.mass) for k, r in zip(stiffness, own, strict=True))
    return max(1, ceil(FASTEST * fastest / (2 * pi) / rate))
