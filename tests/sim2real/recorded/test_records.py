"""What a diagnosis reads of a campaign: periods, what drove them, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import campaign, planned, write

from estimation.multisine.sphs import odd_lines
from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.simulate import simulate_records
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.line_kinds import KINDS, informative, line_kinds
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import read_records

FREE = load_rig("hmb_free")


def base(rig=FREE, **changes) -> Experiment:
    return replace(planned(rig, names=("base",))[0].experiment, **changes)


def read(folder, *experiments, **options):
    return read_records(write(folder, [(f"r{i}", "fit", e) for i, e in enumerate(experiments)], **options))[1]


def edited(folder, *changes):
    """A small campaign whose campaign.toml is changed."""
    path = campaign(folder, names=("base", "holdout")) / "campaign.toml"
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return folder


@pytest.fixture(scope="module")
def quiet(tmp_path_factory):
    """A recording without noise, and its record."""
    e = without_noise(base(offset=2e-5))
    return e, read(tmp_path_factory.mktemp("q") / "c", e)[0], simulate_records([e])[0]


def test_periods_are_the_fourier_coefficients_of_the_channels(quiet):
    e, record, series = quiet
    n = e.samples_per_period
    assert record.dropped + record.count == e.periods + e.transient_periods
    t = np.arange(n) / e.rig.control_rate
    for line in (3, 19, 427):
        at = int(np.flatnonzero(record.lines == line)[0])
        own = series[0].reshape(-1, n)[record.dropped + 1]
        expected = 2 / n * (own * np.exp(-2j * np.pi * line * e.fundamental * t)).sum()
        assert abs(record.periods["displacement"][1, 0, at] - expected) < 1e-12 * abs(own).max()
    assert record.frequency[426] == 427 * e.fundamental


def test_the_waves_are_what_was_designed(quiet):
    e, record, _ = quiet
    for place in ("force", "current"):
        own = e.waveform(place)
        np.testing.assert_allclose(record.waves[place][0], own, atol=1e-11 * abs(own).max(), rtol=0)
    np.testing.assert_allclose(record.waves["reference"][0], 2e-5, rtol=1e-12)


def test_lines_know_what_drives_them(quiet):
    e, record, _ = quiet
    force, injected = (x.lines for x in e.excitations)
    np.testing.assert_array_equal(record.lines[record.driven["force"][0]], force)
    np.testing.assert_array_equal(record.lines[record.driven["current"][0]], injected)
    assert not record.driven["reference"].any() and record.excited.sum() == len(force) + len(injected)
    kinds = line_kinds(record)[0]
    assert {KINDS[k] for k in kinds[record.excited]} == {"force", "current"}
    assert (record.lines[kinds == KINDS.index("even")] % 2 == 0).all()
    assert (record.lines[kinds == KINDS.index("odd")] % 2 == 1).all()


def test_lines_of_the_mains_are_not_fitted_and_dense_detection_lines_are(quiet):
    _, record, _ = quiet
    assert set(record.frequency[record.masked]) == {60.0, 100.0, 120.0, 180.0}
    used = informative(record)
    assert not used[record.masked].any() and used[record.excited & ~record.masked].all()
    left = record.lines[used & ~record.excited]
    assert set(odd_lines(9, 13)) & set(left) and left.max() < 300  # none where excited lines are far apart


def test_a_force_between_samples_is_what_acts_behind_a_hold(tmp_path):
    """A continuous force sin(w t) acts like held samples that are larger by 1 / sinc and half a sample ahead."""
    e = without_noise(base())
    write(tmp_path, [("r0", "fit", e)])
    toml = tmp_path / "campaign.toml"
    held = read_records(tmp_path)[1][0]
    toml.write_text(toml.read_text().replace('"zoh"', '"bl"'))
    wave = read_records(tmp_path)[1][0].waves["force"][0]
    own, other = (np.fft.rfft(w)[list(e.excitations[0].lines)] for w in (held.waves["force"][0], wave))
    w = 2 * np.pi * e.excitations[0].frequencies / 20e3
    hold = (1 - np.exp(-1j * w)) / (1j * w)
    np.testing.assert_allclose(other * hold, own, rtol=1e-9)


def test_the_rate_of_the_recording_does_not_matter(tmp_path, quiet):
    """Half the rate folds what lies beyond 5 kHz; of twice the rate every other sample is one of the control's."""
    e, _, series = quiet
    rows = []
    for rate, values in ((10e3, series[:, ::2]), (20e3, series), (40e3, np.repeat(series, 2, axis=1))):
        at_rate = replace(e, sample_rate=rate)
        rows.append((f"r{rate:.0f}", "fit", simulated_recording(at_rate, values), at_rate))
    write_campaign(tmp_path, "hmb_free", {}, rows)
    slow, own, fast = read_records(tmp_path)[1]
    np.testing.assert_array_equal(own.series["displacement"][:, ::2], slow.series["displacement"])
    np.testing.assert_array_equal(own.series["displacement"], fast.series["displacement"])
    size = abs(own.mean("displacement")).max()
    for other, tolerance in ((slow, 1e-3), (fast, 1e-12)):
        np.testing.assert_allclose(other.waves["force"], own.waves["force"], atol=1e-9)
        np.testing.assert_allclose(other.waves["current"], own.waves["current"], atol=1e-9)
        np.testing.assert_allclose(other.mean("displacement"), own.mean("displacement"), rtol=0, atol=tolerance * size)


def test_a_transient_is_dropped_and_said(quiet):
    _, record, _ = quiet
    assert record.dropped >= 1 and f"the first {record.dropped} period(s) carry a transient" in " ".join(record.notes)
    assert record.start == record.dropped / 4.0


@pytest.mark.parametrize(("periods", "whole"), [(3, False), (2, True)])
def test_a_recording_from_rest_keeps_no_transient_however_few_its_periods_are(tmp_path, periods, whole):
    steps = Excitation("multisine", "reference", 4.0, tuple(range(1, 60, 2)), 2e-6)
    (found,) = read(tmp_path, base(excitations=(steps,), periods=periods, transient_periods=0, offset=2e-5))
    assert isinstance(found, OpenRecord) == whole
    if whole:
        assert any("its two steady periods differ by more than noise" in note for note in found.notes)
    else:
        assert found.dropped == 1


def test_what_repeats_beside_the_stated_lines_of_a_reference_is_simulated_too(tmp_path):
    lines = tuple(range(1, 40, 2))
    steps = Excitation("multisine", "reference", 4.0, lines, 2e-6)
    path = write(tmp_path, [("r", "fit", base(excitations=(steps,)))]) / "campaign.toml"
    whole = read_records(tmp_path)[1][0].waves["reference"]
    text = path.read_text()
    start, end = text.index("lines = ["), text.index("]", text.index("lines = ["))
    path.write_text(text[:start] + "lines = [1, 3, 5" + text[end:])
    stated = read_records(tmp_path)[1][0]
    assert stated.driven["reference"].sum() == 3
    np.testing.assert_allclose(stated.waves["reference"], whole, atol=1e-9 * np.ptp(whole))


def test_a_tone_is_taken_out_of_every_channel(tmp_path):
    found = read(tmp_path, base(effects={"pickup": {"amplitude": 4e-7, "frequency": 50.0}}))[0]
    assert [round(t.frequency, 1) for t in found.tones] == [50.0]
    t = np.arange(found.series["command"].shape[1]) / 20e3
    for values in found.series.values():
        left = abs(np.exp(-2j * np.pi * 50.0 * t) @ (values[0] - values[0].mean())) * 2 / t.size
        other = abs(np.exp(-2j * np.pi * 47.0 * t) @ (values[0] - values[0].mean())) * 2 / t.size
        assert left < 5 * other + 1e-9


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([('rig = "hmb_free"\n', "")], "rig is missing"),
        ([("displacement = {", "gap_estimate = {")], "displacement is missing"),
        ([('role = "fit"', 'role = "holdout"')], "every recording is a holdout"),
        ([('"holdout.npz"', '"base.npz"')], "is the fit recording base.npz .* again"),
        ([('rig = "hmb_free"', 'rig = "hmb_radial"')], "two axes"),
    ],
)
def test_what_a_diagnosis_lacks_is_said(tmp_path, changes, said):
    with pytest.raises(ValueError, match=said):
        read_records(edited(tmp_path / "c", *changes))


def test_a_rotor_whose_controller_is_not_stated_is_driven_by_its_current(tmp_path):
    path = campaign(tmp_path, names=("base",)) / "campaign.toml"
    head, tail = path.read_text().split("[recording.gains]\n")
    path.write_text(head + tail[tail.index("\n\n") :])
    _, (record,) = read_records(tmp_path)
    assert isinstance(record, OpenRecord) and record.source == "current"
    assert any("its controller is not stated" in note for note in record.notes)


def test_an_aperiodic_excitation_is_read_as_an_open_record(tmp_path):
    path = campaign(tmp_path, names=("base",)) / "campaign.toml"
    text = path.read_text()
    start, end = text.index("\n[[recording.excitation]]"), text.index("\n[recording.channels]")
    path.write_text(text[:start] + '\n[[recording.excitation]]\nkind = "recorded"\nat = "force"\n' + text[end:])
    _, (record,) = read_records(tmp_path)
    assert isinstance(record, OpenRecord) and np.ptp(record.waves["force"]) > 0


def test_two_axes_are_read_side_by_side(tmp_path):
    radial = load_rig("hmb_radial")
    e = without_noise(base(radial))
    record = read(tmp_path, e, nominal="hmb_radial")[0]
    assert record.axes == 2 and record.periods["displacement"].shape[1:] == (2, len(record.lines))
    np.testing.assert_allclose(record.waves["force"], e.waveform("force"), atol=1e-10)
    x, y = record.driven["current"]
    assert x.any() and y.any() and not (x & y).any()
    np.testing.assert_array_equal(*record.driven["force"])


def test_one_direction_drives_one_axis(tmp_path):
    radial = load_rig("hmb_radial")
    pushed = tuple(Excitation(x.kind, x.at, 4.0, x.lines, x.amplitude, x.seed, 90.0) for x in base(radial).excitations)
    record = read(tmp_path, base(radial, excitations=pushed), nominal="hmb_radial")[0]
    assert not record.driven["force"][0].any() and record.driven["force"][1].any()
    assert (line_kinds(record)[0] == line_kinds(record)[1])[record.excited].all()
