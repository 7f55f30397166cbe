"""The corrected rig: written, read back, and the same experiment as the diagnosis fitted."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.recordings.campaign import Campaign
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.compared.point import Point, experiment_at
from sim2real.corrected import corrected_toml, write_corrected
from sim2real.gap.locate import Where
from sim2real.gap.shrink import Gap, Words
from sim2real.judgement.judge import Entry
from sim2real.judgement.tones.tone_sizes import ToneSize
from sim2real.report import percent, quantity, sentence
from sim2real.result import Diagnosis

FREE = load_rig("hmb_free")
NAMED = Point({**effect("eddy_current", 1.4e3), **effect("friction", 0.03)}, {})
CALIBRATED = Point(
    effect("delay", 7.5e-5),
    {"mass": 0.004, "actuator_gain": -0.03, "negative_stiffness": 0.1, "probe_gain": 0.01,
     "amplifier_time_constant": -0.08},
)  # fmt: skip
NO_WORDS = Words(np.nan, np.nan, np.nan)


def diagnosis(corrected, rig=FREE, folder="my-rig", verdict="explained", cause=("delay",), which=None, before=6.0):
    """A diagnosis with nothing in it but what it found."""
    which = which or (Entry(cause or ("none",), 0.93, 0.0, None, None), Entry(("unknown",), 0.07, 9.0, None, None))
    words = dict.fromkeys(("measured", "before", "after"), NO_WORDS)
    gap = Gap(before, 2.0, 1.1, 1.0, 0.98, (0.9, 1.0), "holdout", words, {})
    blocks = {"controller+amplifier": 0.9, "mechanics+sensor": 0.1}
    where = Where(blocks, ((63.0, 80.0, 1.0),), {"linear": 1.0}, True, None)
    campaign = Campaign(Path(folder), rig, rig.mass, ())
    return Diagnosis(verdict, cause, where, which, (), None, gap, corrected, campaign, None, None, None, 1.0, ())


@pytest.mark.parametrize(
    ("name", "point"),
    [
        *((name, point) for name in ("hmb_free", "hmb_radial", "eframe") for point in (NAMED, CALIBRATED)),
        ("hmb_axial", Point(effect("damping", 0.5), {"mass": 0.01})),
        ("hmb_free", Point({}, {})),
    ],
)
def test_the_file_gives_the_experiment_that_was_fitted(tmp_path, name, point):
    rig = load_rig(name)
    write_corrected(diagnosis(point, rig), tmp_path / "corrected.toml")
    loaded = load_rig(tmp_path / "corrected.toml")
    assert loaded.name == f"{name}-corrected" and loaded.gains == rig.gains and loaded.protocol == rig.protocol
    fitted, read = experiment_at(protocol_experiment(rig), point), protocol_experiment(loaded)
    f = np.geomspace(4.0, 2000.0, 30)
    np.testing.assert_array_equal(closed_loop_poles(read), closed_loop_poles(fitted))
    own, nominal = loop_response(read, f).receptance, loop_response(protocol_experiment(rig), f).receptance
    np.testing.assert_array_equal(own, loop_response(fitted, f).receptance)
    assert (abs(own - nominal).max() > 1e-3 * abs(nominal).max()) == bool(point.effects)


@pytest.mark.slow
def test_it_simulates_as_it_was_fitted():
    point = Point({**effect("friction", 0.03), **effect("delay", 2e-5)}, {"mass": 0.01, "probe_gain": -0.02})
    read = rig_from_toml(corrected_toml(diagnosis(point)), "here")

    def short(e):
        parts = tuple(replace(x, fundamental=4.0, lines=tuple(n for n in x.lines if n < 200)) for x in e.excitations)
        return replace(e, excitations=parts, periods=1, transient_periods=0)

    nominal = short(protocol_experiment(FREE))
    found = simulate_records([short(protocol_experiment(read)), experiment_at(nominal, point), nominal])
    np.testing.assert_array_equal(found[0], found[1])
    assert abs(found[0, 0] - found[2, 0]).max() > 1e-7


def test_changes_within_tolerance_are_effects_where_there_is_one_and_parameters_else():
    read = rig_from_toml(corrected_toml(diagnosis(CALIBRATED)), "here")
    assert read.amplifier_time_constant == pytest.approx(0.92 * FREE.amplifier_time_constant, rel=1e-12)
    assert read.mass == FREE.mass and read.effects["mass"] == {"change": 0.004}
    assert read.probe_gain == FREE.probe_gain and read.effects["sensor_gain"] == {"change": 0.01}
    assert set(read.effects) == {"delay", "mass", "actuator_gain", "negative_stiffness", "sensor_gain"}


def test_a_named_effect_is_not_changed_by_the_tolerance_of_its_parameter():
    point = Point(effect("mass", 0.2), {"mass": 0.01})
    assert rig_from_toml(corrected_toml(diagnosis(point)), "here").effects == effect("mass", 0.2)


def test_effects_of_the_nominal_rig_stay():
    rig = replace(FREE, effects={**effect("delay", 2e-5), **effect("friction", 0.01)})
    read = rig_from_toml(corrected_toml(diagnosis(Point(effect("delay", 5e-5), {}), rig)), "here")
    assert read.effects == {**effect("delay", 5e-5), **effect("friction", 0.01)}


def test_the_comment_says_where_it_comes_from():
    text = corrected_toml(diagnosis(CALIBRATED, folder="my\nname = 'other'"))
    head = text[: text.index("schema")].splitlines()
    assert all(line.startswith("# ") for line in head) and "my name = 'other'" in head[0]
    assert "explained by delay (93 %), in the controller; time 75 µs" in head[1]
    assert "6 before, 1.1 after" in head[2] and "holdout" in head[2]
    assert "# delay.time = 7.5e-05 s" in head and "# mass = 0.004" in head
    assert "no levitation before" in corrected_toml(diagnosis(CALIBRATED, before=None))


def test_a_campaigns_parameters_are_in_it():
    read = rig_from_toml(corrected_toml(diagnosis(Point({}, {}), with_parameters(FREE, {"mass": 0.09}))), "here")
    assert replace(read, name="hmb_free", mass=FREE.mass) == FREE and read.mass == 0.09
    assert closed_loop_poles(Experiment(read, read.gains, ())).size  # stands on its own


@pytest.mark.parametrize(
    ("value", "se", "unit", "relative", "said"),
    [
        (7.531e-5, 8.57e-7, "s", False, "75.31 +- 0.86 µs"),
        (1400.0, 98.0, "Hz", False, "1.400 +- 0.098 kHz"),
        (1400.0, None, "Hz", False, "1.4 kHz"),
        (0.0312, 0.0041, "", True, "+3.12 +- 0.41 %"),
        (-0.2, 0.0, "", True, "-20 %"),
        (0.98, 0.029, "", False, "0.980 +- 0.029"),
        (2e-6, 7e-5, "s", False, "2 +- 70 µs"),
        (3.4e-8, 2e-9, "kg m", False, "0.0340 +- 0.0020 g mm"),
        (0.2066, 3e-14, "m/s", False, "207 mm/s"),
        (np.inf, None, "T", False, "inf T"),
        (0.0, 1e-6, "s", False, "0.0 +- 1.0 µs"),
    ],
)
def test_quantities_are_readable(value, se, unit, relative, said):
    assert quantity(value, se, unit, relative) == said


def test_shares_are_readable():
    assert [percent(p) for p in (1.0, 0.9999, 0.93, 0.001, 0.0)] == ["100 %", "> 99 %", "93 %", "< 1 %", "0 %"]


def entry(name, probability):
    return Entry(tuple(name.split("+")), probability, 0.0, None, None)


def test_every_verdict_has_its_sentence():
    none = diagnosis(Point({}, {}), verdict="no_gap", cause=(), which=(entry("none", 0.7), entry("calibration", 0.25)))
    assert sentence(none) == "There is no gap beyond the noise and the rig's stated tolerances (95 %)."
    doubted = replace(none, which=(entry("calibration", 0.4), entry("delay", 0.35), entry("unknown", 0.2)))
    assert "tolerances (40 %; not excluded: delay 35 %, an unknown effect 20 %)." in sentence(doubted)
    said = sentence(replace(none, loud={"chirp.csv": 2.66}))
    assert "; but what passes for noise is 2.7 times as loud as the noise that the rig states, and no rec" in said
    leaning = replace(none, off_balance="the mean command is 0.09 A below what carries the weight")
    assert sentence(leaning).endswith(
        "(95 %) in the motion; but the mean command is 0.09 A below what carries the weight."
    )
    far = diagnosis(Point({}, {"actuator_gain": 0.2}), verdict="no_gap", cause=(), which=none.which)
    assert sentence(far) == (
        "No effect is needed (95 %), but the rig is not as stated: actuator_gain +20 %, 4 tolerances off."
    )
    unknown = diagnosis(Point({}, {}), verdict="unexplained", cause=("unknown",), which=(entry("unknown", 0.8),))
    assert sentence(unknown) == (
        "No known effect explains the gap (unknown: 80 %); most of it lies in the controller and the amplifier, around "
        "63 .. 80 Hz."
    )
    for surely, said in ((0.95, True), (0.5, False)):  # a wrong data sheet beside a little of something else
        wrong = replace(unknown, corrected=far.corrected, gap=replace(far.gap, closed_fraction_ci=(surely, 1.0)))
        told = (
            "; but the same rig with other parameters closes 98 % of the gap, so first check actuator_gain +20 %, 4 tol"
        )
        assert (told in sentence(wrong)) == said
        taken_up = "; to take up what has no name the fit moved actuator_gain +20 %, 4 tolerances off, which are no"
        assert (taken_up in sentence(wrong)) == (not said)
    which = (entry("delay", 0.5), entry("amplifier_lag", 0.3), entry("eddy_current", 0.15), entry("mass", 0.05))
    alike = diagnosis(NAMED, verdict="ambiguous", cause=("delay", "amplifier_lag", "eddy_current"), which=which)
    assert sentence(alike) == (
        "The gap is explained by delay (50 %), amplifier_lag (30 %) or eddy_current (15 %), in the controller, the "
        "amplifier or the actuator; this campaign cannot tell them apart."
    )
    lagging = diagnosis(Point(effect("delay", 2e-5), {"actuator_gain": 0.2}), cause=("delay",))
    assert sentence(lagging).endswith("; besides, the rig is not as stated: actuator_gain +20 %, 4 tolerances off.")
    off = {"actuator_gain": 0.2, "amplifier_time_constant": 0.6}
    rig = replace(FREE, tolerance={**FREE.tolerance, "amplifier_time_constant": 0.1})
    lag = diagnosis(Point(effect("amplifier_lag", 2e-5), off), rig, cause=("amplifier_lag",))
    assert "amplifier_time_constant" not in sentence(lag) and "actuator_gain +20 %, 4 tolerances off" in sentence(lag)
    other = replace(lag, cause=("delay",), corrected=Point(effect("delay", 2e-5), off))
    assert "amplifier_time_constant +60 %, 6 tolerances off" in sentence(other)
    pair = diagnosis(Point({**effect("delay", 2e-5), **effect("unbalance", 3e-8)}, {}), cause=("delay", "unbalance"))
    assert sentence(pair).startswith(
        "The gap is explained by delay with unbalance (93 %), in the controller and what turns with the rotor or acts "
        "from outside; delay time 20 µs, unbalance moment 0.03 g mm; it closes"  # no phase, which nothing tells
    )


def test_tones_are_said_as_they_were_heard_and_what_has_no_parameters_leaves_no_gap_in_the_sentence():
    point = Point({**effect("sensor_lag", 2.5e-5), **effect("pickup", 6e-7)}, {})
    found = diagnosis(point, cause=("sensor_lag+pickup",), which=(entry("sensor_lag+pickup", 0.93),))
    heard = replace(found, tones={"pickup": (ToneSize(1, 50.03, 6e-7, 5e-9), ToneSize(3, 150.09, 2.5e-7, 4e-9))})
    tones = "pickup 600.0 +- 9.8 nm at 50.03 Hz and 250.0 +- 7.8 nm at 150.1 Hz (95 %)"
    assert f"in the sensor; sensor_lag time constant 25 µs; {tones}; it closes" in sentence(heard)
    assert heard.to_json()["tones"]["pickup"][1] == {"harmonic": 3, "frequency": 150.09, "value": 2.5e-7, "se": 4e-9}
    none = diagnosis(Point({"dropped_samples": {"probability": 0.0}}, {}), cause=("dropped_samples",))
    assert "in the controller; it closes" in sentence(none)


def test_what_a_free_correction_closes_is_no_merit_of_what_is_named():
    found = diagnosis(CALIBRATED)
    alone = replace(found.gap, after=3.0, closed_fraction=0.6, closed_fraction_ci=(0.5, 0.7))
    beside = replace(found, gap_of_named=alone)
    assert "; it closes 98 % of the gap (95 %: 90 .. 100)" in sentence(found)
    assert "; it closes 60 % of the gap (95 %: 50 .. 70)" in sentence(beside)
    told = beside.to_json()["gap"]
    assert (told["closed_fraction"], told["closed_fraction_ci"]) == (0.6, [0.5, 0.7])
    assert (told["corrected_closed_fraction"], told["corrected_closed_fraction_ci"]) == (0.98, [0.9, 1.0])
    assert (told["before"], told["after"]) == (6.0, 1.1)  # of the corrected rig
    plain = found.to_json()["gap"]
    assert plain["closed_fraction"] == plain["corrected_closed_fraction"] == 0.98


def test_what_calibration_closes_is_no_merit_of_a_tone():
    """A tone lies beside what is compared: its candidate is that of calibration."""
    which = (Entry(("pickup",), 0.9, 0.0, 0, None), Entry(("delay", "pickup"), 0.1, 9.0, 1, None))
    tone = replace(
        diagnosis(Point(effect("pickup", 1e-7), {"mass": 0.004}), cause=("pickup",), which=which),
        attribution=SimpleNamespace(candidates=[SimpleNamespace(effects=()), SimpleNamespace(effects=("delay",))]),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim2real.report.corrections", lambda diagnosis: ())
        assert "; beside it, calibration closes 98 % of the gap (95 %: 90 .. 100)" in sentence(tone)
        both = replace(tone, cause=("delay", "pickup"), which=which[1:])
        assert "; it closes 98 % of the gap" in sentence(both)
