"""Conditions of periodic experiments: a preset's protocol, with other phases and other noise in each draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from estimation.band_mean import band_mean
from estimation.lines.frequency_response import frequency_response
from estimation.normal import NORMAL_95
from estimation.stability_margins import margins
from maglev_env.evaluation.identification import Identification, identify
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.loop.effect import NO_EFFECTS, Effects
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig import Noise, Rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.coverage.counts import Coverage, counted, interval
from maglev_workbench.commands.coverage.disturbed import QUIET, Disturbed, of_power

BANDS = (40.0, 90.0, 150.0)  # Hz: the bands nearest to these are counted
MARGINS = ("peak_sensitivity", "phase_margin", "delay_margin", "disk_margin", "gain_margin_low", "gain_margin_high")
COEFFICIENTS = ("stiffness", "damping")

Ends = Mapping[str, tuple[float | None, float | None]]


@dataclass(frozen=True)
class Periodic:
    """One kind of periodic experiment.

    The truth of stiffness, damping and margins is that of the best linear approximation: of the mean response of the
    same draws, without noise where nothing else is said. It depends on the power of the excitation, which is therefore
    the same in all draws. The truth of a record of the injection alone is the rig's own gain, stiffness and damping.

    Args:
        title: in words.
        rig: name of a preset.
        periods: that are kept.
        gains: factor of kp and kd.
        amplitude: factor of the protocol's amplitudes.
        effects: of the rig that is recorded.
        places: where the protocol's excitation is kept.
        hidden: channels that are not recorded.
        sensor: of the loop.
        bench: what disturbs the recording as noise does.
        dithered: whether the law is not smooth, so that noise in the loop is part of what responds; the truth is then
            the mean of the noisy responses.
    """

    title: str
    rig: str = "hmb_free"
    periods: int = 5
    gains: float = 1.0
    amplitude: float = 1.0
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)
    places: tuple[str, ...] = ("force", "current")
    hidden: tuple[str, ...] = ()
    sensor: str = "probe"
    bench: Disturbed = QUIET
    dithered: bool = False

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
            of_power(replace(e, kind="multisine", seed=1000 * seed + draw), e.amplitude * self.amplitude, rig)
            for e in first.excitations
            if e.at in self.places
        )
        return replace(
            first,
            excitations=excitations,
            periods=self.periods,
            effects=self.effects,
            seed=(seed, draw),
            sensor=self.sensor,
        )

    def drawn(self, seed: int, draw: int) -> tuple[Identification, Identification]:
        """What is identified of one draw, with its noise and without."""
        e = self.experiment(seed, draw)
        clean = replace(e, rig=replace(e.rig, noise=Noise()))
        return self._identified(e, self.bench.channels(e)), self._identified(clean, QUIET.channels(clean))

    def counted(self, drawn: Sequence[tuple[Identification, Identification]]) -> tuple[Coverage, ...]:
        """Counts of bands, margins, or coefficients of the actuator."""
        truth = _truth(self.nominal, [one[0 if self.dithered else 1] for one in drawn])
        found = [_ends(noisy) for noisy, _ in drawn]
        return tuple(counted(name, [interval(*one[name], true) for one in found]) for name, true in truth.items())

    def _identified(self, e: Experiment, recorded: Mapping[str, np.ndarray]) -> Identification:
        channels = {name: values for name, values in recorded.items() if name not in self.hidden}
        rate = e.rig.control_rate if "force" in self.places else None
        signals = RecordedSignals(channels, e.rig.control_rate, e.excitations, rate, e.gains)
        # Bands side by side: those that overlap would be fitted for nothing.
        apart = 0.0 if "force" in self.places else None
        return identify(signals, self.nominal, self.nominal.mass, band_overlap=apart)


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
        response = np.mean([frequency_response(one.statistics, "displacement", "force")[0] for one in clean], axis=0)
        s = first.statistics
        mean = replace(
            s,
            channels=("force", "displacement"),
            mean=np.stack([np.ones_like(response), response]),
            covariance=np.zeros((2, 2, response.size)),
        )
        for name, band, at in _bands(first):
            b = first.bands[band]
            found = band_mean(mean, np.array([b.f_lo, b.f_hi]), first.mass, (b.stiffness, b.damping))
            truth[f"{name} at {at:.0f} Hz"] = found[COEFFICIENTS.index(name)].value
    if first.stability is not None:
        sensitivity = np.mean([one.stability.sensitivity for one in clean if one.stability], axis=0)
        exact = margins(first.stability.frequency, sensitivity, np.zeros(sensitivity.size), draws=0)
        known = {name: getattr(exact, name) for name in MARGINS}
        truth |= {name: float(value) for name, value in known.items() if value is not None}
    return truth


# 3 N/mm more than the 35 of the loop, at the rms displacement.
HARDENING: Effects = {"cubic_spring": {"coefficient": 4e13}}
SATURATING: Effects = {"saturation": {"field": 0.6}}
HYSTERESIS: Effects = {"hysteresis": {"strength": 0.2, "width": 0.05}}
RUBBING: Effects = {"friction": {"force": 0.02, "velocity": 1e-3, "presliding": 0.0}}

PERIODIC: Mapping[str, Periodic] = {
    "linear": Periodic("the preset's protocol"),
    "platform": Periodic("the preset eframe", rig="eframe"),
    "two_periods": Periodic("two periods", periods=2),
    "three_periods": Periodic("three periods", periods=3),
    "nine_periods": Periodic("nine periods", periods=9),
    "soft": Periodic("kp and kd times 0.7: nearer to instability", gains=0.7),
    "faint": Periodic("a tenth of the amplitude: noise", amplitude=0.1),
    "large": Periodic("six times the amplitude: a third of the gap", amplitude=6.0),
    "saturating": Periodic("the same with iron that saturates", amplitude=6.0, effects=SATURATING),
    "hardening": Periodic("a spring that hardens", effects=HARDENING),
    "hysteresis": Periodic("hysteresis of the iron", effects=HYSTERESIS, dithered=True),
    "friction": Periodic("a rubbing cable", effects=RUBBING, dithered=True),
    "coloured": Periodic("a floor that shakes at 90 Hz", bench=Disturbed(floor=0.02)),
    "clock": Periodic("a recorder whose clock is fast by 50 ppm", bench=Disturbed(clock=50e-6)),
    "turning": Periodic("a rotor with unbalance and runout, at 6,000 to 8,000 rpm", bench=Disturbed(turning=True)),
    "self_sensing": Periodic("the loop closed by self-sensing", sensor="self_sensing"),
    "injection": Periodic("the injection alone, current recorded", places=("current",), hidden=("force",)),
    "command": Periodic("the injection alone, command recorded", places=("current",), hidden=("force", "current")),
}
