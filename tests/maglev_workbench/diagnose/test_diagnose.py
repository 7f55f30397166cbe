"""`maglev diagnose` as a user runs it, on small simulated campaigns, with few candidates for the sake of time."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import maglev

from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import EFFECTS, effect
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.diagnose.figures import loop_diagram
from maglev_workbench.commands.diagnose.report import diagnose_page, terminal
from maglev_workbench.console import console
from sim2real.curves import curves
from sim2real.diagnosis import diagnose
from sim2real.free.correction import Free
from sim2real.judgement.meaning.untold_time import Late
from sim2real.report import corrections
from sim2real.search import attribute

DELAY = effect("delay", 7.5e-5)
NONE = Excitation("none", "force", 1.0, (), 1.0)
INJECTED = ((65, 93, 121, 155, 197, 255, 331, 427), (73, 101, 133, 173, 219, 283, 367, 475))


def record(folder, rig="hmb_free", effects=DELAY, names=("base", "holdout"), parameters=None):
    """Three periods of a quarter of a second with few lines, of some recordings of the diagnosis campaign."""
    r = load_rig(rig)
    force = next(e for e in r.protocol.excitations if e.at == "force")
    parts = [Excitation("sphs", "force", 4.0, tuple(range(1, 42)), force.amplitude, direction=45.0 * (r.axes - 1))]
    for axis in range(r.axes):
        parts.append(Excitation("sphs", "current", 4.0, INJECTED[axis], 0.1, direction=90.0 * axis))
    r = replace(r, protocol=replace(r.protocol, excitations=tuple(parts)))
    rows = []
    for plan in diagnosis_campaign(r, r.gains, effects, 0):
        if plan.name in names:
            e = replace(plan.experiment, periods=3)
            rows.append((plan.name, plan.role, simulated_recording(e, simulate_records([e])[0]), e))
    write_campaign(folder, rig, parameters or {}, rows)
    return folder


def few(monkeypatch, *names):
    monkeypatch.setattr(attribute, "single_effects", lambda rig: names)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A campaign with a delay, its diagnosis, and the same worded as explained by the delay."""
    folder = record(tmp_path_factory.mktemp("d") / "rig-7")
    with pytest.MonkeyPatch.context() as patch:
        few(patch, "delay", "mass")
        found = diagnose(folder)
    return found, explained(found)


def explained(found):
    """What the diagnosis is when its best single effect is believed."""
    top = next(e for e in found.which if e.effects == ("delay",))
    fit = found.attribution.of("delay").fit
    rest = [replace(e, probability=0.07 * e.probability) for e in found.which if e is not top]
    which = (replace(top, probability=1 - sum(e.probability for e in rest)), *rest)
    corrected = fit.hypothesis.point(fit.u)
    return replace(
        found, verdict="explained", cause=("delay",), which=which, corrected=corrected, next_experiments=None
    )


def shown(diagnosis):
    with console.capture() as capture:
        for part in terminal(diagnosis):
            console.print(part)
    return " ".join(capture.get().split())


@pytest.mark.slow
def test_the_command_writes_page_data_and_corrected_rig(tmp_path, monkeypatch):
    few(monkeypatch, "delay", "mass")
    folder = record(tmp_path / "rig-7")
    text = maglev("diagnose", folder, "--json", tmp_path / "d.json")
    out = folder / "diagnosis"
    assert sorted(p.name for p in out.iterdir()) == ["corrected.toml", "diagnosis.html", "diagnosis.json"]
    data = json.loads((out / "diagnosis.json").read_text())
    assert data == json.loads((tmp_path / "d.json").read_text()) and data["schema"] == "maglev-diagnosis/1"
    delay = next(e for e in data["which"] if e["effects"] == ["delay"])["parameters"]["delay.time"]
    assert abs(delay["value"] - 7.5e-5) < 4 * delay["se"] < 1e-5
    corrected = load_rig(out / "corrected.toml")
    assert corrected.effects.keys() >= data["corrected"]["effects"].keys()
    assert all(corrected.effects[n] == v for n, v in data["corrected"]["effects"].items())
    page = (out / "diagnosis.html").read_text()
    assert page.count("<svg viewBox") == 1 and page.count("plotly.js v") == 1 and "<script src" not in page
    for said in ("Diagnosis of rig-7", "Where the gap lies", "Receptance: measured", "The corrected rig"):
        assert said in page
    assert "Gap on the holdout, in units of the noise" in text and "delay" in text
    assert "Gains: of 12 sets" in text and 0 <= data["gap"]["regret"]["before"] <= 1
    for name in ("corrected.toml", "diagnosis.json", "diagnosis.html"):
        assert name in text.replace(" ", "")


@pytest.mark.slow
def test_a_named_effect_is_said_with_its_error_and_drawn_in_its_block(diagnosed):
    _, found = diagnosed
    text, page = shown(found), diagnose_page(found)
    assert re.search(r"explained by delay \((> )?\d\d %\), in the controller; time 7\d\.\d+ \+- \d\.\d+ µs", text)
    assert re.search(r"explained by delay \((&gt; |> )?\d\d %\), in the controller; time 7\d\.\d+ ± \d\.\d+ µs", page)
    svg = loop_diagram(found, found.cause)
    blamed = re.findall(r'font-weight="700">(\w+)<', svg)
    assert blamed == ["delay"] and "controller + amplifier" in svg
    assert next(c.name for c in corrections(found)) == "delay.time"
    assert "amplifier_time_constant" in page and "stated tolerance" in page
    assert diagnose_page(found) == page  # nothing random is in it


@pytest.mark.slow
def test_the_loop_is_drawn_with_what_the_channels_isolate(diagnosed):
    found = diagnosed[1]
    blocks = {"controller+amplifier": 0.6, "actuator+mechanics+sensor": 0.3, "actuator": 0.1}
    svg = loop_diagram(replace(found, where=replace(found.where, blocks=blocks)), ("unbalance", "runout"))
    rows = {name: float(y) for y, name in re.findall(r'y="([\d.]+)" [^>]*>\d+ % in ([\w +]+)<', svg)}
    assert rows.keys() == {name.replace("+", " + ") for name in blocks}
    assert rows["actuator"] > rows["actuator + mechanics + sensor"] == rows["controller + amplifier"]  # none overlaps
    assert "shaker&#x27;s force + unbalance" in svg and ">runout<" in svg
    svg = loop_diagram(found, ("support_resonance", "friction"))  # each line within its block
    lines = [(text, float(y)) for y, text in re.findall(r'y="([\d.]+)" [^>]*>(support_|resonance|friction)<', svg)]
    assert [text for text, _ in lines] == ["support_", "resonance", "friction"] and lines[-1][1] < 66 + 60
    stand = replace(found.campaign, rig=load_rig("hmb_axial"))
    alone = replace(found, campaign=stand, where=replace(found.where, blocks={"mechanics+sensor": 1.0}))
    svg = loop_diagram(alone, ())
    assert "100 % in mechanics + sensor" in svg and "controller" not in svg and "reference" not in svg
    held = [replace(r, channels={}, excitations=()) for r in found.campaign.recordings]
    svg = loop_diagram(replace(found, campaign=replace(found.campaign, recordings=tuple(held))), ("unbalance",))
    assert "shaker" not in svg and ">unbalance<" in svg  # nobody shakes it
    none = [replace(r, channels={}, excitations=(NONE,)) for r in found.campaign.recordings]
    svg = loop_diagram(replace(found, campaign=replace(found.campaign, recordings=tuple(none))), ())
    assert "shaker" not in svg  # what is not known is no force


@pytest.mark.slow
def test_measured_and_simulated_responses_are_those_of_the_loop(diagnosed):
    """The corrected ones lie within the noise of the measured ones; the nominal ones far out."""
    found = curves(diagnosed[1])
    assert [(c.kind, c.record, c.axis) for c in found] == [
        ("receptance", "holdout.npz", ""),
        ("sensitivity", "holdout.npz", ""),
    ]
    for c in found:
        near, far = (np.sqrt(np.mean(c.distance(v) ** 2)) for v in (c.corrected, c.nominal))
        assert 0.4 < near < 1.7 and far > 4
    measured = found[0]
    assert abs(measured.measured[0]) == pytest.approx(1 / 36e3, rel=0.3)  # m/N: the support's stiffness


@pytest.mark.slow
def test_every_verdict_has_a_page(diagnosed):
    found, named = diagnosed
    assert "foil" in diagnose_page(named)
    within = replace(found.which[0], effects=("calibration",), probability=0.9, candidate=0)
    none = replace(found, verdict="no_gap", cause=(), next_experiments=None, which=(within,))
    doubtful = replace(none, which=(replace(found.which[0], probability=0.5), replace(within, probability=0.4)))
    assert "no effect may be needed (40 %; not excluded: " in " ".join(shown(doubtful).split())
    assert "There is no gap" in diagnose_page(none) and "Within tolerance" in shown(none)
    partly = " ".join(shown(replace(none, unseen=("delay",))).split())
    assert "from the current on" in partly and "from the current on" not in shown(none)
    late = " ".join(shown(replace(none, unseen=("sensor_lag",), late=Late("current", 2e-3, 1e-4, 0.5))).split())
    assert "2.00 +- 0.10 ms later than the current says" in late and "or sensor_lag." in late
    assert "from the current on" not in late
    unknown = replace(found, verdict="unexplained", cause=("unknown",))
    assert "No effect that fits is borne out" in diagnose_page(unknown)
    unknown = replace(unknown, which=(replace(found.which[0], effects=("unknown",)), *found.which[1:]))
    assert "No known effect" in diagnose_page(unknown) and "Calibration, as far as it goes" in shown(unknown)
    free = Free((), "calibration", (), found.attribution.of("delay"), found.judged, True, 0.9, (0.8, 1.0))
    beside = replace(unknown, corrected=named.corrected, free=free)  # the best partial explanation and a correction
    assert "Fitted beside the free correction: delay.time" in shown(beside) and "Calibration, as" not in shown(beside)
    assert "after with the free correction" in shown(beside) and "with the free correction" not in shown(unknown)
    alike = replace(named, verdict="ambiguous", cause=("delay", "mass"))
    assert "cannot tell them apart" in diagnose_page(alike)
    beaten = replace(named, gap=replace(named.gap, foils={"another effect": named.gap.after}))
    assert "does not beat them" in shown(beaten) and "does not beat" not in shown(
        replace(named, gap=replace(named.gap, after=1.0, foils={"another effect": 2.0}))
    )
    refitted = replace(named, gap=replace(named.gap, foils={"refit all parameters": named.gap.after}))
    assert "does not beat them" in shown(refitted)
    gain = replace(refitted, corrected=replace(refitted.corrected, effects=effect("sensor_gain", 0.12)))
    assert "does not beat" not in shown(gain) and "refit all parameters leaves" in shown(gain)
    helped = replace(named, gap=replace(named.gap, after=1.0, foils={"another effect": 2.0}))
    assert "does not beat" in shown(replace(helped, gap_of_named=replace(named.gap, after=2.1)))  # a correction did it
    tone = replace(beaten, which=tuple(replace(e, candidate=0) for e in beaten.which))
    assert "does not beat" not in shown(tone) and "beside it, calibration closes" in shown(tone)
    still = replace(found, gap=replace(found.gap, before=None, closed_fraction=None))
    assert "does not levitate before" in shown(still) and "is not drawn" in diagnose_page(still)
    hidden = replace(named, where=replace(named.where, significant=False))
    assert "stands out of the noise in no block" in shown(hidden) and "% in controller" not in diagnose_page(hidden)


@pytest.mark.slow
def test_a_nominal_rig_that_touches_down_is_still_reported(tmp_path, monkeypatch):
    few(monkeypatch, "actuator_gain", "negative_stiffness")
    folder = record(tmp_path / "c", effects={}, parameters={"negative_stiffness": -6e4})
    text = maglev("diagnose", folder, "--out", tmp_path / "out")
    assert "does not levitate before" in text
    data = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert data["gap"]["before"] is None
    assert "does not levitate" in (tmp_path / "out" / "diagnosis.html").read_text()
    assert load_rig(tmp_path / "out" / "corrected.toml").negative_stiffness is not None


@pytest.mark.slow
def test_two_axes_have_two_columns_of_responses(tmp_path, monkeypatch):
    few(monkeypatch, "actuator_gain", "mass")  # in the kernel that other tests need too
    found = diagnose(record(tmp_path / "xy", "hmb_radial", effect("actuator_gain", 0.1)))
    drawn = {(c.kind, c.axis) for c in curves(found)}
    assert drawn == {(kind, axis) for kind in ("receptance", "sensitivity") for axis in "xy"}
    page = diagnose_page(found)
    assert "along x, holdout.npz" in page and "along y, holdout.npz" in page
    assert "hmb_radial" in page


@pytest.mark.slow
def test_without_a_holdout_the_lines_that_were_kept_out_judge(tmp_path, monkeypatch):
    few(monkeypatch, "delay", "mass")
    found = diagnose(record(tmp_path / "c", names=("base",)))
    page = diagnose_page(found)
    assert "held-out lines" in page and "every fourth line" in page and "Receptance" in page


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("no-such",), "does not exist"),
        (("{}", "--json", "{}/no/d.json"), "does not exist"),
        (("{}", "--out", "{}/no/such"), "does not exist"),
        (("{}", "--out", "{}/a.csv"), "is a file"),
    ],
)
def test_what_cannot_be_done_is_refused_before_any_work(tmp_path, monkeypatch, arguments, said):
    monkeypatch.setattr("sim2real.diagnosis.diagnose", lambda *a: pytest.fail("worked"))
    (tmp_path / "a.csv").write_text("y\n0\n")
    (tmp_path / "campaign.toml").write_text(
        'schema = "maglev-campaign/1"\n[[recording]]\nfile = "a.csv"\nsample_rate = 20000.0\n'
        'excitation = { kind = "none" }\n[recording.channels]\ndisplacement = { from = "y" }\n'
    )
    assert said in maglev("diagnose", *(a.format(tmp_path) for a in arguments), code=2)


def test_a_campaign_without_a_rig_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("y\n0\n")
    (tmp_path / "campaign.toml").write_text(
        'schema = "maglev-campaign/1"\n[[recording]]\nfile = "a.csv"\nsample_rate = 20000.0\n'
        'excitation = { kind = "none" }\n[recording.channels]\ndisplacement = { from = "y" }\n'
    )
    assert "rig is missing" in maglev("diagnose", tmp_path, code=2)
    assert "Example: maglev diagnose" in maglev("diagnose", "--help")


def test_the_list_of_effects_says_what_identifies_each():
    text = maglev("effects")
    assert "Identified by" in text
    for name in EFFECTS:
        assert name in text.replace(" ", "") or name[:8] in text
