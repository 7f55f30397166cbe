"""What drives the simulation of a recording without a period, and the controller under which it is simulated.

Where the controller is known and its command is recorded at every control sample, what was added to the command is
known exactly: w = command - C(-displacement). Otherwise a stand-in controller C' closes the simulated loop, and the
recorded current (or command) u drives it: u_s = u + C'(y - y_s), with the recorded displacement y and the simulated one
y_s. That holds for any C' that stabilises the loop. Sensor noise n that the true controller C has fed back is then part
of the drive as (C' - C) n, so C' is fitted to the record where a linear controller explains it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi

import numpy as np
import scipy.fft
from scipy.interpolate import CubicSpline

from maglev_env.experiment import Experiment, sampling, without_noise
from maglev_env.loop.effect import EFFECTS
from maglev_env.loop.gains import NO_CONTROLLER, controller_output, limited, of_axis, reads_current
from maglev_env.loop.magnets.kinds import force_law, geometric_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.rig.rig import Rig, axis_rig, with_parameters_of_all_axes
from sim2real.recorded.along_motion import NEAREST
from sim2real.recorded.drive.controller_output import referred
from sim2real.recorded.drive.instrument import has_instruments
from sim2real.recorded.drive.quiet import quiet
from sim2real.recorded.drive.stand_in import finer_steps, stand_in
from sim2real.recorded.ticks import between_ticks

# Share of the bias current from which what a stand-in makes of noise is kept from it: a tenth stiffens a pair by 1 %.
SHAKEN = 0.1
HOLDS = 0.1  # samples: up to this time constant of an amplifier its current is held as the command is
UNLIMITED = 1e4  # V: range of the converters of a stand-in


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
        held: whether the source is held between samples; else it is straight lines.
        force_held: whether the force is held between samples; else it is continuous, up to half their rate.
        multiple: every how many recorded samples one is compared.
        every: control samples of the experiment for each compared sample.
        upstream: effects that act before what drives the loop, and therefore do not show.
        notes: what was assumed.
    """

    experiment: Experiment
    source: str | None = None
    stand_in: bool = False
    held: bool = True
    force_held: bool = True
    multiple: int = 1
    every: int = 1
    upstream: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()

    def driving(
        self,
        channels: Mapping[str, np.ndarray],
        instants: np.ndarray | None = None,
        like: np.ndarray | None = None,
    ) -> "Driving":
        """What drives the simulation of channels -> (axes, samples), every `multiple`-th recorded sample.

        Args:
            channels: of these samples.
            instants: of the samples (samples,), in samples; None: they are regular.
            like: (axes, samples * every), how the displacement may have moved between its samples; the difference to
                them is smooth. None: the displacement itself is.
        """
        e, y = self.experiment, channels["displacement"]
        dt, samples, nothing = 1 / e.rig.control_rate, y.shape[1], np.zeros_like(y)
        ticks = {name: channels[name] for name in ("displacement", "current") if name in channels}
        if self.stand_in and self._shaken(y - (calm := quiet(y))):
            ticks["displacement"] = y = calm
        if self.every > 1:
            when = np.arange(samples) if instants is None else instants
            at = between_ticks(when, self.every) / self.every
            like = np.zeros((len(y), at.size)) if like is None else like
            ticks = {"displacement": like + CubicSpline(when, y - like[:, :: self.every], axis=1)(at)}
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
            "force": self._force(channels.get("force", nothing)),
            "current": injection,
            "reference": reference,
        }
        sampled = slice(None, None, self.every)
        return Driving(waves, (output + injection)[:, sampled], (injection + caused)[:, sampled])

    def not_made(self, channels: Mapping[str, np.ndarray], rounding: float = 0.0) -> float:
        """Share of the command's rms that the stated controller does not make of the recorded channels.

        All that drives the loop besides must be recorded, and the command has no limit. The second half of a recording
        is asked: what the controller held when it began is forgotten by then.

        Args:
            channels: channel -> (axes, samples); those of reference and injection are what was added.
            rounding: standard deviation of what the command's converter rounds off, A.
        """
        added = self.driving(channels).waves["current"]  # with what the reference causes
        if "injection" in channels:
            added = added - self._between(channels["injection"])
        if "reference" in channels:
            gains, dt = self.experiment.gains, 1 / self.experiment.rig.control_rate
            wanted = self._between(channels["reference"])
            added = added - [referred(of_axis(gains, axis), r, dt) for axis, r in enumerate(wanted)]
        rest, whole = (series[:, series.shape[1] // 2 :].std(axis=1) for series in (added, channels["command"]))
        rest = np.sqrt(np.maximum(rest**2 - rounding**2, 0.0))
        return float(np.max(rest / np.maximum(whole, np.finfo(float).tiny)))

    def between(self, frequency: np.ndarray) -> np.ndarray:
        """Spectrum of the drive at the control rate over that of its samples, at frequencies in Hz, any shape."""
        rate = self.experiment.rig.control_rate / self.every
        share = np.arange(self.every) / self.every
        z = np.exp(2j * pi * frequency[..., None] / rate)
        toward = np.zeros(self.every) if self.held else share + 0.5 / self.every
        return np.mean(z**-share * (1 + toward * (z - 1)), axis=-1)

    def _shaken(self, noise: np.ndarray) -> bool:
        """Whether what a stand-in makes of the noise (axes, samples) of its reading is much in the magnets' current."""
        e = self.experiment
        for axis, own in enumerate(noise):
            rig = axis_rig(e.rig, axis)
            gain, stiffness = linearise(force_law(rig))
            bias = geometric_law(rig).bias_current or abs(stiffness) * rig.gap / gain  # or what pulls across the gap
            answer = controller_output(of_axis(e.gains, axis), own, self.every / e.rig.control_rate)
            if answer.std() > SHAKEN * abs(bias):
                return True
        return False

    def _between(self, series: np.ndarray) -> np.ndarray:
        """Values (axes, samples * every) over each control sample: held, or the mean of a straight line over it."""
        if self.held:
            return np.repeat(series, self.every, axis=1)
        following = np.concatenate([series[:, 1:], series[:, -1:]], axis=1)
        share = (np.arange(self.every) + 0.5) / self.every
        return (series[..., None] + (following - series)[..., None] * share).reshape(len(series), -1)

    def _force(self, series: np.ndarray) -> np.ndarray:
        """Force (axes, samples * every) over each control sample, from its samples (axes, samples).

        Of a continuous force it is the held sequence that has its spectrum up to half the rate of its samples.
        """
        if self.force_held or not np.ptp(series, axis=1).any():
            return np.repeat(series, self.every, axis=1)
        n = series.shape[1]
        whole = np.concatenate([series, series[:, ::-1]], axis=1)  # continuous at both ends
        turns = np.arange(n + 1) / (2 * n * self.every)  # of each line in a control sample
        fine = np.zeros((len(series), n * self.every + 1), complex)
        fine[:, : n + 1] = scipy.fft.rfft(whole, axis=1) * np.exp(1j * pi * turns) / np.sinc(turns)
        return np.asarray(scipy.fft.irfft(fine, 2 * n * self.every, axis=1))[:, : n * self.every] * self.every


def drive_of(
    rig: Rig, spec: RecordingSpec, channels: Mapping[str, np.ndarray], known: bool = True, smooth: bool = False
) -> Drive:
    """What drives a recording.

    Args:
        rig: as the campaign states it.
        spec: the recording.
        channels: channel -> (axes, samples) at the recording's rate.
        known: whether the stated controller is what made the command of these channels.
        smooth: whether the current is that of a coil whose voltage is recorded, which nothing holds between samples.

    Raises:
        TellsNothing: nothing that is known drives the recording.
        ValueError: the controller reads a current that is not recorded.
    """
    try:
        multiple, every = sampling(spec.sample_rate, rig.control_rate)
    except ValueError:
        multiple, every = 1, 0
    force_held = _holds(spec, every)
    # Without magnets, what a continuous force moves is simulated in steps as fine as its motion needs.
    stands = spec.gains is not None or rig.support_stiffness > 0 if rig.controlled else force_held
    if known and every == 1 and stands:
        gains = spec.gains if spec.gains is not None else NO_CONTROLLER
        e = without_noise(Experiment(rig, gains, (), speed_rpm=spec.speed_rpm))
        if reads_current(gains, 1 / rig.control_rate) and "current" not in channels:
            raise ValueError(
                "its controller reads the current, but the channel current is missing: the command does not follow "
                "from the displacement alone; record the current that the controller reads"
            )
        if rig.controlled and "command" in channels:
            read = "displacement and the current" if reads_current(gains, 1 / rig.control_rate) else "displacement"
            note = f"what drove the loop is the command less what the stated controller makes of the {read}"
            return Drive(e, "command", force_held=force_held, multiple=multiple, notes=(note,))
        if any(
            np.ptp(channels[name], axis=1).any() for name in ("force", "injection", "reference") if name in channels
        ):
            pushed = "force" in channels and np.ptp(channels["force"], axis=1).any()
            notes = (_force_in_words(force_held),) if pushed else ()
            return Drive(e, force_held=force_held, multiple=multiple, notes=notes)
    source = next((name for name in ("current", "command") if rig.controlled and name in channels), None)
    if source is None and rig.controlled:
        raise TellsNothing(
            "nothing that is known drives this recording",
            "record the current in the coil, or the command at the control rate (with the gains, what was added to it "
            "follows), or the injection, reference or force",
        )
    return _stood_in(rig, spec, channels, source, every, smooth)


def _holds(spec: RecordingSpec, every: int) -> bool:
    """Whether a converter holds the force over the control step, as of `recordings.signals`: stated, or designed."""
    designed = any(e.periodic for e in spec.excitations if e.at == "force")
    return every <= 1 and (spec.intersample == "zoh" or (spec.intersample is None and designed))


def _force_in_words(held: bool) -> str:
    return f"the force is taken as {'held' if held else 'continuous'} between samples"


def _stood_in(
    rig: Rig, spec: RecordingSpec, channels: Mapping[str, np.ndarray], source: str | None, every: int, smooth: bool
) -> Drive:
    """The loop under a stand-in controller, driven by the measured current or command, or by the force alone.

    Args:
        source: "current", "command", or None for a rig without magnets.
        every: control samples of the rig for each recorded one; 0 where the rates do not fit.
        smooth: as of `drive_of`.
    """
    finer, lags = finer_steps(rig, spec.sample_rate), rig.amplifier_time_constant * spec.sample_rate > HOLDS
    upstream = frozenset(n for n, card in EFFECTS.items() if card.block in ("controller", "amplifier"))
    upstream = upstream if source == "current" else frozenset()
    ideal = {"voltage_range": UNLIMITED} | ({"amplifier_time_constant": 0.0} if source == "current" else {})
    rig = replace(
        with_parameters_of_all_axes(rig, ideal),
        control_rate=finer * spec.sample_rate,
        clearance=NEAREST * rig.gap if rig.controlled else rig.clearance,  # the recorded rotor did not touch down
        gains=None,
        effects={name: values for name, values in rig.effects.items() if name not in upstream},
    )
    # A converter holds for a control step; a recording that is slower than the controller shows nothing held.
    force_held = _holds(spec, every)
    stated = (spec.intersample == "zoh" and every <= 1) or (
        spec.intersample is None and source == "command" and every == 1
    )
    # A converter holds a command. The current behind an amplifier that lags moves between its samples all the same.
    held = stated and not smooth and not (source == "current" and lags)
    if source is None:
        e = without_noise(Experiment(rig, NO_CONTROLLER, (), speed_rpm=spec.speed_rpm))
        return Drive(e, held=held, force_held=force_held, every=finer, notes=(_force_in_words(force_held),))
    y = channels["displacement"]
    reference = channels.get("reference", np.zeros_like(y))
    controllers, how = [], []
    for axis, series in enumerate(zip(channels[source], reference, y, strict=True)):
        controller, words = stand_in(axis_rig(rig, axis), finer, *series, fitted=not has_instruments(channels))
        controllers.append(controller)
        how.append(words)
    gains = controllers[0] if rig.axes == 1 else tuple(controllers)
    e = without_noise(Experiment(rig, gains, (), speed_rpm=spec.speed_rpm))
    shown = any(name.partition("_")[0] == "current" for name in spec.channels)
    told = "recorded" if shown or not smooth else "computed"
    note = (
        f"the {told} {source} drives the simulation ({'held' if held else 'straight lines'} between samples); "
        f"{' and '.join(sorted(set(how)))} stands in for the controller"
    )
    return Drive(e, source, True, held, force_held, every=finer, upstream=upstream, notes=(note,))
