"""Which recordings the rig is fitted to, where their own responses tell nothing."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from bench_loop import Bench, write_campaign
from campaigns import planned, write
from command_line import CAMPAIGN, maglev

from maglev_env.recordings.campaign import load_campaign, with_mass
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.estimate import recordings


@pytest.fixture
def without_responses(monkeypatch):
    """A recording of a set-point sine, whose one line is too few for bands."""
    spec = SimpleNamespace(name="sine.csv", excitations=(SimpleNamespace(kind="multisine"),), role="fit", gains=None)
    told = SimpleNamespace(left_out=())

    def too_few(*args):
        raise ValueError("1 lines; at least four excited lines are needed")

    monkeypatch.setattr(recordings, "read_recording", lambda *args: None)
    monkeypatch.setattr(recordings, "recorded_signals", lambda *args: SimpleNamespace(axes=1))
    monkeypatch.setattr(recordings, "_axes", too_few)
    monkeypatch.setattr(recordings, "each_recording", lambda campaign, read, track: (told, [read(spec)]))
    return told


def campaign(controlled):
    return SimpleNamespace(rig=SimpleNamespace(controlled=controlled), folder=Path("bench"))


def test_a_named_rig_is_fitted_to_what_has_too_few_lines_for_bands(without_responses, monkeypatch):
    monkeypatch.setattr(recordings, "_pooled", lambda campaign: (without_responses, "fitted"))
    found = recordings.identify_campaign(campaign(True), False, None, None, iter)
    assert found.pooled == "fitted" and not found.axes
    assert "sine.csv: no bands alone" in found.notes[0] and "at least four" in found.notes[0]


def test_without_magnets_and_where_the_rig_cannot_be_fitted_the_reason_is_said(without_responses, monkeypatch):
    def falls(campaign):
        raise ValueError("the rotor touches down")

    monkeypatch.setattr(recordings, "_pooled", falls)
    with pytest.raises(ValueError, match=r"sine\.csv: 1 lines"):
        recordings.identify_campaign(campaign(False), False, None, None, iter)
    with pytest.raises(ValueError, match=r"at least four.*touches down"):
        recordings.identify_campaign(campaign(True), False, None, None, iter)


def test_without_a_rig_a_recording_that_tells_nothing_is_named_and_the_others_stand(without_responses, monkeypatch):
    alone = SimpleNamespace(rig=None, folder=Path("bench"))
    with pytest.raises(ValueError, match=r"bench.sine\.csv: 1 lines"):
        recordings.identify_campaign(alone, False, None, None, iter)
    steps = SimpleNamespace(name="steps.csv", excitations=(SimpleNamespace(kind="multisine", at="force"),), role="fit")
    read = recordings.each_recording

    def axes(spec, *args):
        if spec.name == "sine.csv":
            raise ValueError("1 lines")
        return [(spec.name, "identified")]

    monkeypatch.setattr(recordings, "_axes", axes)
    monkeypatch.setattr(
        recordings, "recorded_signals", lambda *args: SimpleNamespace(axes=1, excitations=steps.excitations)
    )
    monkeypatch.setattr(recordings, "each_recording", lambda c, do, track: (read(c, do, track)[0], [do(steps)]))
    found = recordings.identify_campaign(alone, False, None, None, iter)
    assert found.axes == [("steps.csv", "identified")] and found.notes == (
        "sine.csv: tells nothing without a rig (1 lines)",
    )


@pytest.mark.slow
def test_two_axes_that_only_references_drive_are_told_each_alone(tmp_path):
    radial = load_rig("hmb_radial")
    base = replace(planned(radial, names=("base",))[0].experiment, periods=3)
    driven = [
        replace(
            base, excitations=(Excitation("multisine", "reference", 4.0, tuple(range(1, 90)), 2e-5, direction=turn),)
        )
        for turn in (0.0, 90.0)
    ]
    folder = write(tmp_path, [(f"r{i}", "fit", e) for i, e in enumerate(driven)], nominal="hmb_radial")
    found = recordings.identify_campaign(load_campaign(folder), False, None, None, iter)
    assert [name for name, _ in found.axes] == ["r0.npz, x", "r1.npz, y"] and not found.planar


@pytest.mark.slow
def test_another_mass_is_that_of_the_rig_that_is_fitted(tmp_path):
    """Accelerations are what is seen: with the mass go gain and stiffness."""
    stated = load_campaign(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.5, 0))
    found = []
    for campaign in (stated, with_mass(stated, 1.2 * stated.mass)):
        together = recordings.identify_campaign(campaign, False, None, None, iter).pooled
        found.append({c.name: c for c in together.coefficients})
    for name in ("actuator_gain", "negative_stiffness"):
        assert found[1][name].value == pytest.approx(1.2 * found[0][name].value, rel=0.03)


def test_options_of_one_file_are_refused_for_a_campaign(tmp_path):
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    for option in (("--start", 77), ("--force", "y"), ("--recorded",)):
        text = maglev("estimate", tmp_path, *option, code=2)
        assert f"{option[0]} for one file only; the campaign" in text
    assert "--lines, --rate for one file only" in maglev(
        "estimate", tmp_path / "campaign.toml", "--lines", "1:50", "--rate", 5000, code=2
    )
