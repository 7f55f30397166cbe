"""The eight coefficients of rigs whose stiffness and damping matrices are known exactly: no magnets, only supports."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from maglev_env.design.protocols import sphs_campaign
from maglev_env.evaluation.identification_planar import identify_planar
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import rig_from_toml

TOML = """
schema = "maglev-rig/1"
name = "crossed"
magnet = "none"
axes = 2
[parameters]
mass = 0.8
support_stiffness = 1.2e5
support_damping = 12.0
gap = 1e-3
control_rate = 4000.0
[axis.y]
mass = 1.0
support_stiffness = 0.9e5
support_damping = 20.0
[cross]
stiffness_xy = 8e3
stiffness_yx = -5e3
damping_xy = 3.0
damping_yx = -2.0
[noise]
displacement = 0.5e-6
force = 5e-3
[protocol]
periods = 8
transient_periods = 2
band_width = 12.0
band_overlap = 0.0
[[protocol.excitation]]
kind = "sphs"
harmonics = [5, 120]
amplitude = 3.0
direction = 30.0
"""
RIG = rig_from_toml(TOML, "crossed.toml")
K = np.array([[1.2e5, 8e3], [-5e3, 0.9e5]])
C = np.array([[12.0, 3.0], [-2.0, 20.0]])
# Equal axes with equal couplings: pushed along a diagonal, x and y move together or against each other.
EQUAL = rig_from_toml(
    TOML.replace("mass = 1.0", "").replace("support_stiffness = 0.9e5", "").replace("support_damping = 20.0", "")
    .replace("-5e3", "8e3").replace("-2.0", "3.0").replace("30.0", "45.0"),
    "equal.toml",
)  # fmt: skip


def recorded(e):
    dataset = simulated_recording(e, simulate_records([e])[0])
    channels = {str(n): dataset[n].values for n in dataset.data_vars}
    return RecordedSignals(channels, e.recorded_rate, e.excitations, e.rig.control_rate, axes=2)


@pytest.fixture(scope="module")
def crossed():
    return [recorded(plan.experiment) for plan in sphs_campaign(RIG, NO_CONTROLLER, {}, 3)]


@pytest.fixture(scope="module")
def equal():
    return [recorded(plan.experiment) for plan in sphs_campaign(EQUAL, NO_CONTROLLER, {}, 3)]


def inside(low, high, exact):
    """Share of intervals that hold the exact value is compatible with 95 % of independent ones (chance 1e-4)."""
    held = (low <= exact) & (exact <= high)
    return held.sum() >= stats.binom.ppf(1e-4, held.size, 0.95)


def both_inside(estimate, bands=slice(None)):
    e = estimate
    stiffness = inside(e.stiffness_low[bands], e.stiffness_high[bands], K)
    return stiffness and inside(e.damping_low[bands], e.damping_high[bands], C)


def test_two_directions_tell_all_eight_coefficients(crossed):
    found = identify_planar(crossed, RIG, RIG.mass)
    e = found.estimate
    assert e.identifiable.all() and e.informative.all() and found.notes == () and len(found.bands) == 9
    assert found.masses == (pytest.approx(0.8), 1.0) and (e.condition < 2.5).all()
    assert both_inside(e) and (e.fit_p > 1e-3).all()
    errors = [(e.stiffness - K) / e.stiffness_se, (e.damping - C) / e.damping_se]
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.3  # as far off as they say
    at_resonance = np.argmin(e.stiffness_se.sum(axis=(1, 2)))
    np.testing.assert_allclose(e.stiffness[at_resonance], K, atol=20.0)
    np.testing.assert_allclose(e.damping[at_resonance], C, atol=0.1)
    plain = found.least_squares
    np.testing.assert_allclose(plain.stiffness[at_resonance], K, atol=50.0)


def test_a_rotor_that_turns_beside_a_line_moves_no_coefficient(crossed):
    """The tone of its unbalance repeats nearly with the excitation: it bends lines without scattering over periods."""
    turning = {"unbalance": {"moment": 1e-5}, "runout": {"amplitude": 1e-6}}
    plans = sphs_campaign(RIG, NO_CONTROLLER, {}, 3)
    signals = [
        recorded(replace(plan.experiment, effects=turning, speed_rpm=60 * (40 + off)))
        for plan, off in zip(plans, (0.04, -0.06), strict=True)
    ]
    found = identify_planar(signals, RIG, RIG.mass)
    assert [note.endswith("was taken out") for note in found.notes] == [True, True]
    e, quiet = found.estimate, identify_planar(crossed, RIG, RIG.mass).estimate
    assert e.informative.all() and both_inside(e)
    # Without its removal the band of 40 Hz is off by 160 standard errors, which grow 50-fold.
    assert (e.stiffness_se < 2 * quiet.stiffness_se).all() and (e.damping_se < 2 * quiet.damping_se).all()
    assert (abs(e.stiffness - K) < 4 * quiet.stiffness_se).all() and (abs(e.damping - C) < 4 * quiet.damping_se).all()


def test_the_whole_support_is_taken_off(crossed):
    found = identify_planar(crossed, RIG, RIG.mass)
    own = np.diag([1.2e5, 0.9e5]), np.diag([12.0, 20.0])
    np.testing.assert_allclose(found.bearing_stiffness, found.estimate.stiffness - own[0], rtol=1e-12)
    np.testing.assert_allclose(found.bearing_damping, found.estimate.damping - own[1], rtol=1e-12)
    np.testing.assert_allclose(found.bearing_stiffness[4], [[0, 8e3], [-5e3, 0]], atol=30.0)
    bare = replace(RIG, support_stiffness=0.0, per_axis={"y": {"mass": 1.0}})
    assert identify_planar(crossed, bare, RIG.mass).bearing_stiffness is None
    assert identify_planar(crossed, None, 0.8, 12.0, 0.0).bearing_stiffness is None


def test_a_support_that_only_the_axes_state_is_taken_off_too(crossed):
    y = {"mass": 1.0, "support_stiffness": 0.9e5, "support_damping": 20.0}
    own = replace(RIG, support_stiffness=0.0, support_damping=0.0, per_axis={"y": y})
    found = identify_planar(crossed, own, RIG.mass)
    np.testing.assert_allclose(found.bearing_stiffness[4], [[1.2e5, 8e3], [-5e3, 0]], atol=30.0)


def test_a_stated_mass_scales_both_axes_alike_and_a_wrong_one_shows(crossed):
    found = identify_planar(crossed, RIG, 1.6, band_width=3.0)
    assert found.masses == (pytest.approx(1.6), pytest.approx(2.0))
    off = found.estimate.stiffness[:, [0, 1], [0, 1]] - np.diag(K)
    excess = np.outer((2 * np.pi * found.bands.mean(axis=1)) ** 2, [0.8, 1.0])  # m w^2 more than there is
    np.testing.assert_allclose(np.median(off / excess, axis=0), 1.0, rtol=0.03)
    assert identify_planar(crossed, None, 0.8, 12.0, 0.0).masses == (0.8, 0.8)


def test_one_direction_of_equal_axes_is_refused_and_its_row_sums_are_right(equal):
    together, against = equal
    for records, sign in (([together], 1), ([against], -1)):
        found = identify_planar(records, EQUAL, EQUAL.mass)
        assert not found.estimate.identifiable.any() and np.isnan(found.estimate.stiffness).all()
        (note,) = found.notes
        assert "no band" in note and "only row sums" in note and "turned, 90 degrees" in note
        (sums,) = found.row_sums
        np.testing.assert_allclose(sums.ratio, sign, atol=0.03)
        for axis in (sums.x, sums.y):
            assert inside(axis.stiffness_low, axis.stiffness_high, 1.2e5 + sign * 8e3)
            assert inside(axis.damping_low, axis.damping_high, 12.0 + sign * 3.0)
            best = np.argmin(axis.stiffness_se)
            assert axis.stiffness[best] == pytest.approx(1.2e5 + sign * 8e3, abs=20)
            assert axis.damping[best] == pytest.approx(12.0 + sign * 3.0, abs=0.1)
    whole = identify_planar(equal, EQUAL, EQUAL.mass).estimate
    assert whole.identifiable.all()
    assert inside(whole.stiffness_low, whole.stiffness_high, np.array([[1.2e5, 8e3], [8e3, 1.2e5]]))


def test_row_sums_of_unequal_axes_weigh_the_couplings_by_the_motion(crossed):
    found = identify_planar(crossed, RIG, RIG.mass)
    checked = 0
    for sums in found.row_sums:
        r, w = sums.ratio, 2 * np.pi * found.bands.mean(axis=1)
        steady = sums.ratio_spread < 0.03 * np.abs(r)
        for own, q, i, j in ((sums.x, r, 0, 1), (sums.y, 1 / r, 1, 0)):
            k = K[i, i] + q.real * K[i, j] - w * q.imag * C[i, j]
            c = C[i, i] + q.real * C[i, j] + q.imag * K[i, j] / w
            # The ratio still changes within a band, by its spread.
            slack = sums.ratio_spread / np.abs(r) * np.abs(q) * abs(K[i, j])
            assert (np.abs(own.stiffness - k) < 4 * own.stiffness_se + slack)[steady].all()
            assert (np.abs(own.damping - c) < 4 * own.damping_se + slack / w)[steady].all()
        checked += steady.sum()
    assert checked >= 4


def test_one_direction_is_refused_where_unequal_axes_part_too(crossed):
    # About the two resonances x and y move differently; still every line tells one combination of coefficients only.
    found = identify_planar(crossed[:1], RIG, RIG.mass)
    assert not found.estimate.identifiable.any() and np.isinf(found.estimate.condition).all()
    assert np.isnan(found.estimate.stiffness).all() and "no band" in found.notes[0]


def test_x_and_y_driven_on_lines_of_their_own_need_one_record_only():
    lines = (tuple(range(5, 120, 2)), tuple(range(6, 120, 2)))
    parts = tuple(
        Excitation("sphs", "force", 1.0, own, 3.0, direction=d) for own, d in zip(lines, (0, 90), strict=True)
    )
    signals = recorded(replace(protocol_experiment(RIG, seed=5), excitations=parts))
    found = identify_planar([signals], RIG, RIG.mass)
    assert found.estimate.identifiable.all() and both_inside(found.estimate)
    # Each axis by itself: what the other's lines move is no distortion.
    for axis, own in enumerate(lines):
        np.testing.assert_array_equal(axis_signals(signals, axis).elsewhere, lines[1 - axis])
        assert axis_signals(signals, axis).excitations[0].lines == own


@pytest.mark.slow
def test_recorded_noise_along_two_directions_tells_all_eight_coefficients():
    records = []
    for seed, direction in ((1, 30.0), (2, 120.0)):
        noise = Excitation("multisine", "force", 1 / 8, tuple(range(1, 8 * 150)), 8.0, seed, direction)
        e = replace(protocol_experiment(RIG, seed=seed), excitations=(noise,), periods=1, transient_periods=0)
        described = Excitation("recorded", direction=direction, band=(4.0, 120.0))
        records.append(replace(recorded(e), excitations=(described,)))
    found = identify_planar(records, RIG, RIG.mass)
    e = found.estimate
    assert e.identifiable.all() and len(found.bands) == 9 and both_inside(e) and (e.fit_p > 1e-3).all()
    at_resonance = np.argmin(e.stiffness_se.sum(axis=(1, 2)))
    np.testing.assert_allclose(e.stiffness[at_resonance], K, atol=150.0)
    errors = [(e.stiffness - K) / e.stiffness_se, (e.damping - C) / e.damping_se]
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_what_is_missing_is_named(crossed):
    current = replace(crossed[1], excitations=(replace(crossed[1].excitations[0], at="current"),))
    with pytest.raises(ValueError, match="an excitation at the force in every recording"):
        identify_planar([crossed[0], current], RIG, RIG.mass)
    with pytest.raises(
        ValueError, match="record 0: channels force_x, force_y, displacement_x, displacement_y are miss"
    ):
        identify_planar([axis_signals(crossed[0], 0)], RIG, RIG.mass)
    half = {n: v for n, v in crossed[0].channels.items() if n != "force_y"}
    with pytest.raises(ValueError, match="record 0: channels force_y are missing"):
        identify_planar([replace(crossed[0], channels=half)], RIG, RIG.mass)
    with pytest.raises(ValueError, match=r"mass.*must be positive"):
        identify_planar(crossed, RIG, -1.0)


def test_no_record_at_all_is_a_value_error():
    with pytest.raises(ValueError, match="need at least one recording"):
        identify_planar([], RIG, RIG.mass)
