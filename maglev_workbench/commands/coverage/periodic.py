"""Conditions of periodic experiments: a preset's protocol, with other phases and other noise in each draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimation.normal import NORMAL_95
from estimation.stability_margins import margins
from maglev_env.evaluation.identification import Identification, identify
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import NO_EFFECTS, Effects
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig import Noise, Rig, load_rig
from maglev_workbench.commands.coverage.counts import Coverage, Interval, counted

BANDS = (40.0, 90.0, 150.0)  # Hz: the bands nearest to these are counted
MARGINS = ("peak_sensitivity", "phase_margin", "delay_margin", "disk_margin", "gain_margin_low", "gain_margin_high")
COEFFICIENTS = ("stiffness", "damping")

Ends = Mapping[str, tuple[float | None, float | None]]


@dataclass(frozen=True)
class Periodic:
    """One kind of periodic experiment.

    The truth of stiffness, damping and margins is that of the best linear approximation: the mean over the same draws
    without noise. The truth of a record of the injection alone is the rig's own gain, stiffness and damping.

    Args:
        title: in words.
        rig: name of a preset.
        periods: that are kept.
        gains: factor of kp and kd.
        amplitude: factor of the protocol's amplitudes.
        effects: of the rig that is recorded.
        places: where the protocol's excitation is kept.
        hidden: channels that are not recorded.
    """

    title: str
    rig: str = "hmb_free"
    periods: int = 5
    gains: float = 1.0
    amplitude: float = 1.0
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)
    places: tuple[str, ...] = ("force", "current")
    hidden: tuple[str, ...] = ()

    @property
    def nominal(self) -> Rig:
        """The rig that the estimate is told."""
        return load_rig(self.rig)

    def experiment(self, seed: int, draw: int) -> Experiment:
        """The experiment of one draw."""
        rig = self.nominal
        assert isinstance(rig.gains, Gains)
        first = protocol_experiment(rig, replace(rig.gains, kp=rig.gains.kp * self.gains, kd=rig.gains.kd * self.gains))
        excitations = tuple(
            replace(e, kind="multisine", seed=1000 * seed + draw, amplitude=e.amplitude * self.amplitude)
            for e in first.excitations
            if e.at in self.places
        )
        return replace(first, excitations=excitations, periods=self.periods, effects=self.effects, seed=(seed, draw))

    def drawn(self, seed: int, draw: int) -> tuple[Identification, Identification]:
        """What is identified of one draw, with its noise and without."""
        e = self.experiment(seed, draw)
        return self._identified(e), self._identified(replace(e, rig=replace(e.rig, noise=Noise())))

    def counted(self, drawn: Sequence[tuple[Identification, Identification]]) -> tuple[Coverage, ...]:
        """Counts of bands, margins, or coefficients of the actuator."""
        truth = _truth(self.nominal, [clean for _, clean in drawn])
        found = [_ends(noisy) for noisy, _ in drawn]
        return tuple(counted(name, [_interval(*one[name], true) for one in found]) for name, true in truth.items())

    def _identified(self, e: Experiment) -> Identification:
        recording = simulated_recording(e, simulate_records([e], threads=1)[0])
        channels = {str(n): recording[n].values for n in recording.data_vars if str(n) not in self.hidden}
        rate = e.rig.control_rate if "force" in self.places else None
        signals = RecordedSignals(channels, e.rig.control_rate, e.excitations, rate, e.gains)
        return identify(signals, self.nominal, self.nominal.mass)


def _interval(low: float | None, high: float | None, truth: float) -> Interval:
    """An interval from its ends; None is an open one."""
    if low is None or high is None:
        return Interval(-np.inf if low is None else low, np.inf if high is None else high, truth, np.nan)
    half = (high - low) / 2
    return Interval(low, high, truth, NORMAL_95 * (low + half - truth) / half if half > 0 else np.nan)


def _ends(found: Identification) -> Ends:
    """Ends of the interval by quantity."""
    given: dict[str, tuple[float | None, float | None]] = {}
    if found.actuator is not None:
        for name in ("gain", *COEFFICIENTS):
            value, half = getattr(found.actuator, name), NORMAL_95 * getattr(found.actuator, f"{name}_se")
            given[f"actuator {name}"] = value - half, value + half
    else:
        for name, band, at in _bands(found):
            given[f"{name} at {at:.0f} Hz"] = getattr(found.bands[band], f"{name}_ci")
    if found.stability is not None:
        given |= {name: found.stability.margins.intervals[name] for name in MARGINS}
    return given


def _bands(found: Identification) -> list[tuple[str, int, float]]:
    """Coefficient, index of the band and the frequency that it is nearest to."""
    middles = np.array([(b.f_lo + b.f_hi) / 2 for b in found.bands])
    return [(name, int(abs(middles - at).argmin()), at) for name in COEFFICIENTS for at in BANDS]


def _truth(nominal: Rig, clean: Sequence[Identification]) -> dict[str, float]:
    """Truth by quantity, where there is one."""
    first, truth = clean[0], {}
    if first.actuator is not None:
        gain, stiffness = linearise(force_law(nominal))
        truth = {"actuator gain": gain, "actuator stiffness": stiffness, "actuator damping": 0.0}
    else:
        for name, band, at in _bands(first):
            truth[f"{name} at {at:.0f} Hz"] = float(np.mean([getattr(one.bands[band], name) for one in clean]))
    if first.stability is not None:
        sensitivity = np.mean([one.stability.sensitivity for one in clean if one.stability], axis=0)
        exact = margins(first.stability.frequency, sensitivity, np.zeros(sensitivity.size), draws=0)
        known = {name: getattr(exact, name) for name in MARGINS}
        truth |= {name: float(value) for name, value in known.items() if value is not None}
    return truth


PERIODIC: Mapping[str, Periodic] = {
    "linear": Periodic("the preset's protocol"),
    "two_periods": Periodic("two periods", periods=2),
    "nine_periods": Periodic("nine periods", periods=9),
    "soft": Periodic("kp and kd times 0.7: nearer to instability", gains=0.7),
    "faint": Periodic("a tenth of the amplitude: noise", amplitude=0.1),
    "large": Periodic("six times the amplitude: a third of the gap", amplitude=6.0),
    "saturating": Periodic("the same with iron that saturates", amplitude=6.0, effects={"saturation": {"field": 0.6}}),
    "hysteresis": Periodic("hysteresis of the iron", effects={"hysteresis": {"strength": 0.2, "width": 0.05}}),
    "friction": Periodic("a rubbing cable", effects={"friction": {"force": 0.02, "velocity": 1e-3, "presliding": 0.0}}),
    "injection": Periodic("the injection alone, current recorded", places=("current",), hidden=("force",)),
    "command": Periodic("the injection alone, command recorded", places=("current",), hidden=("force", "current")),
}
