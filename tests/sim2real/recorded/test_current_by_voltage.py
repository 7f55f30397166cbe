"""The current of a coil by its voltage: against the coil's and the rotor's differential equations by scipy."""

from dataclasses import replace

import ball_bench
import numpy as np
import pytest
from ball_bench import BALL
from scipy.integrate import solve_ivp

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.recorded.at_rest.static_evidence import rests_of
from sim2real.recorded.channel_errors import ChannelError
from sim2real.recorded.current_by_voltage import current_by_voltage
from sim2real.recorded.open_reading import open_record
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
    scale, induced, _ = current_by_voltage(stiffer, channels, RATE).errors[0]
    assert scale.scale == 0.01 and induced.by != "current" and scale.by == "current"
    frequency = np.array([7.0, 31.0])
    s = 2j * np.pi * frequency
    np.testing.assert_allclose(induced.factor(frequency), -0.2 * GAIN * s / (RESISTANCE + s * INDUCTANCE), rtol=1e-12)
    np.testing.assert_allclose(induced.whole_factor(frequency, 0.5), induced.factor(frequency) / 2, rtol=1e-12)
    assert ChannelError("scale", "force", scale=0.1).by == "force"


def test_an_error_of_the_inductance_is_that_of_another_coil(coil):
    """What it changes is what a coil of that inductance makes of the same voltage, by any amount."""
    voltage, displacement, _ = coil
    channels = {"voltage": voltage[None], "displacement": displacement[None]}
    for stated, relative in (({}, 0.1), ({"coil_inductance": 0.2}, 0.2)):
        error = current_by_voltage(replace(RIG, tolerance=stated), channels, RATE).errors[0][2]
        assert error.by == "current" and error.inductance == relative
        frequency = np.array([0.0, 7.0, 31.0, 200.0])
        s = 2j * np.pi * frequency
        for amount in (-3.0, 1e-3, 2.0):
            other = INDUCTANCE * np.exp(amount * relative)
            expected = (RESISTANCE + s * INDUCTANCE) / (RESISTANCE + s * other) - 1
            np.testing.assert_allclose(error.whole_factor(frequency, amount), expected, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(error.factor(frequency), error.whole_factor(frequency, 1e-7) / 1e-7, rtol=1e-6)


def test_a_recorded_current_or_an_unknown_coil_needs_no_voltage(coil):
    voltage, displacement, current = coil
    channels = {"voltage": voltage[None], "displacement": displacement[None]}
    assert current_by_voltage(RIG, channels | {"current": current[None]}, RATE) is None
    assert current_by_voltage(replace(RIG, coil_inductance=None), channels, RATE) is None


def test_a_current_that_is_recorded_beside_its_voltage_drives_under_a_stated_controller(tmp_path):
    """The nominal amplifier behind that controller lacks what the motion induces."""
    text = BALL.replace("[gains]", "coil_resistance = 4.0\ncoil_inductance = 4e-3\n[gains]", 1)
    reference = 1e-4 * np.sin(2 * np.pi * 5 * np.arange(2000) / 1000)
    run = ball_bench.record(rig_from_toml(text, "ball"), 2.0, 3, reference=reference)
    run["reference"] = reference
    run["voltage"] = 4.0 * run["current"] + 4e-3 * np.gradient(run["current"], 1e-3)
    lines = BALL.split("[gains]")[1].splitlines()
    controller = f"{{ {', '.join(line.partition('#')[0].strip() for line in lines if '=' in line)} }}"
    sources = {}
    for names in (("displacement", "current", "voltage", "reference"), ("displacement", "current", "reference")):
        (folder := tmp_path / str(len(names))).mkdir()
        path = ball_bench.write_campaign(folder, text, controller, {"one": run}, names) / "campaign.toml"
        stated = path.read_text().replace('from = "current"', 'from = "current", delay_tolerance = 2e-5')
        path.write_text(stated)
        campaign = load_campaign(folder)
        record = open_record(campaign, campaign.recordings[0], read_recording(campaign, campaign.recordings[0]))
        sources["voltage" in names] = record.source
        if "voltage" in names:  # as recorded, not as the voltage tells it
            assert not any("computed from the voltage" in note for note in record.notes)
    assert sources == {True: "current", False: None}


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
    assert any(
        note.startswith("the computed current drives the simulation (straight lines") for note in record.notes
    )  # a converter holds the voltage alone
    delays = [e for e in record.errors if e.delay]
    assert [(e.name, e.channel, e.delay) for e in delays] == [("delay of voltage", "current", 2e-5)]


@pytest.mark.parametrize(("lag", "by_current"), [(1e-3, True), (2e-4, False)])
def test_a_coil_under_a_recorded_voltage_is_driven_by_its_current_whether_it_repeats_or_not(tmp_path, lag, by_current):
    """The amplifier that such a rig states is the coil, which lacks what the motion induces; a current amplifier of its
    own is simulated."""
    lines = [line for line in BALL.splitlines() if not line.startswith("amplifier_time_constant")]
    coil = f"coil_resistance = 4.0\ncoil_inductance = 4e-3\namplifier_time_constant = {lag}\n[gains]"
    text = "\n".join(lines).replace("[gains]", coil, 1)
    reference = 1e-4 * np.sin(2 * np.pi * 5 * np.arange(2000) / 1000)
    run = ball_bench.record(rig_from_toml(text, "ball"), 2.0, 3, reference=reference)
    run |= {"reference": reference, "voltage": 4.0 * run["current"] + 4e-3 * np.gradient(run["current"], 1e-3)}
    names = ("displacement", "current", "voltage", "reference")
    folder = ball_bench.write_campaign(
        tmp_path, text, "{ kp = 200.0, ki = 1500.0, kd = 3.5, td = 2e-3 }", {"one": run}, names
    )
    path = folder / "campaign.toml"
    wave = 'kind = "multisine", at = "reference", period_samples = 200, amplitude = 1e-4, lines = [1]'
    path.write_text(path.read_text().replace('kind = "none"', wave))
    (record,) = read_records(folder)[1]
    assert isinstance(record, OpenRecord) == by_current
    if by_current:
        assert record.source == "current" and any("recorded current drives" in note for note in record.notes)


def hovering(tmp_path, stated: str = "", shown: str = "voltage"):
    """A campaign of a ball at three levels whose voltage alone is recorded; `stated` goes into that channel."""
    text = BALL.replace("[gains]", "coil_resistance = 4.0\ncoil_inductance = 4e-3\n[gains]", 1)
    run = ball_bench.record(rig_from_toml(text, "ball"), 3.0, 3, reference=np.repeat([0.0, 4e-4, -4e-4], 1000))
    runs = {"one": {**run, "voltage": 4.0 * run["current"] + 4e-3 * np.gradient(run["current"], 1e-3)}}
    folder = ball_bench.write_campaign(tmp_path, text, "", runs, ("displacement", shown))
    path = folder / "campaign.toml"
    toml = path.read_text().replace("controller = \n", "")
    toml = toml.replace(f'from = "{shown}"', f'from = "{shown}"{stated}')
    path.write_text(toml.replace('from = "displacement"', 'from = "displacement", offset_tolerance = 1e-5'))
    return load_campaign(folder)


def test_a_mean_voltage_tells_what_carries_the_weight(tmp_path):
    """Its offset and drift are stated in volts, and its scale is no surer than the resistance."""
    found = []
    for shown, stated in (
        ("voltage", ", offset_tolerance = 0.02, offset_drift = 0.04, scale_tolerance = 0.03"),
        ("current", ", offset_tolerance = 0.005, offset_drift = 0.01, scale_tolerance = 0.05"),
    ):
        folder = tmp_path / shown
        folder.mkdir()
        campaign = hovering(folder, stated, shown)
        (spec,) = campaign.recordings
        found.append(rests_of(campaign.rig, spec, read_recording(campaign, spec)))
    by_voltage, measured = found
    for name in ("displacement_offset", "current_offset", "displacement_scale", "current_scale", "current_drift"):
        assert getattr(by_voltage.tolerances, name) == pytest.approx(getattr(measured.tolerances, name)), name
    assert by_voltage.levels.count == measured.levels.count > 10
    np.testing.assert_allclose(by_voltage.levels.current, measured.levels.current, atol=5e-3)
    without = hovering(tmp_path)
    assert rests_of(without.rig, without.recordings[0], read_recording(without, without.recordings[0])) is None


@pytest.mark.parametrize(("stated", "untold"), [("", 1), (", delay_tolerance = 2e-5", 0)])
def test_the_time_of_a_voltage_is_asked_of_the_voltage(tmp_path, stated, untold):
    """No channel current is there of which it could be stated; nothing else drives such a recording, so that its
    voltage is believed only where its time is stated."""
    campaign = hovering(tmp_path, stated)
    if untold:
        with pytest.raises(TellsNothing, match="delay_tolerance of the voltage"):
            open_record(campaign, campaign.recordings[0], read_recording(campaign, campaign.recordings[0]))
    else:
        record = open_record(campaign, campaign.recordings[0], read_recording(campaign, campaign.recordings[0]))
        assert [e.name for e in record.errors if e.delay] == ["delay of voltage"]
