"""Excitations: what they drive, in which direction, and how the command line writes them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.multisine.sphs import crest_factor
from maglev_env.rig.excitation import (
    Excitation,
    axis_excitations,
    check_interleaved,
    lines_at,
    parse_excitation,
    parse_lines,
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("force=1:5@0.4", Excitation("sphs", "force", 2.0, (1, 2, 3, 4, 5), 0.4)),
        ("force=1:9:2@0.4@45", Excitation("sphs", "force", 2.0, (1, 3, 5, 7, 9), 0.4, direction=45.0)),
        (" current =2:8:3@1e-1@-90", Excitation("sphs", "current", 2.0, (2, 5, 8), 0.1, direction=-90.0)),
        ("reference=3:3@2e-6", Excitation("sphs", "reference", 2.0, (3,), 2e-6)),
    ],
)
def test_the_command_line_writes_place_lines_peak_and_direction(text, expected):
    assert parse_excitation(text, 2.0) == expected
    assert parse_excitation(text, 2.0, "low_crest").kind == "low_crest"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("force", ["'force'", "place=first:last:step@peak"]),
        ("force=1:5", ["'force=1:5'", "place=first:last:step@peak"]),
        ("force=1:5@1@2@3", ["place=first:last:step@peak"]),
        ("force=1:5@big", ["'big'", "not a number"]),
        ("force=1:5@1@up", ["the direction is not a number"]),
        ("force=1:5@nan", ["amplitude = nan must be a finite number of N"]),
        ("force=1:5@-1", ["amplitude = -1.0 N must be positive"]),
        ("force=1:5@1@inf", ["direction = inf must be a finite number of degrees"]),
        ("voltage=1:5@1", ["at = 'voltage'", "force, current, reference"]),
        ("force=5@1", ["lines '5'", "first:last"]),
        ("force=1:5:0@1", ["lines '1:5:0'"]),
        ("force=1:5:1:1@1", ["lines '1:5:1:1'"]),
        ("force=1.5:3@1", ["lines '1.5:3'", "whole numbers"]),
        ("force=5:1@1", ["no harmonic"]),
        ("force=0:3@1", ["no harmonic from 1 up"]),
        ("force=-3:3@1", ["no harmonic from 1 up"]),
    ],
)
def test_a_bad_excitation_of_the_command_line_says_what_is_wrong(text, words):
    with pytest.raises(ValueError) as error:
        parse_excitation(text, 1.0)
    for word in words:
        assert word in str(error.value)


@settings(max_examples=300, deadline=None)
@given(st.text("forcent=:@1.-+ae x", max_size=24).filter(lambda text: not re.search(r"\d{5}", text)))
def test_any_other_text_is_refused_as_a_value_error(text):
    try:
        found = parse_excitation(text, 1.0)
    except ValueError:
        return
    assert found.lines and found.amplitude > 0 and np.isfinite(found.direction)


def test_a_slip_of_the_pen_takes_no_gigabytes():
    with pytest.raises(ValueError, match="1500000"):
        parse_lines("1:1500000")


@given(st.floats(-1e4, 1e4))
def test_the_direction_shares_a_push_between_the_axes(direction):
    x, y = Excitation("sphs", lines=(1,), direction=direction).components
    assert x**2 + y**2 == pytest.approx(1, abs=1e-12)
    turned = np.array(Excitation("sphs", lines=(1,), direction=direction + 90.0).components)
    np.testing.assert_allclose(turned, [-y, x], atol=1e-11)  # from x toward y


@pytest.mark.parametrize(
    ("direction", "shares"),
    [(0, (1, 0)), (90, (0, 1)), (180, (-1, 0)), (-90, (0, -1)), (450, (0, 1)), (3600, (1, 0))],
)
def test_the_axes_themselves_are_pushed_exactly(direction, shares):
    np.testing.assert_array_equal(Excitation("sphs", lines=(1,), direction=direction).components, shares)


def test_a_direction_in_whole_degrees_beyond_64_bits_is_that_number():
    whole, same = (Excitation("sphs", lines=(1,), direction=number) for number in (10**29, 1e29))
    np.testing.assert_array_equal(whole.components, same.components)


def test_an_axis_has_the_share_that_acts_along_it():
    slanted = Excitation("sphs", "force", 1.0, (1, 2), 2.0, direction=30.0)
    across = Excitation("sphs", "current", 1.0, (3,), 0.1, direction=90.0)
    noise = Excitation("recorded", "force", direction=0.0, band=(1.0, 5.0))
    for axis, share in ((0, np.sqrt(3)), (1, 1.0)):
        own = axis_excitations((slanted, across, noise), axis)
        assert own[0].amplitude == pytest.approx(share) and own[0].direction == 0 and own[0].lines == (1, 2)
        assert [e.at for e in own[1:]] == (["force"] if axis == 0 else ["current"])
    assert axis_excitations((slanted, across, noise), 0)[1].band == (1.0, 5.0)
    assert axis_excitations((), 1) == ()
    back = axis_excitations((replace(slanted, direction=120.0),), 0)[0]  # against x
    assert back.amplitude == pytest.approx(1.0) and back.components[0] == -1 and not back.components[1]


def test_lines_are_those_of_periodic_excitations():
    mixed = (
        Excitation("low_crest", "force", 1.0, (1, 5)),
        Excitation("multisine", "current", 1.0, (2,)),
        Excitation("recorded", "force"),
        Excitation("none"),
    )
    np.testing.assert_array_equal(lines_at(mixed), [1, 2, 5])
    np.testing.assert_array_equal(lines_at(mixed, "force"), [1, 5])
    assert lines_at(mixed, "reference").size == 0 and lines_at(mixed[2:]).size == 0
    assert [e.periodic for e in mixed] == [True, True, False, False]
    check_interleaved(mixed)


def test_a_line_has_one_direction_only():
    x, y = Excitation("sphs", lines=(1, 3)), Excitation("sphs", lines=(2, 3), direction=90.0)
    with pytest.raises(ValueError, match="line 3 is excited"):
        check_interleaved((x, y))


def test_low_crest_has_more_rms_for_its_peak_and_its_seed_decides():
    lines = tuple(range(1, 61))
    waves = {
        (kind, seed): Excitation(kind, "force", 1.0, lines, 2.0, seed).waveform(1000.0)
        for kind, seed in (("sphs", 0), ("low_crest", 0), ("low_crest", 1))
    }
    for wave in waves.values():
        assert wave.shape == (1000,) and np.abs(wave).max() == pytest.approx(2.0)
    assert crest_factor(waves["low_crest", 0]) < 1.45 < 1.6 < crest_factor(waves["sphs", 0])
    again = Excitation("low_crest", "force", 1.0, lines, 4.0, 0).waveform(1000.0)
    np.testing.assert_allclose(again, 2 * waves["low_crest", 0])
    assert np.abs(waves["low_crest", 0] - waves["low_crest", 1]).max() > 0.1
    spectrum = np.abs(np.fft.rfft(waves["low_crest", 1])) / 500
    np.testing.assert_allclose(spectrum[1:61], spectrum[1], rtol=1e-9)
    assert spectrum[61:].max() < 1e-12 and spectrum[0] < 1e-12


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: Excitation("recorded", band=(0, 5)), ["band = (0, 5) Hz", "two increasing frequencies"]),
        (lambda: Excitation("recorded", band=(-2, 5)), ["band = (-2, 5) Hz"]),
        (lambda: Excitation("recorded", band=(5, 5)), ["band = (5, 5) Hz"]),
        (lambda: Excitation("sphs", lines=(1,), band=(1, 5)), ["band", "of a recorded one"]),
        (lambda: Excitation("none", band=(1, 5)), ["band", "of a recorded one"]),
        (lambda: Excitation("sphs", lines=(1,), direction=float("nan")), ["direction = nan", "degrees"]),
        (lambda: Excitation("recorded", "voltage"), ["at = 'voltage'"]),
        (lambda: Excitation("noise"), ["kind = 'noise'", "low_crest", "recorded"]),
        (lambda: Excitation("low_crest", lines=(600,)).waveform(1000.0), ["line 600 (600 Hz)", "half of 1000"]),
    ],
)
def test_what_cannot_be_is_refused(made, words):
    with pytest.raises(ValueError) as error:
        made()
    for word in words:
        assert word in str(error.value)
