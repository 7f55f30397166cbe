"""From a recording to its estimate: known rigs come back, and what cannot be known is said."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import protocol_experiment
from maglev_env.identification import identify
from maglev_env.protocols import diagnosis_campaign, sphs_campaign
from maglev_env.quality import recording_quality
from maglev_env.record_spectra import RecordedSignals
from maglev_env.recording import simulated_recording
from maglev_env.rig import load_rig
from maglev_env.simulate import simulate_records


def recorded(e, held=True):
    dataset = simulated_recording(e, simulate_records([e])[0])
    channels = {str(n): dataset[n].values for n in dataset.data_vars}
    gains = e.gains if e.rig.controlled else None
    return RecordedSignals(channels, e.rig.control_rate, e.excitations, e.rig.control_rate if held else None, gains)


@pytest.fixture(scope="module")
def pedestal():
    rig = load_rig("pedestal")
    return rig, recorded(protocol_experiment(rig, seed=1))


@pytest.fixture(scope="module")
def levitated():
    rig = load_rig("hmb_free")
    return rig, recorded(protocol_experiment(rig, seed=1))


def test_constant_stiffness_and_damping_come_back_inside_their_intervals(pedestal):
    rig, signals = pedestal
    found = identify(signals, rig, rig.mass)
    hits = [b.stiffness_ci[0] <= rig.support_stiffness <= b.stiffness_ci[1] for b in found.bands]
    damped = [b.damping_ci[0] <= rig.support_damping <= b.damping_ci[1] for b in found.bands]
    assert np.mean(hits) > 0.85 and np.mean(damped) > 0.85
    assert found.natural_frequency == pytest.approx(np.sqrt(134.5e3 / 0.79) / (2 * np.pi), abs=0.01)
    assert found.damping_ratio == pytest.approx(8 / (2 * np.sqrt(134.5e3 * 0.79)), rel=0.01)
    assert found.stability is None and any("margins" in n for n in found.notes)


def test_without_the_hold_correction_the_damping_is_k_t_over_two_too_large(pedestal):
    rig, signals = pedestal
    raw = identify(replace(signals, hold_rate=None), rig, rig.mass)
    low = raw.bands[3]
    assert low.damping - rig.support_damping == pytest.approx(rig.support_stiffness * 25e-6, rel=0.4)


def test_the_mass_can_be_estimated_with_the_rest(pedestal):
    _, signals = pedestal
    found = identify(signals, None, None, estimate_mass=True, band_width=10.0, band_overlap=8.0)
    m = found.modal
    assert abs(m.mass - 0.79) < 4 * m.mass_se < 0.01
    assert abs(m.natural_frequency - 65.67) < 0.01
    known = identify(signals, None, 0.79, band_width=10.0, band_overlap=8.0)
    for with_it, without in zip(found.bands, known.bands, strict=True):
        # What is not known of the mass is not known of the stiffness, w^2 as much.
        shift = m.mass_se * (np.pi * (with_it.f_lo + with_it.f_hi)) ** 2
        assert with_it.stiffness_se == pytest.approx(np.hypot(without.stiffness_se, shift), rel=0.02)
    with pytest.raises(ValueError, match="--estimate-mass"):
        identify(signals, None, None)


def test_margins_are_measured_with_an_injection_and_labelled_without(levitated):
    rig, signals = levitated
    measured = identify(signals, rig, rig.mass).stability
    assert measured.source == "injection"
    low, high = measured.margins.intervals["peak_sensitivity"]
    assert low < 2.472 < high and measured.iso_14839_3_zone == "A"
    no_injection = {k: v for k, v in signals.channels.items() if k not in ("injection", "command")}
    bare = replace(signals, channels=no_injection)
    assumed = identify(bare, rig, rig.mass)
    assert assumed.stability.source == "assumes the nominal actuator"
    assert assumed.stability.margins.peak_sensitivity == pytest.approx(2.47, abs=0.05)
    assert assumed.stability.margins.gain_margin_high is None
    assert "gain_margin_high" in assumed.stability.margins.reasons
    assert identify(bare, None, rig.mass).stability is None


def test_actual_coefficients_stand_beside_the_effective_ones(levitated):
    rig, signals = levitated
    band = next(b for b in identify(signals, rig, rig.mass).bands if b.f_lo > 60)
    # The sampled derivative is (z - 1) / (z - a) / td: 27 % steeper than kd s. Lags of amplifier, probe and hold then
    # take more than that away: the gains promise more damping than there is.
    assert band.effective_damping == pytest.approx(5.7 * 5.2 * 0.5 / (1 - np.exp(-0.5)), rel=0.07)
    assert band.damping == pytest.approx(29.4, abs=0.5) and band.effective_damping > band.damping + 5
    assert band.effective_stiffness == pytest.approx(band.stiffness, rel=0.05)


def test_a_transient_is_dropped_and_said_so(pedestal):
    rig, signals = pedestal
    found = identify(signals, rig, rig.mass)
    assert found.transient_periods >= 1 and any("transient" in n for n in found.notes)


def test_distortion_shows_on_detection_lines_only():
    rig = load_rig("hmb_free")
    plan = {p.name: p for p in diagnosis_campaign(rig, rig.gains, {}, 0)}
    assert set(plan) == {"base", "phases", "half", "gains", "offset", "holdout"}
    assert plan["holdout"].role == "holdout" and plan["base"].role == "fit"
    full = identify(recorded(plan["base"].experiment), rig, rig.mass).distortion
    assert full.even is not None and full.odd is not None
    centred, offset = full, identify(recorded(plan["offset"].experiment), rig, rig.mass).distortion
    # A rotor off its centre meets a force law without the symmetry that hides even distortion.
    assert centred.even_p > 1e-3 and offset.even_p < 1e-6
    sphs = identify(recorded(sphs_campaign(rig, rig.gains, {}, 0)[0].experiment), rig, rig.mass)
    assert sphs.distortion.even is None and any("detection" in n for n in sphs.notes)


def test_quality_tells_what_a_record_is_good_for(levitated):
    _, signals = levitated
    good = recording_quality(signals)
    assert good.can["margins"] == "yes" and good.can["stiffness and damping"] == "yes"
    assert good.can["nonlinear distortion"].startswith("no") and all(b.verdict == "good" for b in good.bands)
    axial = load_rig("hmb_axial")
    weak = recording_quality(recorded(protocol_experiment(axial)))
    assert weak.bands[0].verdict == "good" and weak.bands[-1].verdict == "noise rules"
    assert any("lost in noise" in p for p in weak.problems)
    assert weak.can["margins"].startswith("no") and weak.can["amplifier block"].startswith("no")


def test_mistakes_of_scale_and_sign_are_pointed_out(pedestal):
    rig, signals = pedestal
    huge = replace(signals, channels=signals.channels | {"displacement": signals.channels["displacement"] * 1e3})
    assert any("clearance" in p for p in recording_quality(huge, rig).problems)
    assert not any("clearance" in p for p in recording_quality(signals, rig).problems)
    flipped = replace(signals, channels=signals.channels | {"force": -signals.channels["force"]})
    assert any("sign" in n for n in identify(flipped, rig, rig.mass).notes)
    assert not any("sign" in n for n in identify(signals, rig, rig.mass).notes)


def test_what_is_missing_is_named(pedestal):
    rig, signals = pedestal
    without = replace(signals, channels={"displacement": signals.channels["displacement"]})
    with pytest.raises(ValueError, match="the channel force"):
        identify(without, rig, rig.mass)
