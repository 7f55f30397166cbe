"""Bounds and starts of delay, lags and damping follow control rate and mass; a long delay is simulated as long."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.card import SLOWEST, SMALL_ROTOR, Scales
from maglev_env.loop.effect import EFFECTS, effect, parse_effect
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import RIG_FOLDER, load_rig, rig_from_toml
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.starts import starts

BALL = Rig("ball", "electromagnet", mass=0.018, gap=10e-3, turns=1000, pole_area=1e-4, control_rate=100.0)
HEAVY = replace(load_rig("hmb_free"), mass=5.0)


@pytest.mark.parametrize("name", ["delay", "amplifier_lag", "sensor_lag"])
def test_lags_are_stated_in_control_periods(name):
    (p,) = EFFECTS[name].plain.values()
    fast, slow = p.on(HEAVY.scales), p.on(BALL.scales)
    for attribute in ("high", "scale", "starts"):
        assert getattr(slow, attribute) == pytest.approx(200 * np.array(getattr(fast, attribute)))
    assert slow.high > 10 / BALL.control_rate and p.high >= 20


def test_damping_follows_mass_and_rate():
    (p,) = EFFECTS["damping"].parameters.values()
    ball, heavy = p.on(BALL.scales), p.on(HEAVY.scales)
    assert ball.high == pytest.approx(0.625 * 0.018 * 100) and heavy.high == pytest.approx(0.625 * 5 * 20000)
    assert p.on(SMALL_ROTOR).scale == pytest.approx(1.0, rel=0.01)
    k = 100.0  # N/m: the ball's critical damping is within
    assert 2 * np.sqrt(k * BALL.mass) < 3 * ball.high


def test_a_delay_within_the_bounds_of_a_slow_rig_is_beyond_those_of_a_fast_one():
    late = effect("delay", 0.05)
    assert replace(BALL, effects=late).effects == late
    with pytest.raises(ValueError, match=r"time = 0.05 is outside 0 .. 0.001 s on rig hmb_free"):
        rig_from_toml((RIG_FOLDER / "hmb_free.toml").read_text() + "[effects.delay]\ntime = 0.05\n", "here")
    with pytest.raises(ValueError, match=r"is outside 0 .. 0.1 s on rig hmb_free"):  # a simulation may be finer
        replace(load_rig("hmb_free"), effects=effect("delay", 0.2))
    with pytest.raises(ValueError, match=r"is outside 0 .. 20 s"):
        parse_effect("delay=25")
    assert EFFECTS["damping"].parameters["coefficient"].on(SLOWEST).high == np.inf


def test_a_fit_on_a_slow_rig_starts_and_ends_at_its_own_samples():
    h = Hypothesis(("delay",), {}, scales=Scales(0.01, 0.018))
    assert [c.value(1.0) for c in h.coordinates] == pytest.approx([2e-3])
    assert h.point(h.bounded(np.array([1e6]))).effects["delay"]["time"] == pytest.approx(0.2)
    assert [h.point(u).effects["delay"]["time"] for u in starts("delay", h.scales)] == pytest.approx([2e-3, 1.5e-2])
    assert h.instead("mass").scales == h.scales


def test_a_fitted_zero_of_the_amplifier_stays_below_the_bias_current():
    def most(rig):
        h = Hypothesis(("actuator_offset",), {}, scales=rig.scales)
        return [h.point(h.bounded(np.array([u]))).effects["actuator_offset"]["current"] for u in (-1e6, 1e6)]

    assert most(replace(HEAVY, bias_current=1.2)) == [-1.2, 1.2]
    carries = abs(force_law(BALL).bias_current)  # it states none
    assert most(BALL) == pytest.approx([-carries, carries])
    assert replace(HEAVY, bias_current=1.2, effects=effect("actuator_offset", 2.0)).effects  # a user may ask for more


@pytest.mark.parametrize("periods", [7.0, 20.0])
def test_the_longest_delay_is_simulated_as_long(periods):
    rig = replace(load_rig("hmb_radial"), axes=1, amplifier_time_constant=0.0, dac_bits=0, control_rate=1000.0,
                  gains=None, protocol=None, effects=effect("delay", periods / 1000.0))  # fmt: skip
    pushed = Excitation("sphs", "current", 4.0, (1, 3, 7), 0.1)
    e = Experiment(rig, Gains(10.0, 0.0, 0.0, 1e-3, 1.0), (pushed,), periods=2, transient_periods=0)
    e = replace(e, rig=replace(rig, noise=type(rig.noise)()))
    _, command, current = simulate_records([e])[0][:3]
    whole = int(periods)
    assert current[whole:] == pytest.approx(command[:-whole], abs=1e-12) and np.ptp(command) > 0.05
    assert not current[: whole - 1].any()
