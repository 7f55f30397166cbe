"""The current of a coil by its voltage: against the coil's and the rotor's differential equations by scipy."""

from dataclasses import replace

import ball_bench
import numpy as np
import pytest
from ball_bench import BALL
from scipy.integrate import solve_ivp

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.recorded.channel_errors import ChannelError
from sim2real.recorded.current_by_voltage import current_by_voltage
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import read_records

RATE, N, RESISTANCE, INDUCTANCE = 2000.0, 4000, 4.0, 0.03
RIG = replace(load_rig("eframe"), coil_resistance=RESISTANCE, coil_inductance=INDUCTANCE)
GAIN = linearise(force_law(RIG))[0]


@pytest.fixture(scope="module")
def coil():
    """Held voltage, a motion, and the current of a coil in which it induces GAIN times the velocity."""
    rng = np.random.default_rng(3)
    voltage = np.repeat(rng.normal(size=N // 20), 20)
    position = lambda t: 2e-3 * np.sin(2 * np.pi * 7 * t) + 1e-3 * np.sin(2 * np.pi * 31 * t + 1)  # noqa: E731
    current, found = voltage[0] / RESISTANCE, []
    for k in range(N):
        found.append(current)

        def slope(t, i, u=voltage[k]):
            velocity = 2e-3 * 14 * np.pi * np.cos(14 * np.pi * t) + 1e-3 * 62 * np.pi * np.cos(62 * np.pi * t + 1)
            return (u - RESISTANCE * i - GAIN * velocity) / INDUCTANCE

        current = solve_ivp(slope, (k / RATE, (k + 1) / RATE), [current], rtol=1e-9, atol=1e-12).y[0, -1]
    return voltage, position(np.arange(N) / RATE), np.array(found)


def test_what_the_motion_induces_is_in_the_current(coil):
    voltage, displacement, current = coil
    channels = {"voltage": voltage[None], "displacement": displacement[None]}
    found = current_by_voltage(RIG, channels, RATE)
    settled = slice(400, None)  # what flowed at the start is not known
    left = found.current[0, settled] - current[settled]
    still = current_by_voltage(RIG, channels | {"displacement": 0 * displacement[None]}, RATE).current[0, settled]
    assert left.std() < 2e-3 * current.std() and (still - current[settled]).std() > 0.3 * current.std()


def test_an_error_of_the_gain_acts_by_the_displacement(coil):
    voltage, displacement, _ = coil
    stiffer = replace(RIG, tolerance={"actuator_gain": 0.2, "coil_resistance": 0.01})
    channels = {"voltage": voltage[None], "displacement": displacement[None]}
    scale, induced = current_by_voltage(stiffer, channels, RATE).errors[0]
    assert scale.scale == 0.01 and induced.by != "current" and scale.by == "current"
    frequency = np.array([7.0, 31.0])
    s = 2j * np.pi * frequency
    np.testing.assert_allclose(induced.factor(frequency), -0.2 * GAIN * s / (RESISTANCE + s * INDUCTANCE), rtol=1e-12)
    np.testing.assert_allclose(induced.whole_factor(frequency, 0.5), induced.factor(frequency) / 2, rtol=1e-12)
    assert ChannelError("scale", "force", scale=0.1).by == "force"


def test_a_recorded_current_or_an_unknown_coil_needs_no_voltage(coil):
    voltage, displacement, current = coil
    channels = {"voltage": voltage[None], "displacement": displacement[None]}
    assert current_by_voltage(RIG, channels | {"current": current[None]}, RATE) is None
    assert current_by_voltage(replace(RIG, coil_inductance=None), channels, RATE) is None


@pytest.mark.parametrize("excitation", ["none", "multisine"])
@pytest.mark.parametrize("controller", ["", "{ kp = 200.0, ki = 1500.0, kd = 3.5, td = 2e-3 }"])
def test_a_measured_voltage_drives_whatever_else_is_stated(tmp_path, controller, excitation):
    """What a stated controller and the nominal amplifier would make lacks what the motion induces."""
    text = BALL.replace("[gains]", "coil_resistance = 4.0\ncoil_inductance = 4e-3\n[gains]", 1)
    reference = 1e-4 * np.sin(2 * np.pi * 5 * np.arange(2000) / 1000)
    run = ball_bench.record(rig_from_toml(text, "ball"), 2.0, 3, reference=reference)
    current = run["current"]
    voltage = 4.0 * current + 4e-3 * np.gradient(current, 1e-3)
    runs = {"one": {"displacement": run["displacement"], "voltage": voltage, "reference": reference}}
    folder = ball_bench.write_campaign(tmp_path, text, controller, runs, ("displacement", "voltage", "reference"))
    path, stated = folder / "campaign.toml", 'voltage = { from = "voltage" }'
    toml = path.read_text().replace("controller = \n", "")
    toml = toml.replace(stated, 'voltage = { from = "voltage", delay_tolerance = 2e-5 }').replace(
        "sample_rate", 'intersample = "zoh"\nsample_rate'
    )
    if excitation == "multisine":
        wave = 'kind = "multisine", at = "reference", period_samples = 200, amplitude = 1e-4, lines = [1]'
        toml = toml.replace('kind = "none"', wave)
    path.write_text(toml)
    ((record,),) = (read_records(folder)[1],)
    assert isinstance(record, OpenRecord) and record.source == "current"
    assert any("computed from the voltage" in note for note in record.notes)
    assert any("straight lines between samples" in note for note in record.notes)  # a converter holds the voltage alone
    delays = [e for e in record.errors if e.delay]
    assert [(e.name, e.channel, e.delay) for e in delays] == [("delay of voltage", "current", 2e-5)]
