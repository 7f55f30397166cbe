"""A last letter of a header that is a plane, a phase or an axis, and no unit."""

import numpy as np
import pytest

from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess.columns.columns import guess_columns
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.units import header_unit

N = 4000
T = np.arange(N) / 1000.0
RNG = np.random.default_rng(11)


def guessed(*names):
    """Channels by column of a file whose columns wander about."""
    columns = {"time": T} | {name: 0.4 + 0.05 * RNG.standard_normal(N).cumsum() / np.sqrt(N) for name in names}
    return {c.column: c.channel for c in guess_columns(Contents(columns, {}, {}, ()))}


@pytest.mark.parametrize("header", ["gap_A", "x_A", "Channel A", "x_N", "Channel V"])
def test_a_letter_behind_another_quantity_is_no_unit(header):
    assert header_unit(header) == (header, None)


@pytest.mark.parametrize("header", ["i_A", "cmd_A", "soll_A", "inj_A", "u_V", "pos_V", "F_N", "load_N"])
def test_a_letter_behind_its_own_quantity_is_one(header):
    name, unit = header_unit(header, among=[header, "t_s", "y_m", "u_V", "i_A"])
    assert (name, unit.text) == (header[:-2], header[-1])


@pytest.mark.parametrize(
    ("names", "quantities"),
    [
        (("gap_A", "gap_B", "i_A", "i_B"), {"gap": "displacement", "i": "current"}),  # bearing planes
        (("x_A", "y_A", "x_B", "y_B"), {"x": "displacement_x", "y": "displacement_y"}),
        (("gap", "i_U", "i_V"), {"gap": "displacement", "i": "current"}),  # phases
        (("pos_V", "pos_H", "i_V", "i_H"), {"pos": "displacement", "i": "current"}),  # vertical, horizontal
    ],
)
def test_planes_phases_and_axes_keep_their_quantity(names, quantities):
    channels = guessed(*names)
    for name in names:
        assert channels[name] in ("", quantities[name.partition("_")[0]]), channels
    assert set(quantities.values()) <= set(channels.values())
    assert all(header_unit(name, names)[1] is None for name in names)


def test_channels_a_and_b_are_called_by_no_unit():
    assert guessed("Channel A", "Channel B")["Channel A"] != "current"
    assert header_unit("coil_current A", among=["coil_current B"]) == ("coil_current A", None)


@pytest.mark.parametrize("header", ["Torque [Nm]", "M / Nm", "Moment [NM]", "G [mS]", "B [G]", "Hall (G)", "B [mG]"])
def test_newton_metres_millisiemens_and_gauss_are_no_lengths_times_or_accelerations(header):
    assert header_unit(header) == (header, None)


@pytest.mark.parametrize(
    ("header", "si", "scale"),
    [("POS [NM]", "m", 1e-9), ("TIME_MS", "s", 1e-3), ("acc [G]", "m/s2", 9.80665), ("accel (mG)", "m/s2", 9.80665e-3)],
)
def test_capitals_that_are_units_are_read(header, si, scale):
    _, unit = header_unit(header)
    assert (unit.si, unit.scale) == (si, pytest.approx(scale))


@pytest.mark.parametrize(
    "header",
    ["Drehzahl [U/min]", "Drehzahl U/min", "Drehzahl [min-1]", "n / min^-1", "n (min⁻¹)", "speed in 1/min", "n r/min"],
)
def test_turns_a_minute_are_written_in_many_ways(header):
    name, unit = header_unit(header)
    assert name in ("Drehzahl", "n", "speed") and (unit.si, unit.scale) == ("rad/s", pytest.approx(2 * np.pi / 60))
    assert header_unit("vel mm/s")[0] == "vel"


@pytest.mark.parametrize(
    ("header", "speed", "asked"),
    [
        ("Drehzahl [U/min]", 1200.0, False),
        ("Drehzahl [min-1]", 1200.0, False),
        ("Speed", 0.0, True),
        ("Drehzahl [Umdr.]", 0.0, True),
    ],
)
def test_the_speed_of_a_constant_column_without_a_known_unit_is_asked_for(tmp_path, header, speed, asked):
    rows = "".join(f"{t:.4f};{x:.3f};1200\n" for t, x in zip(T, RNG.standard_normal(N), strict=True))
    (tmp_path / "run.csv").write_text(f"Zeit [s];Weg [µm];{header}\n{rows}")
    found = guess_recording(tmp_path / "run.csv")
    assert found.speed_rpm == pytest.approx(speed) and any("speed_rpm" in g.ask for g in found.guesses) == asked


def test_a_rotor_that_stands_still_does_so_in_any_unit(tmp_path):
    rows = "".join(f"{t:.4f};{x:.3f};0\n" for t, x in zip(T, RNG.standard_normal(N), strict=True))
    (tmp_path / "run.csv").write_text(f"Zeit [s];Weg [µm];Speed\n{rows}")
    assert not any("speed_rpm" in g.ask for g in guess_recording(tmp_path / "run.csv").guesses)


def test_a_channel_of_which_only_the_unit_is_known_is_no_voltage_at_the_coil(tmp_path):
    """An oscilloscope numbers its channels above their units."""
    y = RNG.standard_normal(N).cumsum() / np.sqrt(N)
    lines = "".join(f"{t:.4f},{2.5 + a:.5f},{b:.5f}\n" for t, a, b in zip(T, y, RNG.standard_normal(N), strict=True))
    (tmp_path / "scope.csv").write_text(f"x-axis,1,2\nsecond,Volt,Ampere\n{lines}")
    found = guess_recording(tmp_path / "scope.csv").channels
    assert {channel: c.column for channel, c in found.items()} == {
        "time": "second", "displacement": "Volt", "current": "Ampere"
    }  # fmt: skip
    assert "scale in m per V" in found["displacement"].ask
