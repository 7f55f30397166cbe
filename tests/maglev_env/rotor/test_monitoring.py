"""Monitoring at speed: against the linear model along the orbit and the identification, a step found, bad input."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.rig.rig import with_parameters
from maglev_env.rotor.identification import Protocol, identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import mechanics
from maglev_env.rotor.monitoring import MonitorPlan, monitor
from maglev_env.rotor.operating_point import at_operating_point, sag
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.simulate import spin

PUMP = load_rotor("pump")
SPEED = 8000.0


def stiffer(rotor: Rotor, by: float) -> Rotor:
    """With so much (N/m) less of the magnets' negative stiffness, of which the controller knows nothing."""
    axis = rotor.axis
    return replace(rotor, axis=with_parameters(axis, {"negative_stiffness": axis.negative_stiffness + by}))


STEP = 3350.0  # N/m, a tenth of what the loop shows


@pytest.fixture(scope="module")
def watched():
    return [monitor(PUMP, stiffer(PUMP, STEP), SPEED, blocks=60, change=30, seed=seed) for seed in range(2)]


@pytest.mark.slow
def test_unbiased_against_the_linear_model_along_the_orbit(watched) -> None:
    for one in watched:
        t = one.tracked
        for part, stage in ((slice(5, 30), 0), (slice(35, 60), 1)):
            for value, se, expected, centred in (
                (t.stiffness[part], t.stiffness_se[part], one.expected[stage, 0], one.centred[stage, 0]),
                (t.damping[part], t.damping_se[part], one.expected[stage, 1], one.centred[stage, 1]),
            ):
                assert np.mean(abs(value - expected) < 1.96 * se) > 0.9
                assert (se < 2e-3 * expected).all()
                assert centred == pytest.approx(expected, rel=0.02)
        # About the centre the model misses by many standard errors: weight and orbit move the rotor into a stiffer law.
        assert (t.stiffness[5:30] - one.centred[0, 0] > 5 * t.stiffness_se[5:30]).all()
        assert np.median(t.chi_square / t.freedom) == pytest.approx(1, abs=0.3)  # with the rotor's own mass it is 7


@pytest.mark.slow
def test_the_step_is_found_at_once_and_nothing_before_it(watched) -> None:
    for one in watched:
        assert one.expected[1, 0] / one.expected[0, 0] == pytest.approx(1.1, abs=0.005)
        assert (one.alarms > one.change).all() and one.delay <= 0.5
    small = monitor(PUMP, stiffer(PUMP, 0.01 * STEP), SPEED)  # 0.1 %: half a standard error of a block
    assert not small.delay < 1.0


@pytest.mark.slow
def test_as_the_identification(watched) -> None:
    one, protocol = watched[0], Protocol(band=(60.0, 180.0))
    found = identify_runs([Run(PUMP, SPEED, 5)], protocol, threads=1)
    k, c = one.tracked.stiffness[29], one.tracked.damping[29]
    # The identification fits the rotor's own mass: the lighter one's share, weighted as its lines are, stiffness added.
    w = 2 * np.pi * protocol.lines[0] * protocol.fundamental
    w = w[(w >= 120 * np.pi) & (w <= 360 * np.pi)]
    weight = abs(k - one.mass * w**2 + 1j * w * c) ** -4
    lighter = (PUMP.moving_mass - one.mass) * np.average(w**2, weights=weight)
    assert lighter > 0.05 * k
    assert found.stiffness[0, 0] == pytest.approx(k + lighter, rel=0.01)
    assert found.damping[0, 0] == pytest.approx(c, rel=0.02)


def test_a_recording_goes_on_as_if_never_stopped() -> None:
    quiet = replace(
        PUMP, axis=replace(PUMP.axis, adc_bits=0, dac_bits=0, noise=replace(PUMP.axis.noise, displacement=0.0))
    )
    run = Run(quiet, SPEED)
    whole = spin([run, Run(quiet, 3000.0)], 4000)
    first = spin([run, Run(quiet, 3000.0)], 2000)
    rest = spin([run, Run(quiet, 3000.0)], 2000, start=first.end)
    assert rest.channels == pytest.approx(whole.channels[..., 2000:], abs=1e-12)
    with pytest.raises(ValueError, match=r"start: \(1, 36\); give q and rates \(10,\), or the end \(2, 36\)"):
        spin([run, run], 100, start=first.end[:1])


def test_the_operating_point() -> None:
    held = spin([Run(PUMP)], 4000, settle=8000).channels[0, :4].mean(axis=-1)
    expected = mechanics(PUMP).probes @ sag(PUMP)
    assert held[[1, 3]] == pytest.approx(expected[[1, 3]], rel=0.03)
    floating = replace(PUMP, gravity=(0.0, 0.0, 0.0))
    centre = at_operating_point(floating, 0.0).axis
    assert centre.actuator_gain == pytest.approx(PUMP.axis.actuator_gain, rel=1e-6)
    assert centre.negative_stiffness == pytest.approx(PUMP.axis.negative_stiffness, rel=1e-5)
    # To the lowest order the orbit's part grows as its square.
    half = replace(floating, unbalance=replace(PUMP.unbalance, static=PUMP.unbalance.static / 2, couple=1e-8))
    half = replace(half, runout=replace(PUMP.runout, amplitude=(0.25e-6, 0.25e-6)))
    off = [at_operating_point(r, 800.0).axis.negative_stiffness - centre.negative_stiffness for r in (floating, half)]
    assert off[0] > 100 and off[0] / off[1] == pytest.approx(4, rel=0.02)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"change": 80}, "at least 10 must come before"),
        ({"speed_rpm": 0.0}, "must be above 0"),
        ({"plan": MonitorPlan(fundamental=3.0)}, "is not whole"),
        ({"before": replace(PUMP, gains=dict(zip("ab", PUMP.gains.values(), strict=True)))}, "translation and tilt"),
        ({"after": stiffer(PUMP, -60e3), "blocks": 20, "change": 10}, "touches down after the change"),
    ],
)
def test_bad_input(change: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        monitor(**({"before": PUMP, "after": PUMP, "speed_rpm": SPEED} | change))
