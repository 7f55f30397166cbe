"""`maglev selfsense robustness` on a short protocol: where the rotor rests by hand, and what calibrating mends."""

import json
from dataclasses import replace
from functools import partial
from importlib import resources

import numpy as np
import pytest
from command_line import maglev
from scipy.optimize import brentq

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.selfsense.robustness import experiments
from maglev_workbench.commands.selfsense.robustness.experiments import (
    AS_BELIEVED,
    SEEDS,
    Loop,
    calibrated,
    change_of,
    measure_robustness,
    plan_robustness,
)
from maglev_workbench.commands.selfsense.robustness.figures import robustness_figure
from maglev_workbench.commands.selfsense.robustness.report import (
    robustness_json,
    robustness_page,
    robustness_summary,
    robustness_table,
)
from selfsense.calibration.static import static_sweep
from selfsense.robustness import expected_gap

run = partial(maglev, "selfsense", "robustness")
PROTOCOL = f"""
[protocol]
periods = 3
transient_periods = 1
band_width = 60.0
band_overlap = 30.0
[[protocol.excitation]]
kind = "sphs"
at = "force"
fundamental = 5.0
amplitude = 0.1
lines = {list(range(1, 50, 2))}
[[protocol.excitation]]
kind = "sphs"
at = "current"
fundamental = 5.0
amplitude = 0.05
lines = {[*range(2, 51, 2), *range(60, 400, 30)]}
"""


def short_rig(folder):
    """hmb_free with a protocol of 0.8 s that moves the rotor little."""
    text = (resources.files("maglev_env") / "rigs" / "hmb_free.toml").read_text().split("[protocol]")[0]
    path = folder / "short.toml"
    path.write_text(text + PROTOCOL)
    return path


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return plan_robustness(load_rig(short_rig(tmp_path_factory.mktemp("rig"))))


@pytest.fixture(scope="module")
def found(plan):
    return measure_robustness(plan, 5)


def resting_bias(rig, sensor):
    """Reading less displacement (m) where the magnet's force is nought at the current that the controller then asks."""
    law, gain = force_law(rig), rig.gains.kp + rig.gains.ki  # the integrator has unit gain at rest

    def reading(y):
        return sensor.gap - expected_gap(sensor, sensor.gap - y)

    y = brentq(lambda y: force(law, y, -gain * reading(y)), -0.5 * rig.gap, 0.5 * rig.gap)
    return reading(y) - y


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["voltage +20%", "voltage -20%", "pole area +20%", "pole area -20%", "core length +20%"]
)
def test_a_wrong_constant_moves_the_rotor_to_where_its_forces_balance(found, name):
    """The rotor's own forces keep the pole area that they have."""
    expected = resting_bias(found.plan.rig, found.plan.tables[0][name])
    assert np.mean(found.rows[name].raw.gap_error_bias) == pytest.approx(expected, abs=0.5e-6)
    assert abs(expected) > 1.8e-6


@pytest.mark.slow
def test_a_static_calibration_mends_wrong_constants_in_the_loop(found):
    for name, row in found.rows.items():
        assert row.raw.levitates.all() and row.calibrated.levitates.all()
        if not name.endswith("%"):
            continue
        assert abs(np.mean(row.calibrated.gap_error_bias)) < 0.15e-6, name
        left, half = change_of(found, row.calibrated, "phase_margin")
        assert abs(left) < max(1.5 * half, 0.1) and half < 0.6, name
    for name in ("voltage -20%", "pole area +20%"):  # readings of less than unit gain
        taken, half = change_of(found, found.rows[name].raw, "phase_margin")
        assert taken < -half < 0, name


@pytest.mark.slow
def test_eddy_currents_are_what_a_calibration_cannot_mend(found):
    left = {name: row.errors.estimator for name, row in found.rows.items()}
    assert max(left, key=left.get) == "eddy currents" and left["eddy currents"] > 1.5 * left[AS_BELIEVED]
    assert found.rows["eddy currents"].errors.raw > 10 * left["eddy currents"]


@pytest.mark.parametrize("name", ["pole area -20%", "voltage +20%"])
def test_a_calibrated_sensor_reads_the_displacement(plan, name):
    sensor = plan.tables[0][name]
    sensor = replace(sensor, acquisition=replace(sensor.acquisition, bits=0, noise=0.0))
    gaps = sensor.gap + np.array([-40e-6, 0.0, 40e-6])
    read = static_sweep(sensor, gaps)
    gain, offset = np.polyfit(gaps - sensor.gap, read - sensor.gap, 1)

    class Errors:  # what `calibrated` needs of a MismatchErrors
        pass

    errors = Errors()
    errors.gain, errors.offset = gain, offset
    mended = calibrated(sensor, errors)
    displacement = mended.scale * (mended.gap - read) + mended.shift
    assert displacement == pytest.approx([40e-6, 0.0, -40e-6], abs=0.1e-6)


def test_the_plan_pairs_signs_and_assumes_a_core_only_where_none_is_given(plan):
    names = list(plan.tables[0])
    assert names[:3] == [AS_BELIEVED, "voltage +20%", "voltage -20%"] and len(names) == 12
    believed = plan.tables[0][AS_BELIEVED]
    assert plan.assumed_core == pytest.approx(21e-6)
    assert believed.coil.core_length == believed.estimator.coil.core_length == plan.assumed_core
    assert plan.tables[0]["saturation"].coil.bias_field == believed.coil.bias_field > 0.5
    given = replace(plan.rig, self_sensing=replace(plan.rig.self_sensing, core_length=10e-6))
    own = plan_robustness(given)
    assert own.assumed_core is None and own.tables[0][AS_BELIEVED].coil.core_length == 10e-6
    with pytest.raises(ValueError, match="through the magnets"):
        plan_robustness(replace(plan.rig, flux_path="magnet"))


@pytest.mark.slow
def test_the_command_writes_page_json_and_table(found, tmp_path, monkeypatch):
    monkeypatch.setattr(
        experiments, "measure_robustness", lambda plan, seed, threads, progress: replace(found, seed=seed)
    )
    page, js = tmp_path / "p.html", tmp_path / "r.json"
    text = run("--rig", short_rig(tmp_path), "--seed", 5, "--out", page, "--json", js)
    assert "A static calibration takes the largest rms error from 90" in text and "eddy currents" in text
    data = json.loads(js.read_text())
    assert data == plain(robustness_json(found))
    assert data["schema"] == "maglev-selfsense-robustness/1" and data["seed"] == 5 and data["experiments"] == SEEDS
    rows = {row["name"]: row for row in data["rows"]}
    area = rows["pole area -20%"]
    assert area["offset"] == pytest.approx(0.25 * (350e-6 + 10.5e-6), abs=0.7e-6)
    assert area["gain"] == pytest.approx(1.25, abs=4e-3)
    assert area["suppression"] == pytest.approx(area["demodulator"] / area["estimator"])
    raw = found.rows["pole area -20%"].raw.phase_margin - found.rows[AS_BELIEVED].raw.phase_margin
    assert area["loop_raw"]["phase_margin_change"]["mean"] == pytest.approx(np.mean(raw))
    assert rows[AS_BELIEVED]["loop_raw"]["phase_margin_change"] == {"mean": 0.0, "half_width": 0.0}
    html = page.read_text()
    assert "A static calibration mends" in html and "21 µm are assumed" in html and html.count("plotly-graph-div") == 1


@pytest.mark.slow
def test_a_loop_that_does_not_hold_is_named_and_crossed_out(found):
    lost = Loop(np.zeros(SEEDS, bool), *(np.full(SEEDS, np.nan) for _ in range(3)))
    rows = {**found.rows, "dead time": replace(found.rows["dead time"], raw=lost)}
    broken = replace(found, rows=rows)
    assert "as the sensor reads, it does not levitate with: dead time." in robustness_summary(broken)
    assert "<td>falls</td>" in robustness_page(broken) and "<td>falls</td>" not in robustness_page(found)
    cells = [list(column.cells) for column in robustness_table(broken).columns]
    assert [column[-1] for column in cells].count("falls") == 2
    symbols = [list(t.marker.symbol) for t in robustness_figure(broken).data[3:]]
    assert [s.count("x") for s in symbols] == [1, 0, 1, 0] and symbols[0][-1] == "x"
    none = replace(found, rows={name: replace(row, raw=lost, calibrated=lost) for name, row in found.rows.items()})
    assert "does not levitate even without a mismatch" in robustness_summary(none)
    robustness_page(none)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seed", -1], "--seed"),
    ],
)
def test_bad_input_ends_before_any_work(arguments, words, tmp_path, monkeypatch):
    def work(*_):
        raise AssertionError("work began")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(experiments, "measure_robustness", work)
    assert words in run(*arguments, code=2)
