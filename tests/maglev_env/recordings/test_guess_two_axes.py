"""Two axes that a file calls V and W, H and V, hor and ver; their controllers, and a speed that never changes."""

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess.columns.columns import guess_columns
from maglev_env.recordings.guess.controllers import alike
from maglev_env.recordings.guess.recording import guess_recording

RATE, N = 1e4, 4000
T = np.arange(N) / RATE
RNG = np.random.default_rng(11)
SLOW = {axis: 2.0 * lfilter([0.02], [1, -0.98], RNG.standard_normal(N)) for axis in "xy"}
BOTH = {f"{name}_{axis}" for name in ("displacement", "command", "current") for axis in "xy"}


def guessed(names, headers=None):
    """Channels by column, of columns with the values of a rotor in two axes."""
    kinds = [SLOW["x"], SLOW["y"], -0.8 * SLOW["x"], -0.8 * SLOW["y"], -0.7 * SLOW["x"], -0.7 * SLOW["y"]]
    columns = {"t [s]": T} | dict(zip(names, kinds, strict=False))
    return {c.column: c.channel for c in guess_columns(Contents(columns, {}, {}, {}))}


@pytest.mark.parametrize(
    "names",
    [
        ("A_V13 [um]", "A_W13 [um]", "i_V13_set [A]", "i_W13_set [A]", "i_V13 [A]", "i_W13 [A]"),
        ("probe H (µm)", "probe V (µm)", "cmd H (A)", "cmd V (A)", "coil H (A)", "coil V (A)"),
        ("pos_hor_um", "pos_ver_um", "Isoll_hor_A", "Isoll_ver_A", "Iist_hor_A", "Iist_ver_A"),
    ],
)
def test_axes_are_known_by_other_letters(names):
    found = guessed(names)
    assert set(found.values()) == BOTH | {"time"}
    for x, y in zip(names[::2], names[1::2], strict=True):
        assert found[x].removesuffix("_x") == found[y].removesuffix("_y")


def test_a_v_beside_a_w_of_another_unit_is_no_axis():
    found = guessed(("y [mm]", "w [mm]", "v [V]"))
    assert found["y [mm]"] == "displacement" and found["w [mm]"] == "reference" and found["v [V]"] == "voltage"


def test_a_letter_does_not_stand_against_its_unit():
    columns = {"t [s]": T, "v13 [um]": SLOW["x"], "n [rpm]": 10 * np.arange(N), "k": np.arange(N)}
    found = {c.column: c.channel for c in guess_columns(Contents(columns, {}, {}, {}))}
    assert found["v13 [um]"] == "displacement" and found["n [rpm]"] == "speed" and found["k"] == ""


def test_a_speed_that_never_changes_is_that_of_the_recording(tmp_path):
    head = "t [s];pos [um];cmd [A];n [rpm]\n"
    for speed in (6000, 0):
        rows = "".join(f"{t:.4f};{x:.3f};{-0.8 * x:.4f};{speed}\n" for t, x in zip(T, SLOW["x"], strict=True))
        (tmp_path / "run.csv").write_text(head + rows)
        found = guess_recording(tmp_path / "run.csv")
        assert found.speed_rpm == speed and found.table().get("speed_rpm", 0.0) == speed


def test_an_integral_with_a_long_leak_is_told_by_its_slope():
    one = {"kp": 1000.0, "ki": 2e6, "kd": 2.0, "td": 1e-4, "ti": 33.0}
    other = one | {"ki": 7.2e6, "ti": 33.0 * 3.6}
    assert alike(one, other, 1e-3, everything=True)
    assert not alike(one, other | {"kp": 1010.0}, 1e-3, everything=True)
    assert not alike(one, one | {"ki": 0.0}, 1e-3, everything=True) and alike(one, one | {"ki": 0.0}, 1e-3)
