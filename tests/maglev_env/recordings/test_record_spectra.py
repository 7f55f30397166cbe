"""Recordings as arrays and their line statistics: axes, directions, holds, and excitations that never repeat."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import signal

from estimation.lines.frequency_response import frequency_response
from estimation.lines.tones import MOST
from maglev_env.loop.gains import Gains, LinearController
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, axis_signals, record_spectra
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

RATE, N = 1000.0, 500
X, Y = Excitation("sphs", "force", 2.0, (1, 3, 7), 2.0, direction=30.0), Excitation("sphs", "current", 2.0, (4, 9), 0.1)
Y = replace(Y, direction=90.0)
PAIR = (Gains(1.0, 0.0, 0.1), LinearController((2.0,), (1.0, -0.5)))


def waves(lines, periods=4):
    """A period of cosines of amplitude line and phase line / 10, repeated."""
    t = 2 * np.pi * np.arange(N) / N
    return np.tile(sum(k * np.cos(k * t + k / 10) for k in lines), periods)


def planar_signals(**changes):
    drives = {
        "displacement_x": (1, 3, 4, 7),
        "displacement_y": (1, 3, 7, 9),
        "force_x": (1, 3, 7),
        "force_y": (1, 3, 7),
    }
    channels = {name: waves(lines) for name, lines in drives.items()} | {"injection_y": waves((4, 9))}
    channels = {**channels, "speed": np.ones(4 * N), **changes.pop("more", {})}
    return RecordedSignals(channels, RATE, (X, Y), gains=PAIR, axes=2, **changes)


def test_an_axis_of_a_recording_has_its_channels_gains_and_share_of_the_excitation():
    both = planar_signals(hold_rate=5000.0)
    x, y = (axis_signals(both, axis) for axis in range(2))
    assert set(x.channels) == {"displacement", "force", "speed"}  # what carries no letter is of both axes
    assert set(y.channels) == {"displacement", "force", "injection", "speed"}
    for name in ("displacement", "force"):
        assert x.channels[name] is both.channels[f"{name}_x"] and y.channels[name] is both.channels[f"{name}_y"]
    assert (x.axes, x.gains, x.hold_rate) == (1, PAIR[0], 5000.0) and y.gains == PAIR[1]
    assert [(e.at, e.lines) for e in x.excitations] == [("force", (1, 3, 7))]
    assert x.excitations[0].amplitude == pytest.approx(np.sqrt(3)) and x.excitations[0].direction == 0
    assert [(e.at, e.lines) for e in y.excitations] == [("force", (1, 3, 7)), ("current", (4, 9))]
    assert y.excitations[0].amplitude == pytest.approx(1.0) and y.excitations[1].amplitude == 0.1
    np.testing.assert_array_equal(x.elsewhere, [4, 9])
    assert y.elsewhere.size == 0
    assert axis_signals(x, 0) is x
    assert axis_signals(replace(both, gains=PAIR[0]), 1).gains == PAIR[0]
    assert axis_signals(replace(both, gains=None), 1).gains is None


def test_lines_reach_as_far_as_anything_is_driven_and_have_their_amplitudes():
    x = record_spectra(axis_signals(planar_signals(), 0))
    np.testing.assert_array_equal(x.all.lines, np.arange(1, 10))  # 9 is driven across the axis
    np.testing.assert_array_equal(x.force.lines, [1, 3, 7])
    np.testing.assert_array_equal(x.force.frequency, [2.0, 6.0, 14.0])
    assert {place: tuple(lines) for place, lines in x.driven.items()} == {
        "force": (1, 3, 7), "current": (), "reference": ()
    }  # fmt: skip
    exact = np.array([k * np.exp(0.1j * k) if k in (1, 3, 4, 7) else 0 for k in range(1, 10)])
    np.testing.assert_allclose(x.all.amplitude("displacement"), exact, atol=1e-12)
    both = record_spectra(planar_signals())
    assert set(both.all.channels) == {"displacement_x", "displacement_y", "force_x", "force_y", "injection_y"}
    np.testing.assert_allclose(both.all.amplitude("injection_y")[[3, 8]], [4 * np.exp(0.4j), 9 * np.exp(0.9j)])


def test_a_transient_and_a_broken_period_are_left_out():
    still = planar_signals()
    noise = np.random.default_rng(0).normal(scale=0.01, size=(2, 6 * N))
    longer = {n: np.resize(v, 5 * N + 77) for n, v in still.channels.items()}
    for axis, name in enumerate(("displacement_x", "displacement_y")):
        longer[name] = longer[name] + noise[axis, : 5 * N + 77]
    start = longer["displacement_y"] + 5 * np.exp(-np.arange(5 * N + 77) / 40)
    quiet = record_spectra(replace(still, channels=longer))
    rung = record_spectra(replace(still, channels=longer | {"displacement_y": start}))
    assert (quiet.transient_periods, quiet.all.periods, quiet.leftover) == (0, 5, 77)
    assert (rung.transient_periods, rung.all.periods, rung.leftover) == (1, 4, 77)  # y rings, x does not
    np.testing.assert_allclose(rung.all.amplitude("displacement_y")[0], np.exp(0.1j), atol=0.01)


def disturbed(periods=8, tones=(), ringing=0.0):
    """x-y signals with white noise, tones (Hz, size) that every channel shows in a measure of its own, and a mode."""
    rng, t = np.random.default_rng(4), np.arange(periods * N) / RATE
    channels = {}
    for i, (name, values) in enumerate(planar_signals().channels.items()):
        own = np.resize(values, t.size) + 0.01 * rng.standard_normal(t.size)
        own = own + sum((i + 1) * size * np.cos(2 * np.pi * f * t + i) for f, size in tones)
        mode = signal.lfilter(*signal.iirpeak(11.0, 20.0, RATE), rng.standard_normal(2 * t.size))[t.size :]
        channels[name] = own + ringing * mode
    return record_spectra(replace(planar_signals(), channels=channels))


def test_a_tone_that_is_no_harmonic_is_taken_out_of_all_channels():
    for off in (0.03, 0.3):
        quiet, found = disturbed(), disturbed(tones=[(2 * (5 + off), 3.0)])
        assert [tone.frequency for tone in found.tones] == pytest.approx([2 * (5 + off)], abs=0.002)
        (note,) = found.notes
        assert note.startswith(f"a tone of {found.tones[0].frequency:.4g} Hz") and note.endswith("was taken out")
        assert found.transient_periods == 0 and quiet.notes == ()
        away = found.all.lines != 5
        np.testing.assert_allclose(found.all.mean[:, away], quiet.all.mean[:, away], atol=2e-3)
        np.testing.assert_allclose(found.all.covariance[..., away], quiet.all.covariance[..., away], atol=1e-6)
        # Of the line beside it the less is known the nearer it is, and the less the more a channel shows of the tone.
        own = np.array([found.all.cross(name, name)[~away][0] for name in found.all.channels])
        scale = np.median(quiet.all.covariance.real[np.arange(5), np.arange(5)])
        if off < 0.1:
            assert own[0] > 10 * scale and own[4] / own[0] == pytest.approx(5**2, rel=0.3)
        else:
            assert ((0.2 * scale < own) & (own < 5 * scale)).all()


def by_clock(ppm, periods=7, other=None):
    """The same signals read by a clock that is fast by some ppm, or the displacement of y by another one."""
    rng, channels = np.random.default_rng(6), {}
    for name in planar_signals().channels:
        lines = {"injection_y": (4, 9), "displacement_x": (1, 3, 4, 7), "displacement_y": (1, 3, 7, 9)}
        fast = other if other is not None and name == "displacement_y" else ppm
        t = 2 * np.pi * np.arange(periods * N) / N * (1 - 1e-6 * fast)
        wave = sum(k * np.cos(k * t + k / 10) for k in lines.get(name, (1, 3, 7)))
        channels[name] = wave + 1e-3 * rng.standard_normal(t.size)
    return record_spectra(replace(planar_signals(), channels=channels))


@pytest.mark.parametrize("ppm", [1000.0, -2000.0])
def test_a_clock_that_is_not_the_excitations_is_named_and_corrected(ppm):
    found = by_clock(ppm)
    way = "fast" if ppm > 0 else "slow"
    (note,) = found.notes
    assert note == (
        f"the recorder's clock is {abs(ppm):.3g} ppm {way} against that of the excitation: the recording was "
        "resampled by the latter"
    )
    # A fast clock lacks the end of the last period: as much is left out at the start, for all channels alike.
    assert found.all.periods == (6 if ppm > 0 else 7) and found.transient_periods == 0
    x, drive = (found.all.amplitude(name) for name in ("displacement_x", "force_x"))
    driven = np.isin(found.all.lines, (1, 3, 7))
    np.testing.assert_allclose((x / drive)[driven], 1.0, atol=2e-3)
    np.testing.assert_allclose(np.abs(x), [k if k in (1, 3, 4, 7) else 0 for k in range(1, 10)], atol=2e-3)
    assert found.all.cross("displacement_x", "displacement_x").max() < 1e-8  # of a line's noise, not of leakage


def test_a_clock_that_hardly_differs_or_is_of_one_channel_alone_is_left_as_it_is():
    assert by_clock(0.0).fast == by_clock(100.0).fast == 0.0
    assert by_clock(1000.0, other=0.0).fast == 0.0
    assert by_clock(1000.0, periods=3).fast == 0.0


def test_what_is_not_a_few_tones_is_left_as_it_is():
    many = [(13.1 + 6.3 * i, 0.5) for i in range(MOST + 3)]  # as of a clock or a gain that drifts
    assert disturbed(tones=many).tones == ()
    assert disturbed(ringing=1.0).tones == ()  # noise through a resonance that is hardly wider than a line
    assert len(disturbed(tones=[(13.1, 0.05), (31.7, 0.05)]).tones) == 2


def test_a_held_force_acts_half_a_sample_late_on_both_axes():
    held = record_spectra(planar_signals(hold_rate=200.0)).force
    plain = record_spectra(planar_signals()).force
    x = np.array([2.0, 6.0, 14.0]) / 200.0
    for name in ("force_x", "force_y"):
        np.testing.assert_allclose(held.amplitude(name), plain.amplitude(name) * np.sinc(x) * np.exp(-1j * np.pi * x))
    np.testing.assert_array_equal(held.amplitude("displacement_y"), plain.amplitude("displacement_y"))


def noisy(seed=0, samples=16_000, direction=30.0, at="force", **changes):
    """White drive along a direction; x and y move by known filters of it."""
    drive = np.random.default_rng(seed).standard_normal(samples)
    name = {"force": "force", "current": "injection", "reference": "reference"}[at]
    e = Excitation("recorded", at, direction=direction, **changes)
    channels = {f"displacement_{a}": signal.lfilter(*f, drive) for a, f in FILTERS.items()}
    return RecordedSignals(
        channels | {f"{name}_{a}": c * drive for a, c in zip("xy", e.components, strict=True)}, RATE, (e,), axes=2
    )


FILTERS = {"x": ([0.2, 0.1], [1.0, -0.7]), "y": ([0.5], [1.0, 0.4])}


def filtered(axis, frequency):
    return signal.freqz(*FILTERS[axis], 2 * np.pi * frequency / RATE)[1]


@pytest.mark.parametrize("direction", [30.0, 120.0, 225.0, -90.0])
def test_the_reference_of_a_recorded_excitation_is_the_drive_along_its_direction(direction):
    """Readings across the direction, as strong as the drive, are no part of it."""
    signals = noisy(direction=direction, band=(5.0, 300.0))
    x, y = signals.excitations[0].components
    across = np.random.default_rng(7).standard_normal(16_000)
    read = {"force_x": signals.channels["force_x"] - y * across, "force_y": signals.channels["force_y"] + x * across}
    found = record_spectra(replace(signals, channels=signals.channels | read))
    drive = x * found.all.amplitude("force_x") + y * found.all.amplitude("force_y")
    assert (drive.real > 0).all() and np.abs(drive.imag / drive.real).max() < 1e-9
    for axis in "xy":
        error = np.abs(found.all.amplitude(f"displacement_{axis}") / drive / filtered(axis, found.all.frequency) - 1)
        assert np.sqrt(np.mean(error**2)) < 1e-4 and error.max() < 1e-3
    np.testing.assert_array_equal(found.force.lines, found.all.lines)
    np.testing.assert_array_equal(found.driven["force"], found.all.lines)
    assert not found.driven["current"].size and (found.transient_periods, found.leftover) == (0, 0)
    assert 5.0 <= found.all.frequency[0] < 7.0 and 298.0 < found.all.frequency[-1] <= 300.0


def test_an_axis_of_a_recorded_excitation_takes_its_own_component_for_the_reference():
    both = noisy(band=(5.0, 300.0))
    for axis, share in ((0, np.cos(np.pi / 6)), (1, 0.5)):
        own = record_spectra(axis_signals(both, axis)).force
        g = frequency_response(own, "displacement", "force")[0]
        assert np.abs(g * share / filtered("xy"[axis], own.frequency) - 1).max() < 1e-3


def test_where_a_recorded_drive_has_power_it_is_used_and_each_place_has_its_channel():
    slow = signal.butter(6, 0.2)  # to 100 Hz, 40 dB down at 215 Hz
    both = noisy(direction=0.0)
    low = {n: signal.lfilter(*slow, v) for n, v in both.channels.items() if n != "force_y"}
    found = record_spectra(replace(both, channels=low | {"force_y": np.zeros(16_000)}))
    assert found.all.frequency[0] < 3.0 and 150.0 < found.all.frequency[-1] < 260.0
    for at, channel in (("current", "injection"), ("reference", "reference")):
        found = record_spectra(noisy(at=at, band=(5.0, 300.0)))
        np.testing.assert_array_equal(found.driven[at], found.all.lines)
        assert not found.force.lines.size
        x, y = (found.all.amplitude(f"displacement_{a}") / filtered(a, found.all.frequency) for a in "xy")
        np.testing.assert_allclose(x, y, rtol=3e-3)
        assert (f"{channel}_x" in found.all.channels) == (at == "current")


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        (lambda: replace(noisy(), excitations=()), ["nothing is excited along this axis"]),
        (lambda: replace(noisy(), excitations=noisy().excitations * 2), ["2 recorded excitations", "exactly one"]),
        (lambda: _without(noisy(), "force_y"), ["needs the channel force_y"]),
        (lambda: _without(axis_signals(noisy(), 0), "force"), ["needs the channel force"]),
        (lambda: noisy(band=(5.0, 600.0)), ["band 5 .. 600 Hz", "0 .. 500 Hz"]),
        (lambda: noisy(band=(5.0, 5.5)), ["the band holds", "one window takes 21", "record longer"]),
        (lambda: noisy(samples=40), ["40 samples are too short"]),
        (lambda: _silent(noisy()), ["the reference is constant"]),
    ],
)  # fmt: skip
def test_what_a_recorded_excitation_lacks_is_said(signals, words):
    with pytest.raises(ValueError) as error:
        record_spectra(signals())
    for word in words:
        assert word in str(error.value)


def _silent(signals):
    return replace(signals, channels=signals.channels | {f"force_{axis}": np.ones(16_000) for axis in "xy"})


def _without(signals, *names):
    return replace(signals, channels={n: v for n, v in signals.channels.items() if n not in names})


def test_an_axis_that_only_the_other_drives_says_so():
    along_x = replace(planar_signals(), excitations=(replace(X, direction=0.0),))
    record_spectra(axis_signals(along_x, 0))
    with pytest.raises(ValueError, match="nothing is excited along this axis"):
        record_spectra(axis_signals(along_x, 1))


def spec(excitations, rate=20_000.0, intersample=None, gains=None):
    return RecordingSpec("a.csv", "fit", rate, 0, None, None, 0.0, gains, tuple(excitations), {}, intersample)


def read(names, excitations, rig="hmb_radial", samples=40_000, **changes):
    rng, s = np.random.default_rng(1), spec(excitations, **changes)
    dataset = xr.Dataset({name: ("time", rng.standard_normal(samples)) for name in names})
    return recorded_signals(Campaign(Path("folder"), rig and load_rig(rig), 1.0, (s,)), s, dataset), dataset


FORCE, INJECTION = Excitation("sphs", "force", 1.0, (1, 2)), Excitation("sphs", "current", 1.0, (3, 4), 0.1)
NOISE = Excitation("recorded")


@pytest.mark.parametrize(
    ("letter", "rig"),
    [("_x", "hmb_radial"), ("_y", "hmb_radial"), ("_x", "hmb_free"), ("_y", None), ("", "hmb_free"), ("", None)],
)
def test_one_axis_may_carry_its_letter(letter, rig):
    found, dataset = read([f"displacement{letter}", f"force{letter}", "speed"], [FORCE], rig, gains=PAIR[0])
    assert found.axes == 1 and set(found.channels) == {"displacement", "force", "speed"}
    np.testing.assert_array_equal(found.channels["force"], dataset[f"force{letter}"])
    assert not record_spectra(found).driven["current"].size and record_spectra(found).force.lines.size == 2


def test_a_rig_of_two_axes_needs_the_letter():
    with pytest.raises(ValueError, match=r"a\.csv: rig hmb_radial has two axes; name the channels displacement_x.*_y"):
        read(["displacement", "force"], [FORCE])


def test_two_displacements_make_two_axes():
    names = ["displacement_x", "displacement_y", "force_x", "force_y"]
    found, _ = read(names, [replace(FORCE, direction=45.0)], gains=PAIR)
    assert found.axes == 2 and set(found.channels) == set(names) and found.gains == PAIR


def test_the_design_of_an_injection_stands_in_for_each_axis_that_lacks_its_channel():
    names = ["displacement_x", "displacement_y", "injection_x"]
    slanted = [replace(INJECTION, direction=30.0), replace(INJECTION, lines=(5,), direction=90.0)]
    found, dataset = read(names, slanted, samples=50_000)
    np.testing.assert_array_equal(found.channels["injection_x"], dataset["injection_x"])
    design = np.sin(np.pi / 6) * slanted[0].waveform(20_000.0) + slanted[1].waveform(20_000.0)
    np.testing.assert_allclose(found.channels["injection_y"], np.resize(design, 50_000), atol=1e-15)
    assert [a for a in found.assumed if "injection_y" in a] and not [a for a in found.assumed if "injection_x" in a]
    along_x, _ = read(names[:2], [INJECTION])
    assert "injection_y" not in along_x.channels


def test_an_injection_against_a_single_axis_stands_in_with_its_sign():
    found, _ = read(["displacement"], [replace(INJECTION, direction=180.0)], "hmb_free")
    np.testing.assert_allclose(found.channels["injection"][:20_000], -INJECTION.waveform(20_000.0), atol=1e-15)


def test_the_injection_across_a_single_axis_does_not_stand_in_for_its_own():
    across = replace(INJECTION, lines=(5,), direction=90.0)
    found, _ = read(["displacement_x"], [INJECTION, across])
    np.testing.assert_allclose(found.channels["injection"][:20_000], INJECTION.waveform(20_000.0), atol=1e-15)


@pytest.mark.parametrize(
    ("rig", "excitation", "rate", "intersample", "hold", "assumed"),
    [
        ("hmb_free", FORCE, 20_000.0, None, 20_000.0, '("zoh")'),
        ("hmb_free", FORCE, 40_000.0, None, 40_000.0, '("zoh")'),  # each held sample is recorded twice
        ("hmb_free", FORCE, 5_000.0, None, 20_000.0, '("zoh")'),
        ("hmb_free", FORCE, 15_000.0, None, None, '("bl")'),
        ("hmb_free", FORCE, 15_000.0, "bl", None, None),
        ("hmb_free", FORCE, 5_000.0, "zoh", 20_000.0, None),
        ("hmb_free", FORCE, 5_000.0, "bl", None, None),
        ("hmb_free", NOISE, 20_000.0, None, None, '("bl")'),
        ("hmb_free", NOISE, 20_000.0, "zoh", 20_000.0, None),
        ("hmb_free", INJECTION, 20_000.0, None, None, None),  # no force is excited
        (None, FORCE, 15_000.0, None, None, '("bl")'),
        (None, FORCE, 15_000.0, "zoh", 15_000.0, None),
    ],
)
def test_how_the_force_behaves_between_samples(rig, excitation, rate, intersample, hold, assumed):
    names = ["displacement", "force", "injection"]
    found, _ = read(names, [excitation], rig, rate=rate, intersample=intersample)
    assert found.hold_rate == hold
    assert (f"taken as {'held' if hold else 'continuous'} {assumed}" in " ".join(found.assumed)) == (
        assumed is not None
    )
    assert len(found.assumed) == (assumed is not None)


def test_a_design_is_made_at_the_control_rate_whatever_the_recording_has():
    fine = INJECTION.waveform(20_000.0)
    for rate, seen in ((40_000.0, np.repeat(fine, 2)), (5_000.0, fine[::4])):
        found, _ = read(["displacement"], [INJECTION], "hmb_free", rate=rate, samples=2 * int(rate))
        np.testing.assert_allclose(found.channels["injection"][: int(rate)], seen, atol=1e-15)


def test_a_held_force_needs_rates_that_fit():
    with pytest.raises(ValueError, match=r"a\.csv: sample_rate = 15000 Hz.*control_rate = 20000.*held force needs"):
        read(["displacement", "force"], [FORCE], "hmb_free", rate=15_000.0, intersample="zoh")
    with pytest.raises(ValueError, match=r"a\.csv: no excitation is stated"):
        read(["displacement", "force"], [Excitation("none")])
