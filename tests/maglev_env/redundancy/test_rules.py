"""The rules on simulated recordings: silent on sound ones, and what was done to others named with channel and size."""

import re
from dataclasses import replace
from types import SimpleNamespace

import bench_loop
import campaigns
import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.evaluation.identification import identify
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.redundancy.bounds import ranges, reversed_coils
from maglev_env.redundancy.coverage import uncovered
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.result import doubtful, without_contradicted_margins
from maglev_env.redundancy.rules import _as_many, _at_ticks, _compares, _views, as_data, examine
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """One period-by-period recording of the free rotor with every channel."""
    return campaigns.campaign(tmp_path_factory.mktemp("sound"), names=("base", "gains"))


@pytest.fixture(scope="module")
def dense(tmp_path_factory):
    """A recording of the free rotor with force lines up to 248 Hz."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaigns, "FORCED", tuple(range(1, 63)))
        return campaigns.campaign(tmp_path_factory.mktemp("dense"), names=("base",))


@pytest.fixture(scope="module")
def open_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("open")
    return bench_loop.write_campaign(folder, bench_loop.Bench(noise=0.5e-6), {"noise": "fit"}, 1.5, 4)


def changed(source, target, file, change, toml=lambda text: text):
    """A copy of a campaign with the columns of one file changed in place, and its text."""
    target.mkdir(exist_ok=True)
    for path in source.glob("*.npz"):
        columns = dict(np.load(path))
        if path.stem == file:
            change(columns)
        np.savez(target / path.name, **columns)
    (target / "campaign.toml").write_text(toml((source / "campaign.toml").read_text()))
    return [f for f in examine(load_campaign(target)) if f.kind != "not checkable"]


def scale(name, factor):
    def change(columns):
        columns[name] = columns[name] * factor

    return change


def late(name, samples):
    def change(columns):
        columns[name] = np.roll(columns[name], samples)

    return change


def test_sound_recordings_are_not_accused(sound, open_folder):
    assert examine(load_campaign(sound)) == []
    assert [f for f in examine(load_campaign(open_folder)) if f.kind != "not checkable"] == []


@pytest.mark.parametrize(
    ("channel", "factor", "kind"),
    [
        ("force", 2.0, "contradiction"),
        ("displacement", 9.81, "contradiction"),
        ("command", 0.5, "contradiction"),
        ("current", 2.0, "contradiction"),
        ("injection", 2.0, "contradiction"),
        ("force", -1.0, "contradiction"),
        ("displacement", -1.0, "contradiction"),
        ("displacement", 1000.0, "contradiction"),
    ],
)
def test_a_wrong_scale_or_sign_is_named_with_its_size(sound, tmp_path, channel, factor, kind):
    found = changed(sound, tmp_path / "c", "base", scale(channel, factor))
    first = found[0]
    assert channel in first.channel.split(" or ") and first.kind == kind
    assert "check the s" in first.message
    if abs(factor) < 100 and factor > 0:
        assert first.value == pytest.approx(factor, rel=0.03) and first.interval[0] < factor < first.interval[1]


def test_the_doubled_force_reads_as_a_user_needs_it(sound, tmp_path):
    found = changed(sound, tmp_path / "c", "base", scale("force", 2.0))
    wanted = r"force: factor 2(\.0\d?)? \+- 0\.0\d* against its stated 0\.4 N peak and the force on 0\.08012 kg; "
    assert re.match(wanted + r"check the scale of column 'force'$", found[0].message)


def test_a_stated_amplitude_that_is_peak_to_peak_is_told_from_a_wrong_column(sound, tmp_path):
    def doubled(text):
        return re.sub(r"amplitude = ([\d.]+)", lambda m: f"amplitude = {2 * float(m[1])}", text)

    found = changed(sound, tmp_path / "c", "base", lambda columns: None, doubled)
    of = {f.channel: f for f in found if f.recording == "base.npz"}
    assert of.keys() == {"force", "injection"}
    assert all(f.value == pytest.approx(0.5, rel=0.05) and "correct the stated amplitude" in f.message
               for f in of.values())  # fmt: skip


def test_hum_that_hides_what_is_compared_is_no_exchange_of_columns(sound, tmp_path):
    injected = next(e for e in load_campaign(sound).recordings[0].excitations if e.at == "current")
    f = injected.lines[len(injected.lines) // 3] * injected.fundamental

    def hum(columns):
        x = columns["injection"]
        columns["injection"] = x + 2 * x.std() * np.sin(2 * np.pi * f * np.arange(x.size) / 20000)

    found = changed(sound, tmp_path / "c", "base", hum)
    assert found and not any(f.code == "swapped" for f in found)


def test_no_loop_has_a_peak_sensitivity_below_one(sound, tmp_path):
    def change(columns):
        columns["force"] = 2.0 * columns["force"]
        columns["injection"] = 2.83 * columns["injection"]

    found = changed(sound, tmp_path / "c", "base", change)
    assert any(f.code == "sensitivity" and "below 1, which no loop" in f.message for f in found)
    assert found[0].kind == "contradiction"


@pytest.mark.parametrize("samples", [1, 10])
def test_a_delay_is_named_in_samples(sound, tmp_path, samples):
    found = changed(sound, tmp_path / "c", "base", late("displacement", samples))
    assert "displacement" in found[0].channel and f"late by {samples}" in found[0].message


def test_samples_that_are_missing_are_counted(sound, tmp_path):
    def change(columns):
        for name in columns:
            columns[name] = np.delete(columns[name], slice(12_000, 12_137))

    text = (sound / "campaign.toml").read_text()
    assert "periods = 5" in text
    found = changed(sound, tmp_path / "c", "base", change, lambda t: t.replace("periods = 5", "periods = 4", 2)
                    .replace('time = { from = "time" }\n', ""))  # fmt: skip
    assert found[0].code == "missing samples" and "137 samples are missing between" in found[0].message


def test_a_filter_is_named_with_its_corner(sound, tmp_path):
    a = np.exp(-2 * np.pi * 200 / 20_000)

    def change(columns):
        columns["command"] = lfilter([1 - a], [1, -a], columns["command"])

    found = changed(sound, tmp_path / "c", "base", change)
    assert found[0].code == "filter" and found[0].channel == "command" and found[0].value == pytest.approx(200, rel=0.2)


def test_exchanged_columns_are_found(sound, tmp_path):
    def change(columns):
        columns["command"], columns["current"] = columns["current"], columns["command"]

    found = changed(sound, tmp_path / "c", "base", change)
    assert found[0].code == "swapped" and set(found[0].channel.split(" or ")) == {"command", "current"}


@pytest.mark.slow
def test_currents_of_two_axes_are_exchanged_although_their_amplifiers_are_late(tmp_path):
    sound = campaigns.campaign(tmp_path / "sound", "hmb_radial", effect("amplifier_lag", 5e-5), names=("base",))

    def change(columns):
        columns["current_x"], columns["current_y"] = columns["current_y"], columns["current_x"]

    assert not any(f.code == "swapped" for f in changed(sound, tmp_path / "same", "base", lambda columns: None))
    found = changed(sound, tmp_path / "c", "base", change)
    assert found[0].code == "swapped" and set(found[0].channel.split(" or ")) == {"current_x", "current_y"}


def test_gains_of_another_recording_are_named(sound, tmp_path):
    kp = re.findall(r"kp = ([\d.]+)", (sound / "campaign.toml").read_text())
    kd = re.findall(r"kd = ([\d.]+)", (sound / "campaign.toml").read_text())
    assert kp[0] != kp[1]

    def toml(text):
        return text.replace(f"kp = {kp[0]}", f"kp = {kp[1]}", 1).replace(f"kd = {kd[0]}", f"kd = {kd[1]}", 1)

    found = changed(sound, tmp_path / "c", "base", lambda columns: None, toml)
    # No recording states the true ones now.
    assert found and found[0].channel == "command or displacement or injection or gains"

    def third(text):
        parts = text.split("[[recording]]")
        return "[[recording]]".join([*parts[:2], parts[2], parts[1].replace(f"kp = {kp[0]}", f"kp = {kp[1]}")
                                     .replace(f"kd = {kd[0]}", f"kd = {kd[1]}")])  # fmt: skip

    found = changed(sound, tmp_path / "d", "base", lambda columns: None, third)
    assert found[0].code == "gains" and f"kp = {float(kp[0]):g}" in found[0].message


def test_a_wrong_mass_may_also_be_an_effect(sound, tmp_path):
    found = changed(sound, tmp_path / "c", "base", lambda columns: None,
                    lambda t: t.replace('rig = "hmb_free"', 'rig = "hmb_free"\n[parameters]\nmass = 0.16'))  # fmt: skip
    assert "mass" in found[0].channel and found[0].kind == "effect" and "maglev diagnose" in found[0].message


@pytest.mark.parametrize(
    ("name", "value"),
    [("delay", 7.5e-5), ("amplifier_lag", 1e-4), ("actuator_gain", 0.5), ("mass", 0.4), ("sensor_gain", -0.3)],
)
def test_an_effect_does_not_read_as_a_wiring_error(tmp_path, name, value):
    folder = campaigns.campaign(tmp_path, effects=effect(name, value), names=("base",))
    found = examine(load_campaign(folder))
    assert found and all(f.kind == "effect" and "run `maglev diagnose`" in f.message for f in found)


def test_an_injection_before_a_gain_is_told_although_its_stated_peak_agrees(sound, tmp_path):
    def stated(text):
        base, rest = text.split('file = "gains.npz"')
        return re.sub(
            r'(at = "current".*?amplitude = )([0-9.]+)', lambda m: f"{m[1]}{float(m[2]) / 5}", base, flags=re.S
        ) + ('file = "gains.npz"' + rest)

    (found, *_) = changed(sound, tmp_path / "c", "base", scale("injection", 0.2), stated)
    assert found.channel == "injection" and found.value == pytest.approx(0.2, rel=0.02)
    assert "injection with its stated peak: factor 0.2" in found.message and "a gain lies between" in found.message


def test_gains_that_count_in_a_wrong_unit_leave_the_scale_of_the_reading_open(sound, tmp_path):
    def in_that_unit(text):
        return re.sub(r"^(kp|ki|kd) = (\S+)$", lambda m: f"{m[1]} = {float(m[2]) / 1.5}", text, flags=re.MULTILINE)

    found = changed(sound, tmp_path / "c", "base", scale("displacement", 1.5), in_that_unit)
    (said,) = [f.message for f in found if "mass" in f.channel]
    assert "or the scale of column 'displacement', if the stated gains count in it" in said


@pytest.mark.parametrize(("times", "kind"), [(1e-3, "contradiction"), (0.5, "wiring")])
def test_gains_in_another_unit_contradict_the_recording(sound, tmp_path, times, kind):
    """In A/mm no controller keeps a rotor in the air. Half of them may be those of the day before."""

    def stated(text):
        return re.sub(r"\b(kp|ki|kd) = ([\d.e+-]+)", lambda m: f"{m[1]} = {times * float(m[2])!r}", text)

    found = [f for f in changed(sound, tmp_path / "c", "base", lambda _: None, stated) if "gains" in f.channel]
    assert found and found[0].kind == kind


@pytest.mark.parametrize("stated", [0.5, 1 / 1.5, 1 / 1.2, 2.0])
def test_the_mass_that_is_shown_is_told_without_the_stiffness(dense, tmp_path, stated):
    """A mass of twice the stated one had been said to be 1 / 0.548 +- 0.006 times it: the magnets' stiffness has its
    part in the displacement also where the mass dominates."""
    table = f'rig = "hmb_free"\n[parameters]\nmass = {stated * load_rig("hmb_free").mass!r}'
    found = changed(dense, tmp_path / "c", "base", lambda _: None, lambda t: t.replace('rig = "hmb_free"', table))
    (first,) = [f for f in found if "mass" in f.channel]
    said = re.search(r"(?:stated mass|what is stated) is (\S+) \+- (\S+) times what is shown", first.message)
    value, reach = map(float, said.groups())
    assert value == pytest.approx(stated, rel=0.01) and abs(value - stated) < reach < 0.06 * stated
    if first.channel == "mass":
        assert first.value == pytest.approx(value, rel=5e-3) and first.interval[0] < stated < first.interval[1]


@pytest.mark.parametrize("factor", [1.8, 1 / 1.8])
def test_a_gain_that_is_stated_wrong_is_off_by_its_own_factor_not_by_one_over_it(tmp_path, factor):
    """The recordings are of the wrong gain, the campaign states the preset's: nothing but the force tells."""
    folder = campaigns.campaign(tmp_path, names=("base",), effects=effect("actuator_gain", 1 / factor - 1))
    (found, *_) = [f for f in examine(load_campaign(folder)) if "actuator gain" in f.channel]
    said = re.search(r"what is stated is (\S+) \+- \S+ times what is shown(?: \(actuator gain: (\S+) )?", found.message)
    assert float(said[2] or said[1]) == pytest.approx(factor, rel=0.15)


def test_a_mass_that_is_stated_too_small_to_dominate_anywhere_is_told(tmp_path):
    # The rotor on its pedestal rings for more than one period, of which nothing is said either.
    folder = campaigns.campaign(tmp_path, "pedestal", names=("base",), parameters={"mass": 0.3})
    (found,) = examine(load_campaign(folder))
    assert "mass" in found.channel and found.value == pytest.approx(0.3 / 0.79, rel=0.05)


def test_a_displacement_that_a_filter_left_weak_is_missed_where_the_current_moves_the_rotor(open_folder, tmp_path):
    def change(columns):
        a = np.exp(-2 * np.pi * 20 / 20_000)
        columns["displacement"] = lfilter([1 - a], [1, -a], columns["displacement"])

    found = changed(open_folder, tmp_path / "c", "noise", change)
    assert found[0].code == "filter" and found[0].channel == "displacement"


def test_a_spike_and_a_drift_are_found(sound, tmp_path):
    def change(columns):
        columns["displacement"][13_000] += 1e-4
        columns["current"] = columns["current"] + np.linspace(0, 1, columns["current"].size)

    found = {f.code: f for f in changed(sound, tmp_path / "c", "base", change)}
    assert re.search("a spike of [0-9.e-]+ m at 0.65 s", found["spike"].message)
    assert found["drift"].channel == "current" and found["drift"].value == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize(("channel", "factor"), [("displacement", 2.0), ("current", 0.5), ("command", 2.0)])
def test_a_recording_that_never_repeats_is_checked_too(open_folder, tmp_path, channel, factor):
    found = changed(open_folder, tmp_path / "c", "noise", scale(channel, factor))
    assert channel in found[0].channel and found[0].kind in ("effect", "wiring", "contradiction")


def test_another_rate_than_the_stated_one_is_found(open_folder, tmp_path):
    found = changed(open_folder, tmp_path / "c", "noise", lambda columns: None,
                    lambda t: t.replace("sample_rate = 20000.0", "sample_rate = 10000.0"))  # fmt: skip
    assert found[0].code == "rate" and "20000 Hz" in found[0].message


def test_another_rate_is_found_where_the_amplifier_is_late_besides(tmp_path):
    late_one = bench_loop.write_campaign(tmp_path, bench_loop.Bench(noise=0.5e-6, delay=4e-5), {"noise": "fit"}, 1.5, 4)
    found = changed(late_one, tmp_path / "c", "noise", lambda columns: None,
                    lambda t: t.replace("sample_rate = 20000.0", "sample_rate = 10000.0"))  # fmt: skip
    assert found[0].code == "rate" and "agree at the control rate of 20000 Hz" in found[0].message


def test_the_current_of_another_coil_is_found_and_one_that_rests_in_a_dead_band_is_none(open_folder, tmp_path):
    def another(columns):
        rng = np.random.default_rng(7)
        columns["current"] = columns["current"].std() * rng.normal(size=columns["current"].size)

    found = changed(open_folder, tmp_path / "c", "noise", another)
    assert found[0].code == "mismatch" and found[0].channel == "current" and "another coil" in found[0].message
    found = changed(open_folder, tmp_path / "d", "noise", scale("current", 0.01))
    assert not [f for f in found if "another coil" in f.message]
    assert not [f for f in changed(open_folder, tmp_path / "e", "noise", lambda columns: None) if f.code == "mismatch"]


def test_what_nothing_covers_is_said(sound, tmp_path):
    toml = (sound / "campaign.toml").read_text().split("[[recording]]")[1]
    lines = re.search(r"at = \"force\".*?(?=\n\n)", toml, re.S).group()
    text = f"""schema = "maglev-campaign/1"
[parameters]
mass = 0.08
[[recording]]
file = "base.npz"
sample_rate = 20000.0
[[recording.excitation]]
kind = "multisine"
{lines}
[recording.channels]
force = {{ from = "force" }}
displacement = {{ from = "displacement" }}
"""
    changed(sound, tmp_path / "c", "base", lambda columns: None, lambda _: text)
    (note,) = examine(load_campaign(tmp_path / "c"))
    assert note.kind == "not checkable" and note.message.startswith("not checkable here: time between force and")
    (data,) = as_data([note])
    assert data.keys() == {"code", "recording", "channel", "value", "interval", "message", "kind"}


@pytest.fixture(scope="module")
def identified(sound):
    campaign = load_campaign(sound)
    spec = campaign.recordings[0]
    signals = recorded_signals(campaign, spec, read_recording(campaign, spec))
    return identify(signals, campaign.rig, campaign.mass, band_width=60.0, band_overlap=20.0)


def test_results_that_no_loop_can_have_are_said(identified):
    found = identified
    assert doubtful("base.npz", found) == []
    low = replace(found.stability.margins, peak_sensitivity=0.9, intervals={"peak_sensitivity": (0.8, 0.95)})
    poor = tuple(replace(b, fit_p=1e-9, r2_adjusted=0.5, informative=True, ls_biased=False) for b in found.bands)
    codes = [f.code for f in doubtful("x", replace(found, bands=poor, stability=replace(found.stability, margins=low)))]
    assert codes == ["fit", "sensitivity"]


def test_margins_of_a_contradicted_controller_are_withheld(identified):
    """Gains that count in mm had left "peak sensitivity 1.00 (1.00 .. 1.00)" of a loop with 2.4."""
    found = identified
    assumed = replace(found, stability=replace(found.stability, source="assumes the nominal actuator"))
    finding = Finding("scale", "base.npz", "command or displacement or gains", 0.001, None, "", "wiring")
    for kind, channel, kept in (
        ("wiring", "gains", False), ("effect", "mass or actuator gain", False), ("quality", "gains", True),
        ("wiring", "displacement", True),
    ):  # fmt: skip
        said = as_data([replace(finding, kind=kind, channel=channel)])
        left = without_contradicted_margins("base.npz", assumed, said)
        assert (left.stability is not None) == kept and any("no margins" in note for note in left.notes) != kept
        assert without_contradicted_margins("base.npz", found, said).stability is not None  # they are measured
        assert without_contradicted_margins("other.npz", assumed, said).stability is not None


@pytest.mark.parametrize(
    ("name", "limits", "kind"),
    [
        ("displacement", {"probe_gain": 4.0}, "contradiction"),
        ("command", {"amplifier_gain": 0.5}, "wiring"),
        ("displacement", {"probe_gain": 4.0, "adc_bits": 0, "dac_bits": 14}, "contradiction"),
        ("displacement", {"probe_gain": 4.0, "adc_bits": 0, "dac_bits": 0}, None),
    ],
)
def test_a_reading_beyond_the_range_of_the_converters_is_named(sound, name, limits, kind):
    """The limits are those of the rig's range, as shares of the largest reading: below 1 it is left."""
    campaign = load_campaign(sound)
    spec = campaign.recordings[0]
    signals = recorded_signals(campaign, spec, read_recording(campaign, spec), excited=False)
    (view,) = _views(campaign, spec, signals)
    size, rig = float(np.abs(view.channels[name]).max()), view.rig
    if "probe_gain" in limits:
        limits = limits | {"probe_gain": limits["probe_gain"] * rig.voltage_range / size}
    else:
        limits = limits | {"amplifier_gain": limits["amplifier_gain"] * size / rig.voltage_range}
    assert ranges(view) == []
    found = [f for f in ranges(replace(view, rig=replace(rig, **limits))) if f.channel == name]
    assert [f.kind for f in found] == ([kind] if kind else [])
    assert all(set(limits) - {"adc_bits", "dac_bits"} <= set(re.findall(r"\w+", f.message)) for f in found)


def test_a_loop_with_jittered_ticks_is_compared_at_its_own(open_folder, tmp_path, monkeypatch):
    # The readings of this bench are regular, which would show that its stamps alone jitter.
    monkeypatch.setattr("maglev_env.recordings.recording.regular_stamps", lambda *_: None)
    columns = dict(np.load(open_folder / "noise.npz"))
    size = columns["command"].size
    jitter = np.random.default_rng(2).uniform(-0.2, 0.2, size)
    np.savez(tmp_path / "noise.npz", **columns, time=(np.arange(size) + jitter) / bench_loop.RATE)
    text = (open_folder / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text + '\ntime = { from = "time" }\n')
    campaign = load_campaign(tmp_path)
    dataset = read_recording(campaign, campaign.recordings[0])
    compared = _at_ticks(campaign.recordings[0], dataset)
    for name in compared.data_vars:  # exactly as read, while resampling moves some by more than a converter step
        assert (compared[name].values == columns[name]).all()
        assert not np.isin(dataset[name].values[1:-1], columns[name]).all()
    assert [f.message for f in examine(campaign) if f.kind != "not checkable"] == []


def test_two_wrong_scales_are_named_each_with_its_size(sound, tmp_path):
    def change(columns):
        columns["force"] = 2.0 * columns["force"]
        columns["injection"] = 2.83 * columns["injection"]

    found = changed(sound, tmp_path / "c", "base", change)
    assert [f.channel for f in found[:2]] == ["force", "injection"] and all(f.kind == "contradiction" for f in found)
    assert [f.value for f in found[:2]] == [pytest.approx(2.0, rel=0.01), pytest.approx(2.83, rel=0.01)]
    assert found[0].message.endswith("check the scale of column 'force'")
    assert found[2].code == "sensitivity"


def test_a_displacement_quieter_than_its_sensor_is_told(open_folder, tmp_path):
    found = changed(open_folder, tmp_path / "c", "noise", scale("displacement", 1e-3))
    assert any("moves by" in f.message and f.channel == "displacement" for f in found)


def test_columns_are_not_exchanged_where_an_axis_has_nothing_left_to_compare():
    """A command and a set point that never moves, the other way round: the other axis alone agrees."""
    row = SimpleNamespace(code="amplifier", off=False)
    assert _as_many([row, row], [row, row]) and not _as_many([row], [row, row])


def test_columns_are_not_exchanged_that_no_comparison_is_of():
    """Command and current agree whichever displacement is that of x, if nothing is compared with a displacement."""
    rows = [SimpleNamespace(powers={"current": 1, "command": -1})] * 2
    assert not _compares(rows, "displacement_x", "displacement_y")
    assert _compares(rows, "command_x", "command_y") and _compares(rows, "displacement_x", "current_x")


@pytest.mark.parametrize(("bits", "told"), [(14, True), (8, False)])
def test_a_few_steps_of_a_converter_are_no_spike(tmp_path, bits, told):
    """Where its steps are larger than the noise, a command goes to and fro by single ones now and then."""
    folder = campaigns.campaign(tmp_path, names=("base",), parameters={"dac_bits": bits})
    columns = dict(np.load(folder / "base.npz"))
    columns["current"][13_000] += 0.25
    np.savez(folder / "base.npz", **columns)
    assert any(f.code == "spike" for f in examine(load_campaign(folder))) == told


def test_a_current_that_reverses_a_coil_is_told(tmp_path):
    rig = Rig(
        "coils", "electromagnet_pair", mass=1.0, gap=5e-4, turns=100, pole_area=2e-4, bias_current=1.0,
        control_rate=5000.0, gains=Gains(kp=3e4, ki=0.0, kd=60.0, td=2e-4),
    )  # fmt: skip
    current = np.sin(np.linspace(0, 60, 5000))[None]
    for size, told in ((0.9, False), (1.4, True)):
        view = SimpleNamespace(rig=rig, recorded={"current"}, channels={"current": size * current}, recording="r")
        found = reversed_coils(view)
        assert [f.value for f in found] == ([pytest.approx(1.4, rel=1e-3)] if told else [])
    assert not reversed_coils(SimpleNamespace(rig=load_rig("hmb_free"), recorded={"current"}))


def test_a_force_along_an_axis_that_none_drives_is_not_asked_for(sound):
    """Only noise is in it, of which no amplitude can be stated."""
    campaign = load_campaign(sound)
    spec = campaign.recordings[0]
    signals = recorded_signals(campaign, spec, read_recording(campaign, spec), excited=False)
    (view,) = _views(campaign, spec, signals)
    injected = tuple(e for e in view.excitations if e.at == "current")
    said = [[f.channel for f in uncovered(replace(view, excitations=own), [])] for own in (view.excitations, injected)]
    assert "force" in said[0][0] and "force" not in said[1][0]
