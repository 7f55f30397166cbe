"""A last letter of a header that is a plane, a phase or an axis, and no unit."""

import numpy as np
import pytest

from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess.columns.columns import guess_columns
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
