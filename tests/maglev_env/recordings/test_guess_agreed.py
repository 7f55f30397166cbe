"""Files of one rig: what one file cannot tell of a column, another one with the same column may."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.recordings.guess.agreed import agreed, like_most, one_clock, one_controller, one_rotor, without_motion
from maglev_env.recordings.guess.columns.stated_columns import with_stated
from maglev_env.recordings.guess.evidence import Guess
from maglev_env.recordings.guess.recording import RecordingGuess, guess_recording
from maglev_env.recordings.guess.verified import verified


def stored(folder, name, positions, current):
    t = np.arange(positions.size) / 1000.0
    np.savez(folder / name, t=t, pos=positions, i=current)
    return verified(guess_recording(folder / name), folder)


def test_a_quiet_file_takes_the_unit_that_a_moving_one_shows(tmp_path):
    rng = np.random.default_rng(1)
    slow = np.cumsum(rng.normal(size=4000))  # white noise of mm would be an acceleration that tells µm
    quiet = stored(tmp_path, "a.npz", 3.0 * slow / slow.std(), rng.normal(size=4000))  # um, but like mm
    moving = stored(tmp_path, "b.npz", 90.0 * rng.normal(size=4000), rng.normal(size=4000))
    assert (quiet.channels["displacement"].scale, moving.channels["displacement"].scale) == (1e-3, 1e-6)
    found = [g.channels["displacement"] for g in agreed([quiet, moving])]
    assert [c.scale for c in found] == [1e-6, 1e-6]
    assert "the larger values of b.npz" in found[0].reason and "unit of this column" in found[0].ask


def test_a_stated_zero_follows_the_unit_and_the_direction_that_another_file_shows(tmp_path):
    rng = np.random.default_rng(1)
    slow = np.cumsum(rng.normal(size=4000))
    quiet = stored(tmp_path, "a.npz", 4.0 + 3.0 * slow / slow.std(), rng.normal(size=4000))
    moving = stored(tmp_path, "b.npz", 90.0 * rng.normal(size=4000), rng.normal(size=4000))
    quiet = replace(quiet, columns=with_stated(quiet.columns, {}, {"pos": 4.0}))
    for told, scale in ((moving, 1e-6), (replace(moving, columns=turned(moving.columns)), -1e-6)):
        found = agreed([quiet, told])[0].channels["displacement"]
        assert found.scale == scale and found.offset == pytest.approx(-4.0 * scale)


def turned(columns):
    return tuple(replace(c, scale=-c.scale) if c.channel == "displacement" else c for c in columns)


def test_a_direction_that_one_file_shows_holds_for_all(tmp_path):
    rng = np.random.default_rng(2)
    steps = np.repeat(rng.uniform(-1e-3, 1e-3, 16), 250)
    moving = stored(tmp_path, "steps.npz", 6e-3 + steps, 1.0 + 100 * steps + 1e-3 * rng.normal(size=4000))
    hover = stored(tmp_path, "hover.npz", 6e-3 + 1e-6 * rng.normal(size=4000), 1.0 + 1e-3 * rng.normal(size=4000))
    assert (moving.channels["displacement"].scale, hover.channels["displacement"].scale) == (-1.0, 1.0)
    found = agreed([hover, moving])
    assert [g.channels["displacement"].scale for g in found] == [-1.0, -1.0]
    assert "as steps.npz shows" in found[0].channels["displacement"].reason
    assert "offset = the gap" in found[0].channels["displacement"].ask
    asks = [g.channels["displacement"].ask for g in (hover, found[0])]
    assert ["scale < 0" in ask for ask in asks] == [True, False]


def test_a_controller_counts_in_the_direction_of_its_displacement(tmp_path):
    rng = np.random.default_rng(3)
    gap = 6e-3 + 1e-3 * np.cumsum(rng.normal(size=4000)) / 60
    t = np.arange(gap.size) / 1000.0
    np.savez(tmp_path / "ball.npz", t=t, gap_m=gap, i_cmd_A=1.0 + 150.0 * (gap - 6e-3))
    found = verified(guess_recording(tmp_path / "ball.npz"), tmp_path)
    assert found.channels["displacement"].scale == -1.0
    assert found.gains is not None and abs(found.gains["kp"] - 150.0) < 1e-3 and not found.controller.ask


def test_gains_follow_the_unit_that_another_file_shows(tmp_path):
    rng = np.random.default_rng(4)
    small, large = (s * np.cumsum(rng.normal(size=4000)) / 30 for s in (3.0, 90.0))
    t = np.arange(small.size) / 1000.0
    for name, y in (("a.npz", small), ("b.npz", large)):
        np.savez(tmp_path / name, t=t, pos=y, i_cmd_A=-0.5 * y)
    found = agreed([verified(guess_recording(tmp_path / name), tmp_path) for name in ("a.npz", "b.npz")])
    assert {g.channels["displacement"].scale for g in found} == {1e-6}
    assert [round(g.gains["kp"]) for g in found] == [500_000, 500_000]  # 0.5 A/um


def test_nameless_columns_are_what_most_files_take_them_for(tmp_path):
    rng = np.random.default_rng(5)
    t = np.arange(2000) / 200.0
    steps = np.repeat(rng.uniform(5e-3, 7e-3, 20), 100)
    swept = 6e-3 + 1e-3 * np.sin(2 * np.pi * (0.2 + 0.1 * t) * t)
    for name, wanted in (("a.txt", steps), ("b.txt", steps[::-1]), ("c.txt", swept)):
        gap = np.convolve(wanted, np.full(15, 1 / 15), "same") + 2e-5 * rng.normal(size=t.size)
        gap[:15], gap[-15:] = wanted[:15], wanted[-15:]
        np.savetxt(tmp_path / name, np.column_stack([t, gap, 1.0 + 90 * (gap - wanted), wanted]), fmt="%.6f")
    files = [tmp_path / name for name in ("a.txt", "b.txt", "c.txt")]
    guesses = [guess_recording(file) for file in files]
    assert guesses[2].channels["displacement"].column == "[3]"  # the set point, the smoothest
    taken = like_most(guesses)
    assert taken[:2] == [None, None]
    again = guess_recording(files[2], columns=taken[2])
    assert {name: c.column for name, c in again.channels.items()} == {
        "time": "[0]", "displacement": "[1]", "command": "[2]", "reference": "[3]"
    }  # fmt: skip
    assert "as in a.txt" in again.channels["displacement"].reason


def test_coils_that_are_opposed_in_one_file_are_so_where_noise_hides_it(tmp_path):
    """At rest the first coil alone was taken for the current, as that of a magnet above the rotor."""
    rng = np.random.default_rng(7)
    t = np.arange(2000) / 1000.0
    for name, size in (("hover", 0.0), ("rest", 0.0), ("sweep", 0.3)):
        pull = size * np.sin(2 * np.pi * (1 + 4 * t) * t)
        upper, lower = (1.5 + sign * pull + 1e-3 * rng.normal(size=t.size) for sign in (1, -1))
        pos = 1e-2 * rng.normal(size=t.size) - 20 * pull
        np.savez(tmp_path / f"{name}.npz", t=t, pos_um=pos, i_upper_A=upper, i_lower_A=lower)
    guesses = [guess_recording(tmp_path / f"{name}.npz") for name in ("hover", "rest", "sweep")]
    assert [g.channels["current"].less for g in guesses] == ["", "", "i_lower_A"]
    taken = like_most(guesses)
    assert taken[2] is None
    for name, columns in zip(("hover", "rest"), taken, strict=False):
        again = guess_recording(tmp_path / f"{name}.npz", columns=columns)
        assert again.channels["current"].less == "i_lower_A" and "as in sweep.npz" in again.channels["current"].reason
        assert again.rotor.value == "supported" and "pair of magnets" in again.rotor.reason


def test_a_file_beside_others_in_which_nothing_moves_is_left_out(tmp_path):
    rng = np.random.default_rng(6)
    t = np.arange(500) / 500.0
    np.savez(tmp_path / "run.npz", t=t, y_mm=rng.normal(size=500), i_A=rng.normal(size=500))
    np.savez(tmp_path / "volts.npz", t=t, u_V=rng.normal(size=500))
    guesses = {name: guess_recording(tmp_path / name) for name in ("run.npz", "volts.npz")}
    assert list(without_motion(guesses)) == ["volts.npz"]
    assert not without_motion({"volts.npz": guesses["volts.npz"]})


def test_the_injection_of_the_other_axis_is_found_in_each_file(tmp_path):
    rng = np.random.default_rng(8)
    for own in "xy":
        columns = {f"pos_{axis}": 1e-5 * rng.normal(size=2000) for axis in "xy"}
        columns |= {f"inj_{axis}": 0.1 * rng.normal(size=2000) * (axis == own) for axis in "xy"}
        np.savez(tmp_path / f"{own}.npz", t=np.arange(2000) / 1000.0, **columns)
    guesses = [guess_recording(tmp_path / f"{own}.npz") for own in "xy"]
    assert like_most(guesses) == [None, None]
    assert ["injection_y" in g.channels for g in guesses] == [False, True]


def test_a_rotor_hangs_in_all_files_of_one_current(tmp_path):
    rng = np.random.default_rng(9)
    still = 6e-3 + 1e-5 * rng.normal(size=4000)
    for name, current in (("hover.npz", 1.0 + 0.01 * rng.normal(size=4000)), ("hard.npz", rng.normal(size=4000))):
        np.savez(tmp_path / name, t=np.arange(4000) / 1000.0, pos=still, i=current)
    hover, hard = one_rotor([guess_recording(tmp_path / name) for name in ("hover.npz", "hard.npz")])
    assert hover.rotor.value == hard.rotor.value == "suspended" and "as hover.npz shows it" in hard.rotor.reason
    alone = guess_recording(tmp_path / "hard.npz")
    assert one_rotor([alone])[0].rotor.value == "supported"


def test_a_command_with_unstored_noise_is_asked_for_the_controller_of_another_file(tmp_path):
    rng = np.random.default_rng(10)
    for name, added in (("steps.npz", 0.0), ("noise.npz", 0.1)):
        y = 1e-4 * np.cumsum(rng.normal(size=4000)) / 60
        command = -150.0 * y + added * rng.normal(size=4000)
        np.savez(tmp_path / name, t=np.arange(4000) / 1000.0, pos_m=y, i_cmd_A=command)
    noise, steps = agreed([verified(guess_recording(tmp_path / n), tmp_path) for n in ("noise.npz", "steps.npz")])
    assert steps.gains["kp"] == 150.0 and noise.gains is None
    assert "that of steps.npz" in noise.controller.ask and "kp = 150" in noise.controller.ask


def guessed(file, **gains):
    nothing = Guess("", None, "", 0.0)
    return RecordingGuess(file, (), nothing, nothing, (), nothing, gains, nothing)


def test_other_gains_of_one_controller_keep_its_time_constants():
    first = guessed("a.csv", kp=7500.0, ki=2.4e6, kd=4.932621, td=2.466333e-4, ti=120.0)
    other = guessed("b.csv", kp=9500.0, ki=2.406e6, kd=5.754719, td=2.466320e-4, ti=120.3)
    apart = guessed("c.csv", kp=9500.0, ki=2.4e6, kd=5.75, td=4e-4, ti=120.0)
    _, same, alone = one_controller([first, other, apart])
    assert same.gains["td"] == first.gains["td"] and same.gains["ti"] == 120.0
    for time, gain in (("td", "kd"), ("ti", "ki")):
        assert same.gains[gain] / same.gains[time] == pytest.approx(other.gains[gain] / other.gains[time], rel=1e-6)
    assert alone.gains["td"] == 4e-4 and same.controller.value == same.gains
    assert "td is that of a.csv (what is left is that of 0.000246632 s here), and kd follows" in same.controller.reason
    assert not first.controller.reason and not alone.controller.reason.startswith("td")


def test_a_controller_without_a_filter_keeps_its_derivative():
    (same,) = one_controller([guessed("a.csv", kp=7500.0, ki=0.0, kd=4.9, td=0.0, ti=120.0)])
    assert same.gains["kd"] == 4.9 and same.gains["td"] == 0.0


def test_clocks_that_jitter_about_nearly_the_same_rate_have_one(tmp_path):
    rng = np.random.default_rng(3)

    def clock(name, rate, jitter, samples=2000):
        time = np.cumsum((1 + rng.uniform(-jitter, jitter, samples)) / rate)
        np.savez(tmp_path / name, t=time, pos_mm=rng.normal(size=samples), i=rng.normal(size=samples))
        return guess_recording(tmp_path / name)

    wandering = [clock("a.npz", 46.4, 0.3), clock("b.npz", 46.4, 0.3), clock("c.npz", 46.98, 0.3)]
    assert wandering[2].rate.value != wandering[0].rate.value
    other, steady = clock("d.npz", 52.3, 0.3), clock("e.npz", 47.1, 0.0)
    found = one_clock([*wandering, other, steady])
    assert len({c.value for c in found[:3]}) == 1 and "jitters" in found[2].reason
    assert [c.value for c in found[3:]] == [other.rate.value, steady.rate.value]


def test_files_with_the_same_columns_keep_the_clock_of_each(tmp_path):
    """Of an oscilloscope, whose time base was changed and whose second input was plugged in elsewhere."""
    rng = np.random.default_rng(12)
    for name, step, other in (("a.csv", 1e-4, rng.normal(size=4000)), ("b.csv", 2.5e-4, np.arange(4000) // 500 % 2)):
        moved = np.cumsum(rng.normal(size=4000)) / 60
        rows = "".join(f"{i},{y:.4f},{u:.4f},,\n" for i, (y, u) in enumerate(zip(moved, other, strict=True)))
        head = f"X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-0.1,{step}\n"
        (tmp_path / name).write_text(head + rows)
    guesses = [guess_recording(tmp_path / name) for name in ("a.csv", "b.csv")]
    assert {g.channels.get("reference") is None for g in guesses} == {True, False}
    (changed,) = (columns for columns in like_most(guesses) if columns)
    clocks = {g.file: g.channels["time"].scale for g in guesses}
    assert clocks == {"a.csv": 1e-4, "b.csv": 2.5e-4}
    file = next(g.file for g, columns in zip(guesses, like_most(guesses), strict=True) if columns)
    assert next(c.scale for c in changed if c.channel == "time") == clocks[file]
