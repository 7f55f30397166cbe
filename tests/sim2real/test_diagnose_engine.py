"""A diagnosis from end to end, on small simulated campaigns with few candidates."""

import re
from dataclasses import replace

import numpy as np
import pytest
from campaigns import campaign, planned, write

from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.files import read_columns, write_csv
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from sim2real import diagnosis
from sim2real.advice.next_experiment import SEPARATED
from sim2real.diagnosis import diagnose
from sim2real.free.correction import Free
from sim2real.search import attribute

FREE = load_rig("hmb_free")
DELAY = effect("delay", 7.5e-5)
FEW = ("delay", "mass", "actuator_gain", "friction")

pytestmark = pytest.mark.slow


def answer(folder, *names):
    """The diagnosis with only these candidates."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attribute, "single_effects", lambda rig: names or FEW)
        return diagnose(folder)


@pytest.fixture(scope="module")
def delayed(tmp_path_factory):
    """A campaign with a delay, and its diagnosis among all effects."""
    folder = campaign(tmp_path_factory.mktemp("d") / "c", effects=DELAY)
    return folder, diagnose(folder)


def test_a_delay_is_found_located_and_closed(delayed):
    _, found = delayed
    assert "delay" in found.cause and found.verdict in ("explained", "ambiguous")
    top = next(e for e in found.which if e.effects == ("delay",))
    assert top.probability > 0.2 and top.explained_worst_group > 0.9
    fit = found.attribution.of("delay").fit
    own = fit.hypothesis.point(fit.u).effects["delay"]["time"]
    assert own == pytest.approx(7.5e-5, abs=4 * 1e-5 * np.sqrt(fit.covariance()[0, 0])) and 5e-5 < own < 1e-4
    assert found.where.blocks["controller+amplifier"] > 0.8
    assert found.gap.judged_on == "holdout" and found.gap.before > 3 and found.gap.after < 1.15
    assert found.gap.closed_fraction > 0.97
    wrong = found.attribution.of("mass")
    assert wrong.predictive > found.attribution.of("delay").predictive + 100


def test_the_share_of_what_is_named_is_told_apart_from_that_of_a_free_correction(tmp_path, monkeypatch):
    """The free correction stands in for one: calibration, which closes much less than the delay."""

    def gained(attribution, judged, partial, named, seed):
        return Free(partial.effects, "delay", (), attribution.calibration, judged, True, 0.5, (0.4, 0.6))

    monkeypatch.setattr(diagnosis, "_leaves_much", lambda *_: True)
    monkeypatch.setattr(diagnosis, "free_correction", gained)
    found = answer(campaign(tmp_path / "c", effects=DELAY), "delay", "friction")
    assert found.cause == ("delay",)
    assert found.gap.after == found.gap.calibrated > 2 > found.gap_of_named.after
    told = found.to_json()["gap"]
    assert told["closed_fraction"] > told["corrected_closed_fraction"] + 0.01
    assert told["corrected_closed_fraction"] == found.gap.closed_fraction


def test_the_corrected_rig_has_the_partial_explanation_where_a_free_correction_simulates_worse(tmp_path, monkeypatch):
    """The free correction stands in for one: calibration, which closes much less than the delay."""

    def gained(attribution, judged, partial, named, seed):
        return Free((), "calibration", (), attribution.calibration, judged, True, 0.5, (0.4, 0.6))

    monkeypatch.setattr(diagnosis, "free_correction", gained)
    found = answer(
        campaign(tmp_path / "c", effects=DELAY | effect("friction", 0.05, velocity=1e-3)), "delay", "sensor_lag"
    )
    assert found.verdict == "unexplained" and not found.corrected_freely
    assert found.by_partial is not None and found.corrected.effects.keys() == {*found.by_partial.effects}
    assert found.gap.after < found.gap.calibrated
    assert found.to_json()["corrected"]["by"] == "partial explanation"


def test_its_json_holds_what_is_promised(delayed):
    data = delayed[1].to_json()
    assert data["schema"] == "maglev-diagnosis/1" and data["seconds"] > 0
    assert sum(e["probability"] for e in data["which"]) == pytest.approx(1.0, abs=1e-9)
    listed = [tuple(e["effects"]) for e in data["which"]]
    assert {("none",), ("calibration",), ("unknown",), ("delay",)} <= set(listed)
    delay = data["which"][listed.index(("delay",))]["parameters"]["delay.time"]
    assert abs(delay["value"] - 7.5e-5) < 4 * delay["se"] < 3e-5
    for shares in (data["where"]["blocks"], data["where"]["kind"]):
        assert sum(shares.values()) == pytest.approx(1.0)
    assert sum(b["share"] for b in data["where"]["bands"]) == pytest.approx(1.0)
    assert {"stiffness_error", "damping_error", "peak_sensitivity_error", "foils"} <= set(data["gap"])


def test_without_effect_there_is_no_gap(tmp_path):
    found = answer(campaign(tmp_path / "c"))
    assert found.verdict == "no_gap" and found.cause == ()
    assert not found.where.significant and 0.85 < found.gap.before < 1.15
    assert found.gap.closed_fraction is None and found.next_experiments is None
    assert found.where.controller < 2


def test_parameters_within_tolerance_are_calibration(tmp_path):
    off = {**effect("actuator_gain", 0.05), **effect("sensor_gain", -0.02), **effect("mass", 0.004)}
    found = answer(campaign(tmp_path / "c", effects=off), "delay", "friction", "sensor_lag")
    assert found.verdict == "no_gap" and found.which[0].effects == ("calibration",)
    assert found.gap.before > 2 and found.gap.after < 1.15
    changes = found.corrected.changes
    assert found.gap_of_named is None  # nothing is named
    assert not found.corrected.effects and changes["actuator_gain"] == pytest.approx(0.05, abs=0.03)


def rewritten(folder, source):
    """The same recordings as .csv files in another order, under other names, in units and with offsets of their own."""
    old = load_campaign(source)
    folder.mkdir()
    text = (source / "campaign.toml").read_text()
    head, *tables = re.split(r"(?=\[\[recording\]\])", text)
    units = {"displacement": ("y_um", 1e-6, 3e-4), "force": ("F_mN", 1e-3, 0.0), "current": ("i", 1.0, 0.0)}
    for number, spec in enumerate(old.recordings):
        columns = read_columns(source / spec.file)
        raw, lines = {}, []
        for name in spec.channels:
            values = columns.column(name)
            column, scale, offset = units.get(name, (f"col_{name}", 1.0, 0.0))
            raw[column] = (values - offset) / scale
            lines.append(f'{name} = {{ from = "{column}", scale = {scale!r}, offset = {offset!r} }}')
        write_csv(folder / f"m{9 - number}.csv", raw)
        described = tables[number].replace(spec.file, f"m{9 - number}.csv")
        tables[number] = (
            described[: described.index("[recording.channels]")] + "[recording.channels]\n" + "\n".join(lines) + "\n\n"
        )
    (folder / "campaign.toml").write_text(head + "".join(reversed(tables)))
    return folder


def test_order_format_names_and_units_do_not_matter(tmp_path, delayed):
    source, _ = delayed
    one, other = (answer(folder, "delay", "mass") for folder in (source, rewritten(tmp_path / "other", source)))
    assert (one.verdict, one.cause) == (other.verdict, other.cause)
    by_name = [{e.effects: e.probability for e in found.which} for found in (one, other)]
    assert by_name[0] == pytest.approx(by_name[1], abs=0.01)
    for name in ("before", "calibrated", "after", "closed_fraction"):
        assert getattr(one.gap, name) == pytest.approx(getattr(other.gap, name), rel=1e-3)
    assert one.where.blocks == pytest.approx(other.where.blocks, abs=1e-6)
    fits = [found.attribution.of("delay").fit for found in (one, other)]
    sd = np.sqrt(fits[0].covariance()[0, 0])
    assert abs(fits[0].u[0] - fits[1].u[0]) < 0.05 * sd


def test_a_diagnosis_repeats_itself(delayed):
    source, _ = delayed
    one, other = ({k: v for k, v in answer(source, "delay").to_json().items() if k != "seconds"} for _ in range(2))
    assert one == other


def test_one_recording_alone_is_judged_on_lines_kept_out(tmp_path):
    found = answer(campaign(tmp_path / "c", effects=DELAY, names=("base",)))
    assert found.gap.judged_on == "held-out lines" and any("every fourth line" in n for n in found.notes)
    assert "delay" in found.cause and found.gap.after < 0.5 * found.gap.before


@pytest.fixture(scope="module")
def poor(tmp_path_factory):
    """A lag of the amplifier in one record of force and displacement, every line of it excited."""
    alone = Excitation("sphs", "force", 4.0, tuple(range(1, 62)), 0.4)
    late = planned(FREE, effect("amplifier_lag", 1.5e-4), ("base",), seed=1)[0].experiment
    e = replace(late, excitations=(alone,), periods=6)
    folder = write(tmp_path_factory.mktemp("p") / "c", [("run1", "fit", e)], keep=("displacement", "force"))
    return answer(folder, "delay", "amplifier_lag", "mass", "friction")


def test_a_record_of_force_and_displacement_alone_has_an_honest_class(poor):
    """A lag of the amplifier and a delay of the command look alike there; the mass does not."""
    assert poor.verdict == "ambiguous" and {"delay", "amplifier_lag"} <= set(poor.cause)
    assert "mass" not in poor.cause and poor.indistinguishable == (poor.cause,)
    assert list(poor.where.blocks) == ["controller+amplifier+actuator+mechanics+sensor"]
    assert poor.where.controller is None


def test_the_experiment_that_tells_its_class_apart_is_proposed(poor):
    """What goes into the current passes the amplifier as the command does; the force meets neither on its way in."""
    (best, *_), plan = poor.next_experiments.proposals, poor.next_experiments
    assert "current" in best.what and best.expected_separation > SEPARATED
    menu = {choice.what: choice.expected_separation for choice in plan.menu}
    assert len(menu) >= 4 and all(np.isfinite(v) for v in menu.values())
    assert plan.to_json()["proposals"][0]["change"] == best.change and best.change.keys() <= {"channels", "excitation"}
    assert "an injection into the current beside the force" in menu  # though the force had every line
    assert "the coil current beside the same channels" in menu


def test_gains_that_are_not_the_recorded_ones_are_said(tmp_path, delayed):
    source, right = delayed
    assert not any("controller is not the one described" in n for n in right.notes)
    for file in source.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    toml = tmp_path / "campaign.toml"
    toml.write_text(toml.read_text().replace("kd = 5.2", "kd = 6.5"))
    found = answer(tmp_path, "delay", "mass")
    assert any("the recorded controller is not the one described" in n for n in found.notes)
    assert found.where.controller > 20


def test_a_nominal_rig_that_cannot_levitate_is_diagnosed(tmp_path):
    """Five times the negative stiffness of the real one: the recorded gains do not hold it."""
    folder = campaign(tmp_path / "c", names=("base", "holdout"), parameters={"negative_stiffness": -6e4})
    found = answer(folder, "negative_stiffness", "mass", "delay")
    assert found.gap.before is None and found.gap.after < 1.2 and found.gap.closed_fraction is None
    assert found.gap.figures.chi_square < 1.4 and found.gap.figures.predicted > 0.99
    assert found.verdict == "explained" and found.cause == ("negative_stiffness",)
    change = found.corrected.effects["negative_stiffness"]["change"]
    assert -6e4 * (1 + change) == pytest.approx(-12.5e3, rel=0.2)
    assert found.where.significant and found.where.blocks["controller+amplifier"] < 0.1


def test_where_nothing_levitates_it_is_said(tmp_path):
    folder = campaign(tmp_path / "c", names=("base", "holdout"), parameters={"negative_stiffness": -6e4})
    with pytest.raises(ValueError, match="neither the nominal rig hmb_free nor any single effect levitates"):
        answer(folder, "mass")


def test_a_holdout_that_is_a_fit_is_refused_before_any_work(tmp_path, monkeypatch):
    e = planned(FREE, names=("base",))[0].experiment
    dataset = simulated_recording(e, simulate_records([e])[0])
    write_campaign(tmp_path / "c", "hmb_free", {}, [("a", "fit", dataset, e), ("b", "holdout", dataset, e)])
    monkeypatch.setattr("sim2real.attributed.attribute", lambda *a: pytest.fail("worked"))
    with pytest.raises(ValueError, match=r"is the fit recording a\.npz again"):
        diagnose(tmp_path / "c")


def test_two_axes_are_diagnosed_together(tmp_path):
    folder = campaign(tmp_path / "c", "hmb_radial", effect("cross_coupling", 0.08), names=("base", "holdout"))
    found = answer(folder, "cross_coupling", "mass", "delay")
    assert "cross_coupling" in found.cause
    ratio = found.corrected.effects["cross_coupling"]["ratio"]
    assert ratio == pytest.approx(0.08, abs=0.02) and found.gap.after < 0.5 * found.gap.before


def test_pickup_is_named_and_given_to_the_corrected_rig(tmp_path):
    hum = effect("pickup", amplitude=1e-6, frequency=50.0)
    found = answer(campaign(tmp_path / "c", effects=hum), "delay", "mass")
    assert found.verdict == "explained" and found.cause == ("pickup",)
    own = found.corrected.effects["pickup"]
    assert own["frequency"] == 50.0 and own["amplitude"] == pytest.approx(1e-6, rel=0.15)
    assert found.where.kind["unsynchronised"] > 0.5


def test_a_foreign_vibration_is_named_and_given_to_the_corrected_rig(tmp_path):
    shaken = effect("foreign_vibration", 0.03, frequency=37.3)
    found = answer(campaign(tmp_path / "c", effects=shaken), "delay", "mass")
    assert found.verdict == "explained" and found.cause == ("foreign_vibration",)
    own = found.corrected.effects["foreign_vibration"]
    assert own["force"] == pytest.approx(0.03, rel=0.1) and own["frequency"] == pytest.approx(37.3, abs=0.05)
