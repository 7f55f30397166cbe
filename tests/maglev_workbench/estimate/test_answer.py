"""The first sentence of `maglev estimate`, on identifications written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from test_estimate_report import band, identification

from estimation.actuator import ActuatorEstimate
from estimation.lines.frequency_response import Distortion
from estimation.normal import NORMAL_95
from maglev_workbench.commands.estimate.answer import estimate_answer, over_bands, trusted
from maglev_workbench.commands.estimate.pooled_report import pooled_sections
from sim2real.coefficients import Coefficient
from sim2real.pooled import Pooled
from sim2real.recorded.at_rest.static_evidence import AT_REST
from sim2real.words import AT_BOUND

SOFT = tuple(
    band(f, stiffness=2.5, stiffness_ci=(2.4, 2.6), damping=0.003, damping_ci=(0.0029, 0.0031)) for f in (1.0, 16.0)
)


def test_without_a_fit_of_the_rig_a_response_is_a_first_look():
    text = estimate_answer([("run1.npz", identification(bands=SOFT))], None, True)
    assert text.endswith("take them for a first look.")


def test_the_sentence_has_values_intervals_and_the_trusted_band():
    text = estimate_answer([("run1.npz", identification(bands=SOFT))], None)
    assert text == (
        "run1.npz: stiffness 2.500 ±0.071 N/m, damping 3.000 ±0.071 mN s/m (95 %), trusted from 1 to 31 Hz."
    )


@pytest.mark.parametrize("told", [False, True])
def test_where_the_current_stands_for_the_force_the_motion_counts_unless_detection_lines_tell(told):
    magnets = ActuatorEstimate(80.0, -3e5, 0.0, 0.5, 1e3, 0.1, 1.0, 0.0)
    shown = Distortion(None, 0.01, None, 0.2, 0.003) if told else Distortion(None, None, None, None, None)
    text = estimate_answer([("a", identification(bands=SOFT, actuator=magnets, distortion=shown))], None)
    assert ("linear response at this motion" in text) == (not told)


def test_a_coefficient_that_varies_has_its_range():
    rising = (band(1.0), band(16.0, stiffness=4e4, stiffness_ci=(3.99e4, 4.01e4)))
    text = estimate_answer([("run1.npz", identification(bands=rising))], None)
    assert "damping 30.00 ±0.71 N s/m (95 %), stiffness varying from 30.0 to 40.0 kN/m, trusted" in text
    both = (rising[0], replace(rising[1], damping=50.0, damping_ci=(49.0, 51.0)))
    assert "%" not in estimate_answer([("run1.npz", identification(bands=both))], None)
    magnets = ActuatorEstimate(0.93, -50.0, 0.0, 0.01, 1.0, 0.1, 1.0, 0.0)
    text = estimate_answer([("run1.npz", identification(bands=both, actuator=magnets))], None)
    assert "actuator gain 0.930 ±0.020 N/A (95 %), stiffness varying" in text and "N s/m without the controller" in text


def test_overlapping_and_unbounded_bands_do_not_count():
    wide = band(31.0, informative=False, stiffness_ci=(-np.inf, np.inf))
    assert [b.f_lo for b in trusted((band(1.0), band(4.0), band(16.0), wide))] == [1.0, 16.0]
    found = over_bands([band(1.0)], "stiffness")
    assert found.interval == (2.99e4, 3.01e4) and not found.varies


def test_bands_in_which_noise_rules_do_not_make_the_stiffness_vary():
    lost = band(400.0, stiffness=2.8e7, stiffness_ci=(2.58e7, 4.24e7))
    text = estimate_answer([("tap.lvm", identification(bands=(band(1.0), band(16.0), lost)))], None)
    assert "stiffness 30.00" in text and "varying" not in text and "trusted from 1 to 31 Hz" in text


def test_many_bands_cover_as_stated():
    """The interval of the mean of 8 bands with their own noise, over 2000 draws."""
    rng, inside = np.random.default_rng(0), 0
    for _ in range(2000):
        values = 3e4 + 50 * rng.standard_normal(8)
        bands = [band(15.0 * i, stiffness=v, stiffness_ci=(v - 98, v + 98)) for i, v in enumerate(values)]
        low, high = over_bands(bands, "stiffness").interval
        inside += low <= 3e4 <= high
    assert 0.93 < inside / 2000 < 0.99  # the scatter only widens it


def test_what_bands_have_in_common_does_not_average_out():
    """As above with an error of the gain, and one of the mass that moves the upper bands most, over 2000 draws."""
    rng, inside, mean = np.random.default_rng(1), 0, []
    moves = np.stack([np.full(8, 150.0), 10.0 * np.arange(8.0) ** 2], axis=1)
    half = NORMAL_95 * np.sqrt(50.0**2 + np.sum(moves**2, axis=1))
    for _ in range(2000):
        values = 3e4 + 50 * rng.standard_normal(8) + moves @ rng.standard_normal(2)
        bands = [
            band(15.0 * i, stiffness=v, stiffness_ci=(v - h, v + h), common=tuple((m, 0.0) for m in moved))
            for i, (v, h, moved) in enumerate(zip(values, half, moves, strict=True))
        ]
        found = over_bands(bands, "stiffness")
        assert not found.varies
        low, high = found.interval
        inside += low <= 3e4 <= high
        mean.append(found.value)
    assert 0.93 < inside / 2000 < 0.97
    assert (high - low) / 2 == pytest.approx(NORMAL_95 * np.std(mean), rel=0.1)


def test_the_best_of_several_recordings_answers_and_the_actuator_is_said():
    none = identification(bands=(band(1.0, informative=False),))
    gain = ActuatorEstimate(0.93, -50.0, 0.0, 0.01, 1.0, 0.1, 1.0, 0.0)
    text = estimate_answer([("a", none), ("b", identification(bands=SOFT, actuator=gain))], None)
    assert text.startswith("b, which bounds most of 2 recordings: ") and "actuator gain 0.930 ±0.020 N/A" in text
    assert "without the controller" in text
    assert "no band bounds stiffness and damping; `maglev check`" in estimate_answer([("a", none)], None)


def test_a_gain_that_is_poorly_known_hides_no_second_body():
    """The error of the gain widens every band, and moves all of them together."""
    middle, mass, share = np.arange(20.0, 380.0, 36.0), 6.25, 0.035
    w, w2, loss = 2 * np.pi * middle, 2 * np.pi * 100, 0.004
    moved = w2**2 * (1 + 2j * loss * w / w2) / (w2**2 - w**2 + 2j * loss * w * w2)
    stiffness = -7.7e5 + 1.25 * w**2 - (1.25 * w**2 * moved).real
    common = share * (stiffness - mass * w**2)
    error = np.hypot(5e3, common)
    bands = tuple(
        band(f - 18, f_hi=f + 18, stiffness=k, stiffness_se=e, stiffness_ci=(k - 2 * e, k + 2 * e), common=((g, 0.0),))
        for f, k, e, g in zip(middle, stiffness, error, common, strict=True)
    )
    gain = ActuatorEstimate(192.0, -7.7e5, 0.0, share * 192, 1.0, 0.1, 1.0, 0.0)
    text = estimate_answer([("run.mat", identification(bands=bands, mass=mass, actuator=gain))], None)
    assert "as where a second body resonates" in text
    loose = Coefficient("delay", "s", 1e-5, 1.0, 0.0, False)
    for misfit in (1.0, 1700.0):
        of_all = estimate_answer([("run.mat", identification(bands=bands, mass=mass, actuator=gain))],
                                 Pooled((loose,), misfit, {}, {}))  # fmt: skip
        assert ("bound no coefficient; from" in of_all and "a second body resonates" in of_all) == (misfit > 2)


def test_all_recordings_together_answer_where_the_rig_was_fitted():
    gain = Coefficient("actuator_gain", "N/A", 5.6, 0.05, 5.7, True)
    loose = replace(gain, name="delay", unit="s", value=1e-5, se=1.0, bounded=False)
    found = Pooled((gain, loose), 1.0, {}, {})
    assert estimate_answer([], found) == (
        "The rig in all recordings: actuator gain 5.600 ±0.098 N/A (95 %); not bounded: delay."
    )
    assert estimate_answer([], replace(found, disagreements={"actuator_gain": ("x",)})).endswith(
        "the recordings disagree about the actuator gain."
    )
    assert "bound no coefficient" in estimate_answer([], replace(found, coefficients=(loose,)))
    ended = replace(loose, name="damping", bounded=True, at_limit=True)
    assert estimate_answer([], replace(found, coefficients=(gain, ended))).endswith(f"; {AT_BOUND}: damping.")
    ((_, html),) = pooled_sections(found)
    assert "actuator gain, N/A" in html and "not bounded" in html


def test_the_value_at_rest_stands_beside_that_in_motion():
    moving, still = (Coefficient("actuator_gain", "N/A", v, 0.02, 0.84, True) for v in (0.6, 0.94))
    found = Pooled((moving,), 1.0, {}, {AT_REST: (still,)})
    assert estimate_answer([], found) == (
        "At rest, by means and weight: actuator gain 0.940 ±0.039 N/A (95 %); in motion, all recordings together: "
        "actuator gain 0.600 ±0.039 N/A (95 %)."
    )
    apart = replace(found, contradictions=("x",), disagreements={"damping": ("y",), "delay": ("z",)})
    said = "rest and motion contradict each other and the recordings disagree about the damping and the delay."
    assert estimate_answer([], apart).endswith(f"(95 %); {said}")


@pytest.mark.parametrize("unit", ["N/m"])
def test_a_table_of_all_recordings_fits_its_units(unit):
    k = Coefficient("negative_stiffness", unit, -1.2e4, 100.0, -1.25e4, True)
    ((_, html),) = pooled_sections(Pooled((k,), 1.5, {}, {}))
    assert "negative stiffness, kN/m" in html and "-12.5" in html and "times the noise" in html
