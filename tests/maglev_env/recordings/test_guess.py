"""Guesses about columns, rate, excitation and controller, each from made-up signals."""

import h5py
import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from maglev_env.loop.gains import Gains, state_space
from maglev_env.recordings.contents import Contents
from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.columns.columns import guess_columns
from maglev_env.recordings.guess.controller import fit_controller
from maglev_env.recordings.guess.excitation import guess_excitation
from maglev_env.recordings.guess.rate import STATED_RATE, guess_rate, stated_step, time_scale
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.units import header_unit
from maglev_env.recordings.guess.verified import verified
from maglev_env.recordings.guess.words import meaning

RATE = 1000.0
N = 8000
T = np.arange(N) / RATE
RNG = np.random.default_rng(7)
SLOW = lfilter([0.02], [1, -0.98], RNG.standard_normal(N))  # a displacement of no particular kind


@pytest.mark.parametrize(
    ("header", "name", "si", "scale"),
    [
        ("pos [mm]", "pos", "m", 1e-3),
        ("i (A)", "i", "A", 1.0),
        ("gap_um", "gap", "m", 1e-6),
        ("Weg / mm", "Weg", "m", 1e-3),
        ("Strom in mA", "Strom", "A", 1e-3),
        ("F_N", "F", "N", 1.0),
        ("Position in µm", "Position", "m", 1e-6),
        ("Time, s", "Time", "s", 1.0),
        ("speed [rpm]", "speed", "rad/s", np.pi / 30),
        ("distance_m", "distance", "m", 1.0),
        ("setpoint_m", "setpoint", "m", 1.0),
        ("Weg_m", "Weg", "m", 1.0),
        ("time_s", "time", "s", 1.0),
        ("Beschl [m/s²]", "Beschl", "m/s2", 1.0),
        ("a / m/s^2", "a", "m/s2", 1.0),
        ("acc (mg)", "acc", "m/s2", 9.80665e-3),
        ("v in mm/s", "v", "m/s", 1e-3),
    ],
)
def test_units_stand_in_headers_in_many_ways(header, name, si, scale):
    found, unit = header_unit(header)
    assert (found, unit.si, unit.scale) == (name, si, pytest.approx(scale))


UNITS = {
    **{"m": ("m", 1.0), "cm": ("m", 1e-2), "mm": ("m", 1e-3), "um": ("m", 1e-6), "µm": ("m", 1e-6), "nm": ("m", 1e-9)},
    **{"A": ("A", 1.0), "mA": ("A", 1e-3), "uA": ("A", 1e-6), "V": ("V", 1.0), "mV": ("V", 1e-3), "kV": ("V", 1e3)},
    **{"N": ("N", 1.0), "mN": ("N", 1e-3), "kN": ("N", 1e3), "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6)},
}
NAMED = {"m": ("position", "setpoint", "gap"), "A": ("current", "Strom"), "V": ("coil_voltage",), "N": ("force",)}
FORMS = ("{}_{}", "{} {}", "{} [{}]", "{}({})", "{}_[{}]", "{} / {}", "{} in {}", "{}, {}")


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("form", FORMS)
def test_every_unit_counts_in_every_form(unit, form):
    si, scale = UNITS[unit]
    for name in NAMED.get(si, ("time",)):
        found, read = header_unit(form.format(name, unit))
        assert (found, read.si, read.scale) == (name, si, pytest.approx(scale))


@pytest.mark.parametrize("header", ["y_m", "y_s", "x1", "t", "dy_obs", "i_ref", "Weg_s", "current_m", "i_ref_m"])
def test_an_index_is_no_unit(header):
    assert header_unit(header) == (header, None)


NAMES = {
    "time": "t time Zeit tiempo timestamp",
    "displacement": "y x1 pos gap Weg posicion Auslenkung displacement Luftspalt rotorPosition",
    "current": "i current Strom corriente i_coil Iststrom iMeas coil_current",
    "command": "i_ref iref_A command Sollstrom i_soll currentCommand u cmd Stellgröße",
    "reference": "ref yd setpoint Sollwert y_ref r referencia w Consigne",
    "force": "F force Kraft fuerza",
    "injection": "inj dither excitation Anregung i_inj Störgröße",
    "gap_estimate": "y_obs y_hat",
    "velocity": "v dy_obs velocity Geschwindigkeit x_dot_vel",
    None: "c1 column2 Spalte3 x2 foo [4]",
}


@pytest.mark.parametrize(("channel", "name"), [(c, n) for c, names in NAMES.items() for n in names.split()])
def test_names_of_several_languages_and_laboratories(channel, name):
    assert meaning(*header_unit(name)[:1]).channel == channel


@pytest.mark.parametrize(
    ("header", "channel", "axis"),
    [
        ("u_hall_V", "displacement", ""),
        ("Sensor [V]", "displacement", ""),
        ("soll_V", "reference", ""),
        ("U_sens [mV]", "displacement", ""),
        ("Stoer [mA]", "injection", ""),
        ("u [V]", "voltage", ""),
        ("i_hall [A]", "current", ""),
        ("Hall dist [mm]", "displacement", ""),
        ("dist [A]", "injection", ""),
        ("dist_force", "force", ""),
        ("i_ctrl", "command", ""),
        ("Stellstrom", "command", ""),
        ("coil current", "current", ""),
        ("setcurrent_A", "command", ""),
        ("test signal [A]", "injection", ""),
        ("test position [mm]", "displacement", ""),
        ("eccitazione [A]", "injection", ""),
        ("corrente misurata [A]", "current", ""),
        ("corrente desejada (A)", "command", ""),
        ("corrente di comando [A]", "command", ""),
        ("traferro (mm)", "displacement", ""),
        ("actpos [mm]", "displacement", ""),
        ("Codeur (mm)", "displacement", ""),
        ("inj_x [A]", "injection", "x"),
        ("exc_y [N]", "force", "y"),
        ("probe_x", "displacement", "x"),
        ("Vref_um", "reference", ""),
        ("Wref [mm]", "reference", ""),
        ("Vsoll", "reference", ""),
        ("V_um", "displacement", ""),
        ("Beschl [m/s²]", "acceleration", ""),
        ("ch3 [g]", "acceleration", ""),
    ],
)
def test_instruments_disturbances_and_axes(header, channel, axis):
    name, unit = header_unit(header)
    said = meaning(name, unit.si if unit else "")
    assert (said.channel, said.axis) == (channel, axis)


def test_a_unit_settles_what_a_name_leaves_open():
    assert meaning("u", "V").channel == "voltage" and meaning("u", "A").channel == "command"
    assert meaning("ref", "A").channel in ("command", "reference") and meaning("noise", "N").channel == "force"


def columns(**values):
    return {
        c.column: c for c in guess_columns(Contents({n: np.asarray(v, float) for n, v in values.items()}, {}, {}, ()))
    }


@pytest.mark.parametrize(("suffix", "scale"), [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6)])
def test_a_unit_in_the_name_decides_against_the_size_of_the_values(suffix, scale):
    for size in (1e-4, 0.06, 3.0, 500.0):
        guesses = columns(
            **{"time_s": T, f"distance_{suffix}": size * SLOW, f"setpoint_{suffix}": np.repeat([0, size], N // 2)}
        )
        assert {g.channel: g.scale for g in guesses.values()} == {
            "time": 1.0,
            "displacement": scale,
            "reference": scale,
        }
        assert not any("unit" in g.ask for g in guesses.values())


@pytest.mark.parametrize(
    ("step", "numbers", "scale", "asked"),
    [
        (1e-3, {}, 1.0, False),
        (5.0, {}, 1e-3, True),  # 0.2 Hz levitates nothing
        (500.0, {}, 1e-6, True),
        (0.05, {"SampleTime[ms]": 0.05}, 1e-3, False),
        (0.05, {"Sample Interval": 0.05}, 1.0, False),
        (1.0, {"Increment": 2e-4}, 2e-4, False),  # samples are counted
        (1.0, {"Sample Rate [kHz]": 1.0}, 1e-3, False),
    ],
)
def test_the_unit_of_a_time_without_one(step, numbers, scale, asked):
    found = guess_columns(Contents({"t": np.arange(N) * step, "y": SLOW}, numbers, {}, ()))
    assert found[0].channel == "time" and found[0].scale == pytest.approx(scale) and bool(found[0].ask) == asked


def test_columns_without_names_go_by_what_they_do():
    wanted = 5e-3 + 1e-3 * (np.floor(T) % 2)
    command = 0.5 + 40 * (SLOW * 1e-3)
    current = lfilter([0.3], [1, -0.7], command - 0.5) + 0.5
    found = columns(
        **{"[0]": T, "[1]": wanted, "[2]": 5e-3 + SLOW * 1e-4, "[3]": command, "[4]": current, "[5]": T * 0 + 2}
    )
    assert [c.channel for c in found.values()] == ["time", "reference", "displacement", "command", "current", ""]
    assert all(c.ask for c in found.values() if c.channel not in ("time", ""))  # nothing of it is taken silently


def test_a_column_called_time_that_jumps_back_is_none():
    found = columns(t=np.r_[T[: N // 2], T[: N // 2]], y=SLOW)
    assert found["t"].channel == "" and "does not rise" in found["t"].reason


def test_two_of_a_kind_are_asked_for_and_one_is_taken():
    found = columns(t=T, y=SLOW, pos=SLOW + 0.1)
    assert [c.channel for c in found.values()].count("displacement") == 1


def test_x_and_y_are_axes_where_both_are_there():
    found = columns(t=T, pos_x=SLOW, pos_y=SLOW[::-1], i_x=SLOW * 3, i_y=SLOW[::-1] * 3)
    assert {c.channel for c in found.values()} == {"time", "displacement_x", "displacement_y", "current_x", "current_y"}


def test_a_voltage_called_u_is_no_command():
    found = columns(t=T, y=SLOW, i=SLOW, u=10 * RNG.standard_normal(N))
    assert found["u"].channel == "voltage" and found["u"].ask


@pytest.mark.parametrize(("size", "scale"), [(1e-3, 1.0), (2.0, 1e-3), (300.0, 1e-6)])
def test_a_length_without_unit_is_scaled_by_its_size_and_asked_for(size, scale):
    (y,) = columns(y=size * SLOW / np.abs(SLOW).max()).values()
    assert y.scale == scale and "unit" in y.ask


def test_two_axes_without_an_integral_have_one_controller(tmp_path):
    moved = {axis: 1e-5 * np.roll(SLOW, 37 * i) for i, axis in enumerate("xy")}
    commands = {}
    for axis, y in moved.items():
        d = lfilter([1.0, -1.0], [1.0, -0.6], -y)
        commands[f"i_cmd_{axis}"] = -6000.0 * y + 9000.0 * d
    with h5py.File(tmp_path / "xy.hdf5", "w") as file:
        group = file.create_group("acquisition")
        group.attrs["sampling_frequency_hz"] = RATE
        for name, values in ({f"pos_{a}": 1e6 * y for a, y in moved.items()} | commands).items():
            group.create_dataset(name, data=values).attrs["units"] = "um" if name.startswith("pos") else "A"
        for axis, values in (("x", 0.01 * RNG.standard_normal(N)), ("y", np.zeros(N))):
            group.create_dataset(f"inj_{axis}", data=values).attrs["units"] = "A"
            group[f"i_cmd_{axis}"][...] += values
    found = guess_recording(tmp_path / "xy.hdf5")
    assert found.rate.value == RATE and "sampling_frequency_hz" in found.rate.reason
    assert found.gains is not None and found.gains["kp"] == pytest.approx(6000.0, rel=1e-3) and not found.gains["ki"]
    assert found.channels["injection_x"].column == "acquisition.inj_x" and "injection_y" not in found.channels
    assert found.excitation.value == "none" and "injection_x" in found.excitation.reason


@pytest.mark.parametrize("name", ["dt", "dt_s", "meta.dt_sec"])
def test_a_step_with_its_unit_in_the_name_tells_the_rate(name):
    assert guess_rate(None, 1.0, {name: 1e-4}).value == 1e4


def test_rate_from_time_from_a_number_or_unknown():
    jittered = T + RNG.uniform(-2e-5, 2e-5, N)
    found = guess_rate(jittered, 1.0, {})
    assert found.value == pytest.approx(RATE, rel=1e-4) and "jitter" in found.reason
    assert guess_rate(T * 1e3, 1e-3, {}).value == RATE
    assert guess_rate(None, 1.0, {"run.fs": 500.0}).value == 500.0
    assert guess_rate(None, 1.0, {"Capture.SamplingPeriod": 5e-5}).value == 20000.0
    assert guess_rate(None, 1.0, {}).ask and guess_rate(np.arange(100.0), 1.0, {}).value is None


def test_a_multisine_is_found_with_its_lines_under_noise():
    lines = [2, 3, 5, 9, 14, 30]
    wave = sum(np.cos(2 * np.pi * (4 * k * T + k * k / 7)) for k in lines)
    (table,), why = guess_excitation({"injection": wave, "displacement": SLOW}, RATE)
    assert (table["kind"], table["at"], table["fundamental"], table["lines"]) == ("multisine", "current", 4.0, lines)
    assert "250 samples" in why.reason
    (table,), _ = guess_excitation({"force": wave + 0.05 * RNG.standard_normal(N)}, RATE)
    assert table["lines"] == lines and table["at"] == "force"


SIGNALS = {
    "noise": RNG.standard_normal(N),
    "chirp": chirp(T, 1.0, T[-1], 100.0),
    "steps": np.repeat(RNG.uniform(-1, 1, 8), N // 8),
}


@pytest.mark.parametrize("kind", SIGNALS)
def test_what_does_not_repeat_is_said_in_words(kind):
    tables, why = guess_excitation({"reference": SIGNALS[kind], "displacement": SLOW}, RATE)
    assert tables == [{"kind": "recorded", "at": "reference"}] and why.value == kind


def test_the_stated_peak_of_a_square_wave_is_that_of_the_lines_that_are_stated():
    square = np.tile(np.where(np.arange(2000) < 1000, 3e-4, -3e-4), 4)
    square = square + 1e-7 * np.random.default_rng(5).standard_normal(square.size)
    (table,), _ = guess_excitation({"reference": square}, 1000.0)
    t = np.arange(20_000) / 20_000
    lines = sum(4 / np.pi / k * np.sin(2 * np.pi * k * t) for k in table["lines"])
    assert table["amplitude"] == pytest.approx(3e-4 * np.abs(lines).max(), rel=0.01)  # they overshoot by 18 %


@pytest.mark.parametrize(("frequency", "kind"), [(4.0, "multisine"), (2.3, "recorded")])
def test_steps_repeat_only_if_they_do_to_the_sample(frequency, kind):
    rest = np.where(T < 0.1, 0.0, 1e-4)  # before the first step
    square = np.sign(np.sin(2 * np.pi * frequency * T + 1e-6)) * rest
    (table,), _ = guess_excitation({"reference": square, "displacement": SLOW}, RATE)
    assert table["kind"] == kind


def test_one_sine_and_hover():
    (table,), why = guess_excitation({"reference": np.sin(2 * np.pi * 5 * T), "displacement": SLOW}, RATE)
    assert table["lines"] == [1] and table["fundamental"] == 5.0 and "one sine of 5 Hz" in why.reason
    tables, why = guess_excitation({"reference": np.full(N, 3e-3), "displacement": SLOW}, RATE)
    assert tables == [{"kind": "none"}] and why.ask


@pytest.mark.parametrize("frequency", [47.0, 12.5])
def test_a_whirl_that_fits_into_no_whole_samples_is_said_at_its_own_frequency(frequency):
    """Of 47 Hz at 1 kHz three turns are 64 samples, and "15.625 Hz" had been said."""
    noise = 0.02 * np.random.default_rng(0).standard_normal(1200)
    moved = np.sin(2 * np.pi * frequency * np.arange(1200) / 1000) + noise
    _, why = guess_excitation({"displacement": moved}, 1000.0)
    assert f"vibrates at {frequency:g} Hz above all" in why.reason
    _, why = guess_excitation({"displacement": moved}, None)
    assert f"above all every {1000 / frequency:.2g}" in why.reason


GAINS = Gains(8000.0, 2000.0, 5.2, 4e-3, 0.3)


def commanded(error: np.ndarray, rounded: float = 0.0) -> np.ndarray:
    a, b, c, d = state_space(GAINS, 1 / RATE)
    state, out = np.zeros(2), []
    for e in error:
        out.append(c @ state + d * e)
        state = a @ state + b * e
    return np.round(np.array(out) / rounded) * rounded if rounded else np.array(out)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_pid_is_told_from_its_command_to_the_converters_step(sign):
    y, wanted = sign * 1e-4 * SLOW, np.where(T > 4, 1e-5, 0.0)
    fit = fit_controller(y, commanded(sign * (wanted - y), 1e-3) + 0.01, RATE, reference=wanted)
    assert fit.exact and fit.late == 0 and np.sign(fit.gains.kp) == sign
    for name in ("kp", "ki", "kd", "td", "ti"):
        expected = getattr(GAINS, name) * (sign if name[0] == "k" else 1)
        assert getattr(fit.gains, name) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("digits", [5, 7])
def test_a_pid_is_told_from_columns_that_carry_few_digits(digits):
    y = 1e-4 * SLOW
    text = np.array([[float(f"{v:.{digits - 1}e}") for v in column] for column in (y, commanded(-y))])
    assert fit_controller(*text, RATE).exact
    other = commanded(-y) + 1e-3 * 10.0 ** (5 - digits) * np.abs(SLOW)  # what no digit leaves
    assert not fit_controller(text[0], other, RATE).exact


def test_an_injection_that_is_recorded_is_taken_off_and_one_that_is_not_spoils_the_fit():
    y, w = 1e-4 * SLOW, 0.1 * RNG.standard_normal(N)
    command = commanded(-y) + w
    assert fit_controller(y, command, RATE, injection=w).exact
    assert not fit_controller(y, command, RATE).exact
    assert fit_controller(y, np.zeros(N), RATE) is None


def test_a_controller_that_answers_a_sample_late_is_said_to():
    y = 1e-4 * SLOW
    fit = fit_controller(y, np.r_[0.0, commanded(-y)[:-1]], RATE)
    assert fit.exact and fit.late == 1


def test_parts_that_a_controller_has_not_get_no_gains():
    y = 1e-4 * SLOW
    fit = fit_controller(y, np.round(-250 * y, 5), RATE)
    assert fit.exact and (fit.gains.ki, fit.gains.kd) == (0.0, 0.0) and fit.gains.kp == pytest.approx(250.0, rel=1e-3)


def test_a_clamp_is_no_displacement_and_a_sequence_is_an_excitation():
    found = columns(**{
        "CH1 POS [V]": np.sin(np.arange(500.0)), "I_PROBE [V]": np.cos(np.arange(500.0)),
        "PRBS [V]": np.sign(np.sin(0.1 + np.arange(500.0))),
    })  # fmt: skip
    assert found["I_PROBE [V]"].channel == "current" and "A per V" in found["I_PROBE [V]"].ask
    assert found["CH1 POS [V]"].channel == "displacement" and found["PRBS [V]"].channel == "injection"


def test_channels_of_a_tdms_export_have_their_units_and_axes():
    rng = np.random.default_rng(1)
    names = ("Pos_X [um]", "Pos_Y [um]", "Ref_X [um]", "Ref_Y [um]", "Icoil_X [A]", "Speed [rpm]")
    found = {c.label: c for c in columns(**{f"/'AMB'/'{n}'": rng.normal(size=500) for n in names}).values()}
    wanted = ("displacement_x", "displacement_y", "reference_x", "reference_y", "current_x", "speed")
    assert tuple(found[n.partition(" ")[0]].channel for n in names) == wanted
    assert found["Pos_X"].scale == found["Ref_Y"].scale == 1e-6 and not found["Pos_X"].ask


@pytest.mark.parametrize(("spikes", "scale"), [(3, 1.0), (N // 2, 1e-3)])
def test_a_spike_tells_no_unit_of_a_current(spikes, scale):
    current = 1 + 0.1 * SLOW
    current[:spikes] *= 100
    assert columns(t=T, pos_mm=SLOW, i=current)["i"].scale == scale


def test_a_stated_rate_is_called_so_and_stands_before_a_number_of_the_file():
    time, numbers = 1000.0 * T / (T[1] - T[0]), {"fs": 1.0, STATED_RATE: 1000.0}
    scale, why, ask = time_scale(time, {STATED_RATE: 1000.0})
    assert scale == 1e-6 and why.endswith("the stated rate of 1000 Hz") and not ask
    assert stated_step({STATED_RATE: 1000.0} | numbers)[0] == 1e-3


def test_a_column_that_is_called_by_its_unit_alone():
    rng = np.random.default_rng(1)
    found = columns(ms=2.0 * np.arange(500), mm=rng.normal(size=500), mA=rng.normal(size=500))
    assert {c.channel: c.scale for c in found.values()} == {"time": 1e-3, "displacement": 1e-3, "current": 1e-3}


def test_a_signal_of_few_levels_is_the_reference_and_a_flickering_digit_is_none():
    rng = np.random.default_rng(4)
    random_binary = np.repeat(rng.integers(0, 2, 200), 12) * 0.25
    assert shown.steps_in(random_binary) > random_binary.size / 40
    assert shown.steps_in(np.round(0.35 * rng.normal(size=2400))) == 0


def test_missing_samples_do_not_slow_the_clock():
    time = 1e-3 * np.delete(np.arange(5000.0), np.arange(7, 5000, 600))
    guess = guess_rate(time, 1.0, {})
    assert guess.value == 1000.0


def test_both_axes_have_the_controller_that_both_show(tmp_path):
    rng = np.random.default_rng(5)
    x, y = (1e-5 * np.cumsum(rng.normal(size=4000)) for _ in "xy")
    kept = {"t": np.arange(4000) / 1e4, "pos_x_m": x, "pos_y_m": y}
    np.savez(tmp_path / "a.npz", **kept, cmd_x_A=-800.0 * x, cmd_y_A=-800.0 * y)
    found = guess_recording(tmp_path / "a.npz")
    assert found.gains is not None and found.gains["kp"] == pytest.approx(800.0, rel=1e-4)
    np.savez(tmp_path / "b.npz", **kept, cmd_x_A=-800.0 * x, cmd_y_A=-500.0 * y)
    found = guess_recording(tmp_path / "b.npz")
    assert found.gains is None and "kp = 800" in found.controller.reason and "gains.y" in found.controller.ask


def test_the_rate_of_a_jittering_clock_is_the_round_one_that_its_steps_allow():
    rng = np.random.default_rng(6)
    ticks = np.cumsum((1 + 0.06 * rng.normal(size=1500)) / 49.0)
    assert abs((ticks.size - 1) / (ticks[-1] - ticks[0]) / 49.0 - 1) > 2e-4  # the mean step alone says otherwise
    assert guess_rate(ticks, 1.0, {}).value == 49.0
    rounded = np.round(np.arange(1500) / 49.1, 3)  # a good clock whose stamps are rounded to ms
    assert guess_rate(rounded, 1.0, {}).value == pytest.approx(49.1, rel=1e-4)
    coarse = np.round(np.arange(11312) * 0.001768, 3)  # steps of one and two ms: no sample is missing
    assert shown.is_time(coarse) and guess_rate(coarse, 1.0, {}).value == pytest.approx(1 / 0.001768, rel=3e-5)


def test_clocks_of_a_microcontroller_have_their_unit():
    found = columns(millis=np.arange(12345.0, 12345 + N), dist_mm=8 + SLOW, i_A=1 + 0.1 * SLOW)
    assert (found["millis"].channel, found["millis"].scale) == ("time", 1e-3)


def test_units_of_hdf5_attributes_are_read(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, unit in (("pos_x", "um"), ("pos_y", "um"), ("coil_x", "A"), ("coil_y", b"A")):
            file.create_dataset(f"entry/{name}", data=np.sin(np.arange(400.0))).attrs["units"] = unit
    found = guess_recording(tmp_path / "run.h5", rate=1000.0).channels
    assert found["displacement_x"].scale == 1e-6 and not found["displacement_x"].ask
    assert found["current_x"].column == "entry.coil_x"


def test_names_of_hdf5_attributes_are_read(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, called, unit in (
            ("ai0", "ball position", "mm"),
            ("ai1", "set point", "mm"),
            ("ao0", "coil current", "A"),
        ):
            one = file.create_dataset(f"daq/{name}", data=np.sin(np.arange(400.0)))
            one.attrs["long_name"], one.attrs["unit"] = called, unit
    found = guess_recording(tmp_path / "run.h5", rate=1000.0).channels
    named = {name: found[name].column for name in ("displacement", "reference", "current")}
    assert named == {"displacement": "daq.ai0", "reference": "daq.ai1", "current": "daq.ao0"}


def test_what_is_wanted_tells_the_order_of_an_encoders_counts():
    wanted = np.repeat(np.random.default_rng(2).uniform(-0.5, 0.5, 20), N // 20)
    moved = lfilter([0.02], [1, -0.98], 1.6 * wanted)  # a loop without an integrator ends elsewhere
    found = columns(
        **{"Codeur (points)": np.round(-1e3 * moved), "Consigne (mm)": wanted, "courant (A)": 1 + 0.1 * SLOW}
    )
    encoder = found["Codeur (points)"]
    assert encoder.channel == "displacement" and encoder.scale == -1e-6 and encoder.ask == "scale in m per count"
    assert found["Consigne (mm)"].scale == 1e-3


def test_a_peak_in_volts_is_not_stated_as_one_in_metres(tmp_path):
    wanted = 1.5 + 0.05 * np.sin(2 * np.pi * 5 * T)
    table = np.column_stack([T, wanted + 1e-3 * RNG.standard_normal(N), wanted, 1 + 0.1 * wanted])
    for name, unit, stated in (("volts.csv", "V", False), ("mm.csv", "mm", True)):
        header = f"t [s],pos [{unit}],ref [{unit}],i [A]"
        np.savetxt(tmp_path / name, table, fmt="%.6f", delimiter=",", header=header, comments="")
        found = guess_recording(tmp_path / name)
        assert [e["kind"] for e in found.excitations] == ["multisine"]
        assert ["amplitude" in e for e in found.excitations] == [stated]
        assert ("scale in m per V" in found.channels["reference"].ask) != stated


def test_a_column_in_amperes_is_no_displacement_whatever_it_does():
    found = columns(**{"t [s]": T, "foo [mA]": SLOW, "i_ref [A]": 1 + 0.1 * SLOW, "bar": 8 + RNG.standard_normal(N)})
    assert found["bar"].channel == "displacement" and not found["foo [mA]"].channel and found["foo [mA]"].ask


def test_a_wanted_current_beside_a_voltage_that_is_called_an_output_is_the_command():
    i = 1 + 0.1 * SLOW
    found = columns(
        t=T, laser_mm=8 + SLOW, i_sp=i, i_fb=i + 1e-3 * RNG.standard_normal(N), u_pwm=5 * np.roll(SLOW, 40) + 9
    )
    assert {g.column: g.channel for g in found.values()} == {
        "t": "time", "laser_mm": "displacement", "i_sp": "command", "i_fb": "current", "u_pwm": "voltage",
    }  # fmt: skip


def test_a_stated_rate_tells_the_unit_of_a_time_without_one(tmp_path):
    kept = np.flatnonzero(np.random.default_rng(9).random(4000) > 0.004)  # a serial log with samples missing
    wanted = 450 + 100 * SLOW + 3 * RNG.standard_normal(N)
    table = np.column_stack([kept, 10 + SLOW[kept], lfilter([0.5], [1, -0.5], wanted)[kept], wanted[kept]])
    np.savetxt(tmp_path / "LOG.TXT", table, fmt="%.4f", delimiter=",")
    assert guess_recording(tmp_path / "LOG.TXT").rate.value is None
    found = guess_recording(tmp_path / "LOG.TXT", rate=1000.0).channels
    assert found["time"].scale == 1e-3
    assert {found[name].scale for name in ("current", "command")} == {1e-3}  # 450 A are no current of a magnet


NAMES = ("rotor position", "current reference", "coil current", "excitation")


@pytest.mark.parametrize("kind", ["hdf5", "npz", "counts"])
def test_names_beside_a_matrix_and_counts_are_those_of_its_columns(tmp_path, kind):
    moved = 20 * SLOW
    command = 0.5 + 0.01 * moved + 0.1 * RNG.standard_normal(N)
    matrix = np.column_stack([moved, command, lfilter([0.5], [1, -0.5], command), 0.1 * RNG.standard_normal(N)])
    path = tmp_path / ("run.h5" if kind == "hdf5" else "run.npz")
    if kind == "hdf5":
        with h5py.File(path, "w") as file:
            data = file.create_dataset("daq/data", data=matrix)
            data.attrs["channel_names"], data.attrs["units"] = list(NAMES), ["um", "A", "A", "A"]
    elif kind == "npz":
        np.savez(path, data=matrix, columns=[f"{n} [{u}]" for n, u in zip(NAMES, ("um", "A", "A", "A"), strict=True)])
    else:
        names = ("pos_counts", "cmd_counts", "cur_counts", "exc_counts")
        np.savez(path, **{name: np.rint(1e3 * matrix[:, i]) for i, name in enumerate(names)})
    found = guess_recording(path, rate=1000.0).channels
    assert found.keys() == {"displacement", "command", "current", "injection"}
    assert all("per count" in c.ask for c in found.values()) == (kind == "counts")
    assert kind == "counts" or found["displacement"].scale == 1e-6


@pytest.mark.parametrize("fault", ["unread", "clipped"])
def test_readings_that_the_file_lacks_hide_no_controller(tmp_path, fault):
    """The controller read what the file lost: a PID with its derivative on the measurement."""
    wanted = np.repeat(RNG.uniform(-1, 1, 16), N // 16)
    moved = lfilter([0.02], [1, -0.98], wanted) + 1e-3 * RNG.standard_normal(N)
    command = 0.15 * (wanted - moved) - 2e-3 * 1e3 * lfilter([1 / 3], [1, -2 / 3], np.diff(moved, prepend=moved[0]))
    read = moved.copy()
    if fault == "unread":
        read[RNG.integers(50, N, 25)] = np.nan
    else:
        read = np.minimum(read, np.quantile(read, 0.995))
    table = np.column_stack([T, read, wanted, 0.6 + command])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t [s],pos [mm],ref [mm],i_cmd [A]", comments="")
    found = guess_recording(tmp_path / "run.csv")
    assert found.form is not None and found.form["kp"] == pytest.approx(150.0, rel=0.01)


@pytest.mark.parametrize("first", ["i_top", "i_bot"])
def test_currents_of_opposed_coils_are_half_their_difference(first):
    control = 0.2 * np.sin(2 * np.pi * 7 * T) + 0.01 * RNG.standard_normal(N)
    up, down = 1.5 + control, 1.5 - control
    coils = {"i_top": up, "i_bot": down} if first == "i_top" else {"i_top": down, "i_bot": up}
    found = columns(t=T, x_um=20 * SLOW, i_cmd=control, **coils).values()
    by_channel = {c.channel: c for c in found if c.channel}
    other = "i_bot" if first == "i_top" else "i_top"
    assert by_channel["current"].source == {"from": [first, other], "weights": [0.5, -0.5]}
    assert by_channel["current"].values(coils) == pytest.approx(control, abs=1e-12)
    assert "half the sum, 1.5, the bias" in by_channel["current"].reason
    assert not [c for c in found if c.column == other and (c.channel or c.ask)]


def test_two_currents_that_do_not_move_against_each_other_are_no_pair():
    sine = 0.2 * np.sin(2 * np.pi * 7 * T)
    for other in (1.5 + sine, -sine, 1.5 - 0.2 * np.cos(2 * np.pi * 7 * T)):
        assert not any(c.less for c in columns(t=T, x_um=20 * SLOW, i_a=1.5 + sine, i_b=other).values())


def test_which_of_two_opposed_coils_is_the_upper_one_is_asked_where_no_command_tells():
    sine = 0.2 * np.sin(2 * np.pi * 7 * T)
    found = columns(t=T, x_um=20 * SLOW, i_1=1.5 + sine, i_2=1.5 - sine).values()
    (current,) = (c for c in found if c.channel == "current")
    assert current.less and "pulls towards positive" in current.ask


def test_a_pair_whose_currents_carry_a_weight_is_no_single_magnet(tmp_path):
    """The mean of half the difference carries it, and may be of one sign; the bias of the coils is not in it."""
    control = 0.3 + 0.02 * np.sin(2 * np.pi * 7 * T)
    table = np.column_stack([T, 20 * SLOW, 1.5 + control, 1.5 - control])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t [s],x [um],i_up [A],i_low [A]", comments="")
    found = guess_recording(tmp_path / "run.csv")
    assert found.channels["current"].less and found.rotor.value == "supported"
    assert "total" not in verified(found, tmp_path).channels["current"].ask


def test_an_acceleration_that_no_name_tells_is_no_command():
    found = columns(**{"t": T, "gap [mm]": 8 + SLOW, "ch2 [m/s²]": RNG.standard_normal(N), "i [A]": 1.5 - SLOW})
    assert found["ch2 [m/s²]"].channel == "acceleration" and "command" not in {c.channel for c in found.values()}
