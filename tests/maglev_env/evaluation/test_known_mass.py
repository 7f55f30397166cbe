"""A mass that is known to a tolerance: intervals grow by as much as estimates move with another mass."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.evaluation.identification import identify
from maglev_env.evaluation.identification_planar import identify_planar
from maglev_env.evaluation.known_mass import (
    planar_within_tolerance_of_mass,
    within_tolerance_of_channels,
    within_tolerance_of_mass,
)
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig_file import load_rig

TOLERANCE = 0.01
SCALED = ("displacement", "current", "force")


def recorded(name, at):
    """What an excitation at one place records of a preset."""
    rig = load_rig(name)
    e = protocol_experiment(rig, seed=4)
    e = replace(e, excitations=tuple(one for one in e.excitations if one.at == at))
    dataset = simulated_recording(e, simulate_records([e])[0])
    channels = {str(n): dataset[n].values for n in dataset.data_vars}
    return rig, RecordedSignals(channels, rig.control_rate, e.excitations, rig.control_rate, e.gains)


@pytest.mark.parametrize(("name", "at"), [("pedestal", "force"), ("hmb_free", "current")])
def test_intervals_grow_by_what_another_mass_changes(name, at):
    rig, signals = recorded(name, at)
    known, heavier = (identify(signals, rig, rig.mass * (1 + more)) for more in (0.0, TOLERANCE))
    found = within_tolerance_of_mass(known, TOLERANCE)
    for quantity in ("stiffness", "damping"):
        own, wide, moved = (
            np.array([getattr(b, quantity + end) for b in one.bands if b.informative])
            for one, end in ((known, "_se"), (found, "_se"), (heavier, ""))
        )
        moved = moved - np.array([getattr(b, quantity) for b in known.bands if b.informative])
        assert np.sqrt(wide**2 - own**2) == pytest.approx(abs(moved), rel=0.05, abs=0.1 * own.max())
    if at == "current":
        more = heavier.actuator.gain - known.actuator.gain
        assert np.hypot(known.actuator.gain_se, more) == pytest.approx(found.actuator.gain_se, rel=0.01)
        assert found.gain.stiffness_se == found.actuator.stiffness_se
        for own, wide, moved in zip(known.gain.bands, found.gain.bands, heavier.gain.bands, strict=True):
            more = abs(moved.gain) - abs(own.gain)
            assert wide.size_se == pytest.approx(np.hypot(own.size_se, more), rel=0.01)


@pytest.mark.parametrize(("name", "at"), [("pedestal", "force"), ("hmb_free", "current")])
def test_intervals_grow_by_what_other_scales_and_a_late_displacement_change(name, at):
    rig, signals = recorded(name, at)
    known = identify(signals, rig, rig.mass)
    scales, none, late = {"displacement": 0.03, "current": 0.04, "force": 0.04}, dict.fromkeys(SCALED, 0.0), 2e-5
    f = np.fft.rfftfreq(signals.channels["displacement"].size, 1 / signals.sample_rate)
    turned = np.fft.irfft(
        np.fft.rfft(signals.channels["displacement"]) * np.exp(-2j * np.pi * f * late),
        signals.channels["displacement"].size,
    )
    for factor, (given, time) in {1.03: (none | {"displacement": 0.03}, 0.0), 1.0: (none, late)}.items():
        motion = (signals.channels["displacement"] if factor != 1 else turned) * factor
        other = identify(replace(signals, channels=signals.channels | {"displacement": motion}), rig, rig.mass)
        found = within_tolerance_of_channels(known, given, time)
        for quantity in ("stiffness", "damping"):
            own, wide, moved = (
                np.array([getattr(b, quantity + end) for b in one.bands if b.informative])
                for one, end in ((known, "_se"), (found, "_se"), (other, ""))
            )
            moved = abs(moved - np.array([getattr(b, quantity) for b in known.bands if b.informative]))
            ratio = wide / np.hypot(own, moved)  # bands at the ends hold much noise, which moves them too
            assert ratio.min() > 0.9 and np.median(ratio) == pytest.approx(1, abs=0.05)
        if at == "current":
            for own, wide, moved in zip(known.gain.bands, found.gain.bands, other.gain.bands, strict=True):
                more = abs(moved.gain) - abs(own.gain)
                assert wide.size_se == pytest.approx(np.hypot(own.size_se, more), rel=0.02)
                if time:
                    assert wide.phase_se > 2 * np.pi * own.frequency * time
    both = within_tolerance_of_channels(known, scales, 0.0)
    if at == "current":
        gain = known.actuator.gain
        assert both.actuator.gain_se == pytest.approx(np.hypot(known.actuator.gain_se, 0.05 * gain))
        # The mass is the scale of stiffness and damping.
        for one, other in zip(both.bands, known.bands, strict=True):
            assert one.stiffness_se == other.stiffness_se and one.damping_se == other.damping_se


def test_a_mass_that_was_fitted_or_is_exact_widens_nothing():
    rig, signals = recorded("pedestal", "force")
    known = identify(signals, rig, rig.mass)
    assert within_tolerance_of_mass(known, 0.0) is known
    fitted = identify(signals, rig, None, estimate_mass=True)
    assert within_tolerance_of_mass(fitted, TOLERANCE) is fitted


def test_of_two_axes_the_direct_stiffnesses_grow_by_what_other_masses_change():
    rig = load_rig("hmb_radial")
    first = protocol_experiment(rig, seed=5)
    records = []
    for turn in (0.0, 90.0):
        forces = tuple(replace(one, direction=turn) for one in first.excitations if one.at == "force")
        e = replace(first, excitations=forces, periods=3)
        dataset = simulated_recording(e, simulate_records([e])[0])
        channels = {str(n): dataset[n].values for n in dataset.data_vars}
        records.append(RecordedSignals(channels, rig.control_rate, e.excitations, rig.control_rate, e.gains))
    known, heavier = (identify_planar(records, rig, rig.mass * (1 + more)) for more in (0.0, TOLERANCE))
    found = planar_within_tolerance_of_mass(known, (TOLERANCE, TOLERANCE))
    more = np.sqrt(found.estimate.stiffness_se**2 - known.estimate.stiffness_se**2)
    moved = abs(heavier.estimate.stiffness - known.estimate.stiffness)
    sure, error = known.estimate.informative, known.estimate.stiffness_se
    for axis in range(2):
        np.testing.assert_allclose(
            more[sure, axis, axis], moved[sure, axis, axis], rtol=0.05, atol=0.1 * error[sure, axis, axis].max()
        )
        assert (more[sure, axis, 1 - axis] == 0).all()
    assert (found.estimate.stiffness_high >= known.estimate.stiffness_high)[sure].all()


def test_bands_are_as_unsure_as_the_gains_of_bands_differ(monkeypatch):
    """A stiffness that seems to fall with frequency was that of one gain that fitted none of the bands."""
    rig, signals = recorded("hmb_free", "current")
    found = []
    for scatter in (0.0, 0.01):
        monkeypatch.setattr("estimation.apparent_gain.ApparentGain.scatter", scatter)
        found.append(identify(signals, rig, rig.mass))
    for one, wide in zip(found[0].bands, found[1].bands, strict=True):
        inertia = rig.mass * (np.pi * (one.f_lo + one.f_hi)) ** 2
        more = 0.01 * abs(one.stiffness - inertia)
        assert wide.stiffness_se == pytest.approx(np.hypot(one.stiffness_se, more), nan_ok=True)
