"""Rigs that state no gains, bounds or protocol get ones that levitate and stay near the centre."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.design.defaults import REACH, with_defaults
from maglev_env.evaluation.identification import identify
from maglev_env.experiment import Experiment, axis_experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.axes import Cross
from maglev_env.loop.gains import GAIN_CARDS, NO_CONTROLLER, Gains, LinearController, of_axis
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Noise, Rig, axis_rig, with_parameters
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.task import make_task


def bare(rig, **changes):
    return replace(rig, gains=None, bounds={}, protocol=None, **changes)


FREE, RADIAL, EFRAME = (bare(load_rig(name)) for name in ("hmb_free", "hmb_radial", "eframe"))
QUIET = Noise(displacement=1e-6)
BALL = Rig("ball", "electromagnet", 0.058, gap=10e-3, turns=1000, pole_area=3e-4, control_rate=1000.0, noise=QUIET)
COIL = Rig(
    "coil", "magnet_coil", 0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0, control_rate=1000.0, noise=QUIET
)
STAND = Rig("stand", "none", 0.5, support_stiffness=1e4, support_damping=2.0, control_rate=4000.0, noise=QUIET)
RIGS = {
    "hybrid_pair": FREE,
    "hybrid_pair at 3 kHz": bare(FREE, control_rate=3000.0),
    "hybrid_pair on springs, x-y": RADIAL,
    "hybrid_pair on unlike springs, x-y": bare(RADIAL, per_axis={"y": {"support_stiffness": 2e4}}),
    "hybrid_pair, x-y": bare(FREE, axes=2),
    "electromagnet_pair": EFRAME,
    "electromagnet_pair, x-y": bare(EFRAME, axes=2),
    "electromagnet": BALL,
    "magnet_coil": COIL,
    "magnet_coil, pushed away": replace(COIL, remanence=1.0, magnet_length=5e-3, magnet_area=1e-4),
    "none": STAND,
    "none, x-y": replace(STAND, axes=2, cross=Cross(stiffness_xy=1e-3)),
}


@pytest.mark.parametrize("name", RIGS)
def test_the_rig_levitates_through_its_protocol_and_stays_near_the_centre(name):
    rig = with_defaults(RIGS[name])
    e = protocol_experiment(rig, seed=1)
    record = simulate_records([e])[0]
    assert np.isfinite(record).all()  # no touchdown
    reach = np.abs(np.hypot(*record[:2]) if rig.axes == 2 else record[0]) / rig.clearance
    # Stated is 5 %; starting from rest, noise, and the sum of x and y come on top, and phases rarely all agree.
    assert 0.5 * REACH < reach.max() < 0.08


@pytest.mark.parametrize("name", RIGS)
def test_gains_are_robust_and_the_protocol_fits_the_rig(name):
    rig = with_defaults(RIGS[name])
    assert rig.protocol.periods == 5 and {e.fundamental for e in rig.protocol.excitations} == {1.0}
    force, *injections = rig.protocol.excitations
    assert force.at == "force" and force.direction == (45.0 if rig.axes == 2 else 0.0)
    assert force.lines[0] == (2 if rig.controlled else 1) and force.lines[-1] <= min(250, 0.2 * rig.control_rate)
    for axis, injection in enumerate(injections):
        assert injection.at == "current" and injection.direction == 90.0 * axis
        assert injection.lines[0] == 1 + 2 * axis and injection.lines[-1] <= min(2000, 0.4 * rig.control_rate)
    assert len(injections) == (rig.axes if rig.controlled else 0)
    if not rig.controlled:
        assert rig.gains == NO_CONTROLLER and not rig.bounds
        return
    f = np.geomspace(1e-4, 0.5, 500) * rig.control_rate
    for axis in range(rig.axes):
        own = axis_experiment(Experiment(rig, rig.gains, ()), axis)
        assert np.abs(closed_loop_poles(own)).max() < 1 and np.abs(loop_response(own, f).sensitivity).max() < 2.0
    first = of_axis(rig.gains, 0)
    for gain, (low, high) in rig.bounds.items():
        assert (
            low == pytest.approx(GAIN_CARDS[gain].tuned[0] * getattr(first, gain)) and low < getattr(first, gain) < high
        )


def test_the_nominal_reach_is_five_percent_of_the_clearance_in_all_parts():
    """The steady motion by convolution of the waveforms with the closed loop's responses."""
    rig = with_defaults(EFRAME)
    e = protocol_experiment(rig)
    n = e.samples_per_period
    response = loop_response(e, np.arange(1, n // 2))
    for part, size in (("force", response.receptance), ("current", response.plant * response.sensitivity)):
        spectrum = np.fft.rfft(e.waveform(part))[1 : n // 2] * size
        moved = np.fft.irfft(np.concatenate([[0], spectrum, [0]]), n)
        assert np.abs(moved).max() == pytest.approx(REACH * rig.clearance / 2, rel=1e-6)


def test_what_a_rig_states_is_kept():
    stated = load_rig("hmb_free")
    assert with_defaults(stated) is stated
    own = Protocol(stated.protocol.excitations, periods=9)
    kept = with_defaults(replace(FREE, gains=stated.gains, bounds={"kp": (1.0, 2.0)}, protocol=own))
    assert (kept.gains, kept.bounds, kept.protocol) == (stated.gains, {"kp": (1.0, 2.0)}, own)
    filtered = LinearController((9000.0, -8000.0), (1.0, -0.5))
    assert with_defaults(replace(RADIAL, gains=filtered)).bounds == {}
    pair = with_defaults(replace(RADIAL, gains=(stated.gains, Gains(7000.0, 2000.0, 6.0))))
    assert pair.bounds["kp"] == (0.6 * 8000.0, 2.5 * 8000.0)  # of x
    no_integrator = with_defaults(replace(FREE, gains=Gains(8000.0, 0.0, 5.2)))
    assert set(no_integrator.bounds) == {"kp", "kd"}


def test_each_axis_has_gains_of_its_own():
    rig = with_defaults(bare(RADIAL, per_axis={"y": {"support_stiffness": 0.0, "mass": 0.2}}))
    x, y = rig.gains
    assert x == with_defaults(axis_rig(RADIAL, 0)).gains != y
    assert y == with_defaults(with_parameters(axis_rig(RADIAL, 1), {"support_stiffness": 0.0, "mass": 0.2})).gains


def test_what_cannot_have_defaults_says_why():
    with pytest.raises(ValueError, match=r"hmb_free: its \[gains\] leave it unstable"):
        with_defaults(replace(FREE, gains=Gains(500.0, 0.0, 0.2)))
    with pytest.raises(ValueError, match=r"ball: no default gains stabilise it.*raise control_rate"):
        with_defaults(replace(BALL, control_rate=100.0, amplifier_time_constant=0.05))
    for rig, lacks in ((FREE, "protocol"), (replace(load_rig("hmb_free"), gains=None), "gains")):
        with pytest.raises(ValueError, match=rf"hmb_free: its TOML has no \[{lacks}\]; fill it in by with_defaults"):
            protocol_experiment(rig)


def test_a_mass_without_support_has_no_default_protocol():
    adrift = Rig("adrift", "none", 1.0, control_rate=4000.0)
    with pytest.raises(ValueError, match=r"rig adrift: nothing holds it.*give support_stiffness or a"):
        with_defaults(adrift)
    own = Protocol((Excitation("sphs", lines=(1, 2)),))
    assert with_defaults(replace(adrift, protocol=own)).protocol is own


def margins_of(rig):
    """Per axis: measured peak sensitivity, its interval, and the exact one of the linear loop."""
    e = protocol_experiment(rig, seed=2)
    dataset = simulated_recording(e, simulate_records([e])[0])
    channels = {str(n): dataset[n].values for n in dataset.data_vars}
    both = RecordedSignals(channels, rig.control_rate, e.excitations, rig.control_rate, e.gains, axes=rig.axes)
    for axis in range(rig.axes):
        found = identify(axis_signals(both, axis), axis_rig(rig, axis), rig.mass).stability
        f = np.geomspace(1.0, 0.4 * rig.control_rate, 50_000)
        exact = np.abs(loop_response(axis_experiment(e, axis), f).sensitivity).max()
        yield found.margins.peak_sensitivity, found.margins.intervals["peak_sensitivity"], exact


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hybrid_pair", "electromagnet_pair", "electromagnet"])
def test_the_protocol_shows_the_margins_of_a_levitated_rotor(name):
    for peak, (low, high), exact in margins_of(with_defaults(RIGS[name])):
        assert peak == pytest.approx(exact, rel=0.03) and 0.99 * low < exact < 1.01 * high


@pytest.mark.slow
def test_the_protocol_shows_the_margins_of_a_rotor_on_springs():
    for peak, (low, high), exact in margins_of(with_defaults(replace(RADIAL, support_stiffness=6e4))):
        assert peak == pytest.approx(exact, rel=0.1) and 0.95 * low < exact < 1.05 * high


@pytest.mark.parametrize("rate, apart", [(49.0, 0.25), (100.0, 0.5), (961.5385, 0.9995), (8333.3333, 1.0)])
def test_slow_and_odd_control_rates_have_lines_enough_to_be_tuned(rate, apart):
    magnet = Rig("magnet", "magnet_coil", 0.016, gap=60e-3, force_constant=2e-6, force_exponent=4.0, control_rate=rate)
    protocol = make_task(replace(magnet, noise=QUIET)).rig.protocol  # refuses too few lines
    samples = rate / protocol.excitations[0].fundamental
    assert samples == pytest.approx(round(samples), abs=1e-6)
    assert protocol.excitations[0].fundamental == pytest.approx(apart, rel=1e-3)
    force, injection = protocol.excitations
    assert 0 < protocol.band_width <= force.frequencies[-1] - force.frequencies[0]
    assert not set(force.lines) & set(injection.lines) and injection.frequencies[-1] <= 0.41 * rate
