"""A ball below a coil, as a logger stores it: it falls at the start, and its gap is measured away from the magnet."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from maglev_env.loop.controller_forms import Pid
from maglev_env.loop.gains import Gains
from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import parse_campaign
from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.recordings.guess.agreed import agreed
from maglev_env.recordings.guess.columns.stated_columns import with_stated
from maglev_env.recordings.guess.of_the_rig import perhaps_of_the_rig
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.suspended import below_the_magnet
from maglev_env.recordings.guess.verified import verified
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig import Rig

RATE, FALLEN, SIZE = 100.0, 150, 3000
MASS, GAIN, STIFFNESS, BIAS, GAP = 0.018, 0.93, 50.0, 0.38, 4e-3


def stored(folder, *, fallen=FALLEN, sign=1.0):
    """A file of a ball that rests on the floor under full current, is caught, and follows steps."""
    rng = np.random.default_rng(3)
    t = np.arange(SIZE) / RATE
    wanted = np.where(t < 15, GAP, GAP + 1e-3)
    gap = np.convolve(wanted, np.full(40, 1 / 40), "same") + 5e-5 * np.sin(2 * np.pi * 3.1 * t)
    gap[:20], gap[-20:] = wanted[:20], wanted[-20:]
    # The weight is carried where it rests, and moved by what is left: ki i = (ks + m w^2) (gap - 4 mm).
    force = STIFFNESS * (gap - GAP) - MASS * np.gradient(np.gradient(gap, t), t)
    current = BIAS + force / GAIN + 1e-3 * rng.standard_normal(SIZE)
    gap += 1e-5 * rng.standard_normal(SIZE)
    gap[:fallen], current[:fallen] = 0.02, 0.8
    columns = np.column_stack([t, sign * gap, current, sign * wanted])
    path = folder / "ball.txt"
    np.savetxt(path, columns, fmt="%.6f", delimiter="\t", header="t\ty\ti\tyd", comments="")
    return path


def test_the_part_after_the_fall_is_taken_and_reads_without_alarms(tmp_path):
    path = stored(tmp_path)
    found = verified(guess_recording(path), tmp_path)
    assert found.part is not None and FALLEN - 5 <= found.part[0] <= FALLEN + 50
    assert sum(found.part) == SIZE
    assert any(note.startswith("alarm: ") and "that stretch is taken" in note for note in found.notes)
    campaign = parse_campaign(tmp_path, {"schema": SCHEMA, "recording": [found.table()]})
    assert not alarms_of(read_recording(campaign, campaign.recordings[0]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_distance_from_the_magnet_is_turned_round(tmp_path, sign):
    found = verified(guess_recording(stored(tmp_path, fallen=0, sign=sign)), tmp_path)
    assert found.part is None and found.rotor.value == "suspended"
    assert found.channels["displacement"].scale == found.channels["reference"].scale == -sign
    assert ("offset = the gap" in found.channels["displacement"].ask) == (sign > 0)
    assert "total = true" in found.channels["current"].ask


def test_a_named_rig_tells_the_bias_of_the_current_and_the_gap_at_rest(tmp_path):
    found = verified(guess_recording(stored(tmp_path, fallen=0)), tmp_path)
    rig = Rig(name="ball", magnet="electromagnet", mass=MASS, gap=GAP, bias_current=BIAS, clearance=3e-3)
    told = below_the_magnet(found, rig, tmp_path)
    assert told.channels["current"].source == {"from": "i", "total": True}
    assert told.rotor.value == "suspended" and not told.rotor.ask
    for name, column in (("displacement", "y"), ("reference", "yd")):
        assert told.channels[name].source == {"from": column, "scale": -1.0, "offset": GAP}
        asked = told.channels[name].ask
        assert "offset =" not in asked and ("offset_tolerance" in asked) == (name in ("displacement", "current"))
    elsewhere = below_the_magnet(found, replace(rig, gap=10e-3), tmp_path)
    assert "offset = the gap" in elsewhere.channels["displacement"].ask and elsewhere.channels["current"].total
    volts = replace(
        found, columns=tuple(replace(c, channel=c.channel.replace("current", "voltage")) for c in found.columns)
    )
    for coil, known in ((rig, False), (replace(rig, coil_resistance=4.0, coil_inductance=0.02), True)):
        told = below_the_magnet(volts, coil, tmp_path).channels["voltage"]
        assert told.total and ("offset_tolerance" in told.ask) == known
    pair = replace(rig, magnet="electromagnet_pair", turns=100, pole_area=1e-4)
    assert below_the_magnet(found, pair, tmp_path) is found


def test_the_controller_of_a_named_rig_is_asked_for_where_the_command_shows_none(tmp_path):
    rng = np.random.default_rng(11)
    table = np.column_stack([np.arange(2000) / 500.0, 0.1 * rng.normal(size=2000), 0.9 + 0.1 * rng.normal(size=2000)])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t [s],pos [mm],cmd [A]", comments="", fmt="%.9f")
    found = guess_recording(tmp_path / "run.csv")
    rig = Rig(name="ball", magnet="electromagnet", mass=MASS, gap=GAP, bias_current=BIAS, clearance=3e-3)
    assert perhaps_of_the_rig(found, rig) is found
    for own, asked in ((Gains(200.0, 5.0, 3.0), "gains = { kp = 200.0"), (Pid(200.0), 'controller = { form = "pid"')):
        assert asked in perhaps_of_the_rig(found, replace(rig, gains=own)).controller.ask


@pytest.mark.parametrize("told_by", ["controller", "name", "voltage"])
def test_a_distance_is_told_without_large_motion(tmp_path, told_by):
    rng = np.random.default_rng(4)
    gap = 8.0 + 4e-3 * rng.normal(size=4000)
    columns = {"t [s]": np.arange(4000) / 1000.0, "pos [mm]" if told_by == "controller" else "Abstand [mm]": gap}
    columns["Spannung [V]" if told_by == "voltage" else "Iststrom [A]"] = 0.9 + 0.02 * rng.normal(size=4000)
    if told_by == "controller":
        columns["Sollstrom [A]"] = 0.9 + 0.4 * (gap - 8.0) + 3.0 * np.diff(gap, prepend=gap[0])
    table = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "hover.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9f")
    found = verified(guess_recording(tmp_path / "hover.csv"), tmp_path)
    assert found.channels["displacement"].scale == -1e-3
    assert "offset = the gap" in found.channels["displacement"].ask
    assert (found.gains is not None and found.gains["kp"] > 0) == (told_by == "controller")


@pytest.mark.parametrize(("rate", "scale"), [(49.0, 1.0), (5000.0, 1e-3)])
def test_a_gap_that_falls_faster_than_the_samples_is_not_in_mm(tmp_path, rate, scale):
    rng = np.random.default_rng(5)
    gap = 0.06 + 2e-3 * np.cumsum(rng.normal(size=2000)) / 45
    columns = np.column_stack([np.arange(2000) / rate, gap, 1.0 + 20 * (gap - 0.06)])
    np.savetxt(tmp_path / "run.csv", columns, delimiter=",", header="t,gap,i_cmd", comments="", fmt="%.6f")
    assert abs(guess_recording(tmp_path / "run.csv").channels["displacement"].scale) == scale


def test_noise_does_not_hide_the_direction_and_what_nothing_shows_is_asked_for(tmp_path):
    rng = np.random.default_rng(6)
    t, i = np.arange(20000) / 1000.0, 0.1 * rng.normal(size=20000)
    w = 2 * np.pi * np.fft.rfftfreq(t.size, 1e-3)
    # Noise that nobody stored drives the current: m d'' = -(ki i - ks d) about the resting gap, both signs are known.
    moved = np.fft.irfft(np.fft.rfft(i) * GAIN / (MASS * w**2 + STIFFNESS), t.size)
    seen = np.round(1e3 * (GAP + moved) + 5e-3 * rng.normal(size=t.size), 4)
    for name, values in (("moved.csv", seen), ("still.csv", 4 + 5e-3 * rng.normal(size=t.size))):
        table = np.column_stack([t, values, 1.0 + i])
        np.savetxt(tmp_path / name, table, fmt="%.5f", delimiter=",", header="t,pos [mm],i [A]", comments="")
    assert abs(np.corrcoef(seen, i)[0, 1]) < 0.4
    moved, still = (verified(guess_recording(tmp_path / name), tmp_path) for name in ("moved.csv", "still.csv"))
    assert moved.channels["displacement"].scale == -1e-3 and "offset = the gap" in moved.channels["displacement"].ask
    assert still.channels["displacement"].scale == 1e-3 and "scale < 0" in still.channels["displacement"].ask


@pytest.mark.parametrize(("name", "scale"), [("gap [mm]", -1e-3), ("height [mm]", 1e-3)])
def test_a_gap_is_turned_round_although_a_large_excitation_turns_the_current(tmp_path, name, scale):
    rng = np.random.default_rng(7)
    gap = 8 + 0.3 * np.sin(2 * np.pi * 5 * np.arange(4000) / 1000.0)
    current = 0.6 + 0.9 * (gap - 8) + 1e-3 * rng.normal(size=4000)
    current[:3] = -0.4  # as its controller was switched on
    table = np.column_stack([np.arange(4000) / 1000.0, gap, current])
    np.savetxt(tmp_path / "run.csv", table, fmt="%.5f", delimiter=",", header=f"t [s],{name},i [A]", comments="")
    found = verified(guess_recording(tmp_path / "run.csv"), tmp_path)
    assert found.rotor.confidence < 0.5 and found.channels["displacement"].scale == scale


def test_a_gap_is_turned_round_where_a_permanent_magnet_carries_the_weight(tmp_path):
    rng = np.random.default_rng(8)
    t = np.arange(8000) / 1000.0
    gap = 4 + 0.2 * np.sin(2 * np.pi * 3 * t) + 1e-3 * rng.normal(size=t.size)
    current = 0.7 * (gap - 4) + 1e-2 * rng.normal(size=t.size)  # around 0: zero-power control
    table = np.column_stack([t, gap, current])
    np.savetxt(tmp_path / "run.csv", table, fmt="%.5f", delimiter=",", header="t [s],gap [mm],i [A]", comments="")
    found = verified(guess_recording(tmp_path / "run.csv"), tmp_path)
    assert found.rotor.value == "supported" and found.channels["displacement"].scale == -1e-3
    assert "total" not in found.channels["current"].ask


def test_what_repels_its_rotor_counts_as_the_controller_of_another_file_shows(tmp_path):
    rng, t = np.random.default_rng(9), np.arange(4000) / 500.0
    steps = np.sign(np.sin(2 * np.pi * 0.25 * t + 0.1))
    slow = signal.lfilter([0.02], [1, -0.98], steps) + 1e-2 * rng.normal(size=t.size)
    for name, wanted, y in (("loop.csv", 20 + steps, 20 + slow), ("open.csv", 0 * t, 20 + slow)):
        current = 0.9 + (0.3 * (wanted - y) if name == "loop.csv" else 0.1 * steps)  # more of it pushes up
        table = np.column_stack([t, wanted, y, current])
        header = "t [s],reference [mm],height [mm],command [A]"
        np.savetxt(tmp_path / name, table, fmt="%.7f", delimiter=",", header=header, comments="")
    guesses = [verified(guess_recording(tmp_path / name), tmp_path) for name in ("loop.csv", "open.csv")]
    assert guesses[1].channels["displacement"].scale < 0  # alone, it is taken for a distance from a magnet
    loop, opened = agreed(guesses)
    assert loop.gains["kp"] == pytest.approx(300.0, rel=1e-3)
    assert loop.channels["displacement"].scale == opened.channels["displacement"].scale == 1e-3
    assert "as the controller of loop.csv shows" in opened.channels["displacement"].reason


@pytest.mark.parametrize("stated", [{}, {"adc": -1.1e-5}])
def test_a_set_point_that_counts_towards_the_magnet_beside_a_distance_is_not_turned_with_it(tmp_path, stated):
    """The sensor's counts rise with the distance. The loop of "fast.csv" does not follow and tells nothing."""
    rng, t = np.random.default_rng(10), np.arange(16000) / 400.0
    steps = np.repeat(rng.uniform(-1, 1, 80), t.size // 80)
    for name, wanted in (("steps.csv", steps), ("fast.csv", np.sign(np.sin(2 * np.pi * 40 * t)))):
        y = signal.lfilter([0.05], [1, -0.95], wanted) + 1e-3 * rng.normal(size=t.size)
        table = np.column_stack([t, np.rint(723 - 91 * y), 1000 * wanted, 0.92 - 0.06 * y])  # more of it holds it lower
        np.savetxt(tmp_path / name, table, fmt="%.4f", delimiter=",", header="t [s],adc,sp [um],i [A]", comments="")
    guesses = [told(tmp_path, tmp_path / name, **stated) for name in ("fast.csv", "steps.csv")]
    assert guesses[1].channels["displacement"].scale < 0 < guesses[1].channels["reference"].scale
    assert [g.channels["reference"].scale for g in agreed(guesses)] == [1e-6, 1e-6]
    assert "other direction" not in guesses[1].channels["reference"].ask


def told(folder, path, **scales):
    """The guess of a file with stated scales."""
    columns = with_stated(guess_recording(path).columns, scales, {})
    return verified(guess_recording(path, columns=columns), folder)


def test_a_stated_direction_stands_and_what_speaks_against_it_is_said(tmp_path):
    found = told(tmp_path, stored(tmp_path, fallen=0), y=1.0)
    moved = found.channels["displacement"]
    assert moved.scale == 1.0 and "as it seems (the current rises with it" in moved.ask
    assert found.channels["reference"].scale == 1.0


def test_what_is_wanted_counts_as_the_displacement_whose_direction_is_stated(tmp_path):
    found = told(tmp_path, stored(tmp_path, fallen=0), y=-1.0)
    assert found.channels["displacement"].scale == found.channels["reference"].scale == -1.0
    assert "scale > 0, if it counts in the other direction" in found.channels["reference"].ask
    rig = Rig(name="ball", magnet="electromagnet", mass=MASS, gap=GAP, bias_current=BIAS, clearance=3e-3)
    faced = below_the_magnet(found, rig, tmp_path)
    assert faced.channels["displacement"].offset == faced.channels["reference"].offset == GAP
    both = told(tmp_path, tmp_path / "ball.txt", y=-1.0, yd=1.0)
    assert both.channels["reference"].scale == 1.0


def test_a_total_voltage_is_less_what_holds_the_bias(tmp_path):
    stored(tmp_path, fallen=0)
    rig = tmp_path / "rig.toml"
    rig.write_text(
        'schema = "maglev-rig/1"\nname = "ball"\nmagnet = "electromagnet"\n[parameters]\n'
        f"mass = {MASS}\ngap = {GAP}\nclearance = 3e-3\nbias_current = {BIAS}\ncoil_resistance = 5.0\n"
        "coil_inductance = 0.01\ncontrol_rate = 100.0\n"
    )

    def read(total):
        voltage = {"from": "i", "total": total}
        recording = {
            "file": "ball.txt",
            "sample_rate": RATE,
            "excitation": [{"kind": "none"}],
            "channels": {"displacement": {"from": "y", "scale": -1.0, "offset": GAP}, "voltage": voltage},
        }
        campaign = parse_campaign(tmp_path, {"schema": SCHEMA, "rig": "rig.toml", "recording": [recording]})
        return read_recording(campaign, campaign.recordings[0])["voltage"].values

    np.testing.assert_allclose(read(False) - read(True), 5.0 * BIAS, rtol=1e-12)
