"""What results show of themselves, against their own fields, python-control and the linear model."""

from dataclasses import replace

import control
import numpy as np
import pytest

from maglev_env import (
    evaluate,
    evaluate_rotors,
    identify_experiment,
    load_rig,
    load_rotor,
    protocol_experiment,
    to_control,
)
from maglev_env.design.goals import with_goal
from maglev_env.linear.loop import loop_response
from maglev_env.loop.controller_forms import StateFeedback
from maglev_env.loop.effect import effect

RIG = load_rig("hmb_free")


@pytest.fixture(scope="module")
def evaluation():
    # The last one does not hold the rotor.
    return evaluate([protocol_experiment(RIG, replace(RIG.gains, kp=kp)) for kp in (8000.0, 9000.0, 300.0)])


@pytest.fixture(scope="module")
def identification():
    return identify_experiment(protocol_experiment(RIG, seed=2), band_overlap=0.0)


def test_one_line_and_a_table_for_notebooks(evaluation, identification):
    for found, words in ((evaluation, "3 experiments, 2 feasible; best number 0"), (identification, "peak |S| 2.4")):
        assert words in str(found) and repr(found) == f"<{found}>" and "\n" not in repr(found)
        html = found._repr_html_()
        assert "<table" in html and "|S|" in html and html.count("<tr") <= 12
    assert "6 more rows" in identification._repr_html_()


def test_an_evaluation_as_xarray_and_pandas(evaluation):
    data, table = evaluation.to_xarray(), evaluation.to_pandas()
    assert data.sizes == {"experiment": 3, "band": len(evaluation.bands)}
    np.testing.assert_array_equal(data.band_stiffness, evaluation.band_stiffness)
    np.testing.assert_allclose(data.band, evaluation.bands.mean(axis=1))
    units = {name: data[name].attrs.get("units") for name in data.data_vars}
    assert units["stiffness_low"] == units["band_stiffness_se"] == "N/m" and units["damping"] == "N s/m"
    assert (
        units["peak_sensitivity"] is None and units["phase_margin"] == "deg" and units["phase_margin_frequency"] == "Hz"
    )
    assert units["delay_margin"] == "s" and units["term_stiffness"] is None and units["peak_displacement"] == "m"
    assert list(table["score"]) == list(evaluation.score) and not table["feasible"][2]
    assert list(table["phase_margin"][:2]) == list(evaluation.margins["phase_margin"][:2])


def test_an_identification_as_xarray_and_pandas(identification):
    data, table = identification.to_xarray(), identification.to_pandas()
    first = identification.bands[0]
    assert (table["stiffness_low"].iloc[0], table["stiffness_high"].iloc[0]) == first.stiffness_ci
    assert data.band.attrs["units"] == data.frequency.attrs["units"] == "Hz" and len(table) == len(identification.bands)
    np.testing.assert_array_equal(data.sensitivity, identification.stability.sensitivity)


def test_the_identified_loop_has_the_same_margins_in_python_control(identification):
    margins = identification.stability.margins
    _, phase, peak = control.stability_margins(identification.to_control())[:3]
    assert phase == pytest.approx(margins.phase_margin, rel=0.02)
    assert 1 / peak == pytest.approx(margins.peak_sensitivity, rel=0.02)
    nothing = replace(identification, stability=None)
    with pytest.raises(ValueError, match="shows nothing of the loop"):
        nothing.to_control()


@pytest.mark.parametrize("rig", ["hmb_free", "hmb_radial"])
@pytest.mark.parametrize(
    "effects", [{}, effect("delay", 1.3e-4), effect("delay", 2e-4) | effect("dropped_samples", 0.2)]
)
def test_the_systems_of_python_control_respond_as_the_loop_does(rig, effects):
    experiment = protocol_experiment(load_rig(rig), effects=effects)
    plant, controller, closed = to_control(experiment)
    frequency = np.geomspace(2, 9000, 30)
    response = loop_response(experiment, frequency)
    z = np.exp(2j * np.pi * frequency / experiment.rig.control_rate)
    for system, wanted in ((plant, response.plant), (controller, response.controller), (closed, response.receptance)):
        # python-control's own evaluation is by slycot where that is there, of fewer digits between axes that do nothing
        # to each other.
        found = np.array([system.C @ np.linalg.solve(at * np.eye(len(system.A)) - system.A, system.B) for at in z])
        found = found + system.D
        wanted = wanted.reshape(found.shape)
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())
    loop = control.feedback(plant, controller)
    assert np.abs(loop.poles()).max() == pytest.approx(np.abs(closed.poles()).max(), rel=1e-6)


def test_a_controller_that_reads_the_current_has_no_single_loop():
    gains = StateFeedback(displacement=8000.0, velocity=5.0, current=0.1)
    with pytest.raises(ValueError, match="reads the current"):
        to_control(protocol_experiment(RIG, gains))


def test_pictures_show_the_numbers(evaluation, identification):
    upper, lower = evaluation.plot().axes
    np.testing.assert_array_equal(upper.lines[0].get_ydata(), evaluation.band_stiffness[0])
    assert upper.get_ylabel() == "stiffness, N/m" and lower.get_xlabel() == "frequency, Hz"
    lines = identification.plot().axes[1].lines[0]
    np.testing.assert_array_equal(lines.get_ydata(), [b.damping for b in identification.bands if b.informative])


def test_what_a_goal_measures_has_its_unit():
    rig = with_goal(RIG, "peak_sensitivity <= 3, phase_margin >= 20")
    data = evaluate([protocol_experiment(rig)]).to_xarray()
    assert data.required_phase_margin.attrs["units"] == "deg" and "units" not in data.required_peak_sensitivity.attrs


def test_what_is_large_shows_one_line_and_its_stated_numbers():
    experiment = protocol_experiment(RIG, effects=effect("delay", 1e-4))
    response = loop_response(experiment, np.array([1.0, 100.0]))
    shown = {
        repr(RIG): ("hmb_free", "0.08012 kg"),
        repr(experiment): ("hmb_free", "kp=8000.0", "delay"),
        repr(response): ("2 frequencies", "100 Hz"),
    }
    for line, words in shown.items():
        assert line.startswith("<") and len(line) < 160 and all(word in line for word in words)
    html = RIG._repr_html_()
    assert "<th>mass</th><td>0.08012 kg</td>" in html and "support_stiffness" not in html


def test_scored_rotors_as_xarray_and_pandas():
    found = evaluate_rotors([load_rotor("pump")], np.array([0.0, 3000.0]))
    data, table = found.to_xarray(), found.to_pandas()
    assert repr(found).startswith("<Evaluation of 1 rotors") and "<table" in found._repr_html_()
    assert table["score"][0] == found.score[0] and data.peak_displacement.attrs["units"] == "m"
    assert (
        data.pole_radius.dims == ("rotor", "end_of_speeds")
        and table["term_stiffness"][0] == found.terms["stiffness"][0]
    )
