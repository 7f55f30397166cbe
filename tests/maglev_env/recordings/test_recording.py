import json
import shutil
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from estimation.multisine.sphs import random_phase, sphs, synthesise
from maglev_env.channels import MEASURED
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains, LinearController
from maglev_env.recordings.campaign import ChannelSource, load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.files import write_csv, write_npz
from maglev_env.recordings.masking import clipped_samples
from maglev_env.recordings.recording import read_recording, simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import RIG_FOLDER, load_rig


def short(name: str, **changes) -> Experiment:
    experiment = protocol_experiment(load_rig(name), seed=3)
    quick = tuple(replace(e, fundamental=10.0, lines=e.lines[:20]) for e in experiment.excitations)
    return replace(experiment, **{"excitations": quick, "periods": 2, "transient_periods": 1, **changes})


def simulate(experiment: Experiment):
    return simulated_recording(experiment, simulate_records([experiment])[0])


@pytest.fixture(scope="module")
def free():
    experiment = short("hmb_free", effects=effect("delay", 5e-5), offset=1e-6)
    return experiment, simulate(experiment)


@pytest.fixture(scope="module")
def pedestal():
    experiment = short("pedestal")
    return experiment, simulate(experiment)


def test_simulated_recordings_are_labelled(free, pedestal):
    experiment, dataset = free
    assert dataset.sizes == {"time": 6000}
    assert set(dataset.data_vars) == {*MEASURED, "injection", "reference"}
    assert {v: dataset[v].attrs["units"] for v in ("displacement", "force", "injection", "reference")} == {
        "displacement": "m",
        "force": "N",
        "injection": "A",
        "reference": "m",
    }
    assert all(dataset[v].dtype == np.float64 for v in dataset.data_vars)
    np.testing.assert_allclose(dataset["time"], np.arange(6000) / 20_000)
    np.testing.assert_array_equal(dataset["reference"], 1e-6)
    injection = experiment.excitations[1].waveform(20_000)
    np.testing.assert_array_equal(dataset["injection"].values.reshape(3, -1), [injection] * 3)
    made = json.loads(dataset.attrs["experiment"])
    assert made["rig"] == "hmb_free" and made["effects"] == {"delay": {"time": 5e-5}} and made["seed"] == 3
    assert made["periods"] == 3 and made["transient_periods"] == 1 and made["gains"]["kp"] == 8000 and made["version"]
    assert set(pedestal[1].data_vars) == {"displacement", "force"}
    assert json.loads(pedestal[1].attrs["experiment"])["gains"] is None


def test_simulated_records_must_fit_their_experiment(free):
    experiment, dataset = free
    with pytest.raises(ValueError, match="shape"):
        simulated_recording(experiment, np.zeros((2, 6000)))
    record = np.array([dataset[c].values for c in MEASURED])
    record[:, 1234:] = np.nan
    with pytest.raises(ValueError, match=r"touched down at 0\.0617 s \(sample 1234\)"):
        simulated_recording(experiment, record)


@pytest.mark.parametrize("data_format", ["npz", "mat", "csv"])
def test_a_written_campaign_reads_back_bit_for_bit(tmp_path, free, data_format):
    experiment, dataset = free
    parameters = {"mass": 0.081, "turns": 91}
    recordings = [("a", "fit", dataset, experiment), ("b-2", "holdout", dataset, experiment)]
    path = write_campaign(tmp_path / "new", "hmb_free", parameters, recordings, data_format)
    assert path == tmp_path / "new" / "campaign.toml"
    campaign = load_campaign(path.parent)
    assert campaign.rig == with_parameters(load_rig("hmb_free"), parameters)
    assert [(r.file, r.role) for r in campaign.recordings] == [
        (f"a.{data_format}", "fit"),
        (f"b-2.{data_format}", "holdout"),
    ]
    for spec in campaign.recordings:
        assert spec.gains == experiment.gains and spec.excitations == experiment.excitations and spec.periods == 3
        assert spec.intersample == "zoh"
        read = read_recording(campaign, spec)
        assert list(read.data_vars) == list(dataset.data_vars)
        for name in (*dataset.data_vars, "time"):
            assert read[name].values.tobytes() == dataset[name].values.tobytes()
            assert read[name].attrs == dataset[name].attrs
        assert (read.attrs["file"], read.attrs["role"]) == (spec.file, spec.role)
        made, written = json.loads(read.attrs["experiment"]), json.loads(dataset.attrs["experiment"])
        assert made.items() <= written.items()
        assert not {"effects", "seed", "offset"} & set(made)  # the file holds what an engineer knows


def test_a_users_rig_is_copied(tmp_path, pedestal):
    experiment, dataset = pedestal
    source = tmp_path / "mine.toml"
    shutil.copy(resources.files("maglev_env") / "rigs" / "pedestal.toml", source)
    write_campaign(tmp_path / "c", str(source), {}, [("a", "fit", dataset, experiment)])
    source.unlink()
    campaign = load_campaign(tmp_path / "c")
    assert campaign.rig == load_rig("pedestal") and campaign.recordings[0].gains is None
    read_recording(campaign, campaign.recordings[0])


def test_the_writer_refuses_what_the_reader_would(tmp_path, pedestal):
    experiment, dataset = pedestal
    one = [("a", "fit", dataset, experiment)]
    write_campaign(tmp_path, "pedestal", {}, one)
    before = (tmp_path / "campaign.toml").read_text()
    with pytest.raises(ValueError, match=r"campaign\.toml exists"):
        write_campaign(tmp_path, "pedestal", {}, one)
    for taken, source in (("a.npz", "pedestal"), ("rig.toml", str(RIG_FOLDER / "pedestal.toml"))):
        folder = tmp_path / Path(taken).stem
        folder.mkdir()
        (folder / taken).write_text("measured")
        with pytest.raises(ValueError, match=f"{taken} exists and would be replaced"):
            write_campaign(folder, source, {}, one)
        assert [file.name for file in folder.iterdir()] == [taken] and (folder / taken).read_text() == "measured"
    for recordings, parameters, data_format, word in (
        ([], {}, "npz", "at least one recording"),
        ([("../a", "fit", dataset, experiment)], {}, "npz", "'../a'"),
        ([*one, *one], {}, "npz", "'a' is used twice"),
        ([("a", "train", dataset, experiment)], {}, "npz", "role = 'train'"),
        ([("a", "fit", dataset.rename(force="thrust"), experiment)], {}, "npz", "unknown key 'thrust'"),
        (one, {"weight": 1}, "npz", "unknown key 'weight'"),
        (one, {}, "xls", "data_format = 'xls'"),
    ):
        with pytest.raises(ValueError, match=word):
            write_campaign(tmp_path, "pedestal", parameters, recordings, data_format, overwrite=True)
    assert (tmp_path / "campaign.toml").read_text() == before
    write_campaign(tmp_path, "pedestal", {"mass": 0.8}, one, overwrite=True)
    assert load_campaign(tmp_path).mass == 0.8


N, LINES = 500, (1, 2, 5, 9)
FORCE = np.tile(Excitation("sphs", "force", 2.0, LINES, 3.0).waveform(1000.0), 4)
Y = np.random.default_rng(0).normal(size=FORCE.size)
EXCITATION = 'excitation = { kind = "sphs", fundamental = 2.0, lines = [1, 2, 5, 9], amplitude = 3.0 }'
HEAD = f"""schema = "maglev-campaign/1"
parameters = {{ mass = 1.0 }}
[[recording]]
file = "r.npz"
role = "fit"
sample_rate = 1000.0
{EXCITATION}
"""
SOURCES = '[recording.channels]\nforce = { from = "F" }\ndisplacement = { from = "y" }\n'


def read(folder: Path, columns=None, head=HEAD, sources=SOURCES):
    write_npz(folder / "r.npz", {"y": Y, "F": FORCE}) if columns is None else np.savez(folder / "r.npz", **columns)
    (folder / "campaign.toml").write_text(head + sources)
    campaign = load_campaign(folder)
    return read_recording(campaign, campaign.recordings[0])


def test_scaled_weighted_channels_and_the_window(tmp_path):
    columns = {"y": Y, "z": 2 * Y + 1, "F": FORCE}
    sources = SOURCES.replace('"y" }', '["y", "z"], weights = [0.5, 0.25], scale = -2.0, offset = 3.0 }')
    head = HEAD.replace("role", "start = 30\nsamples = 1010\nspeed_rpm = 60.0\nrole")
    dataset = read(tmp_path, columns, head, sources)
    np.testing.assert_allclose(dataset["displacement"], (-2 * (0.5 * Y + 0.25 * (2 * Y + 1)) + 3)[30:1040])
    np.testing.assert_array_equal(dataset["force"], FORCE[30:1040])
    assert dataset["time"].values[0] == 0 and dataset.attrs["sample_rate"] == 1000.0
    made = json.loads(dataset.attrs["experiment"])
    assert made["periods"] == 2 and made["speed_rpm"] == 60.0 and made["gains"] is None and "rig" not in made
    assert made["excitations"][0]["lines"] == list(LINES)


def test_recorded_excitation_and_gains_and_none(tmp_path):
    head = HEAD.replace(EXCITATION, 'excitation = { kind = "recorded" }\ngains = { kp = 1.0, ki = 0.0, kd = 0.1 }')
    dataset = read(tmp_path, {"F": np.sin(np.arange(40.0) ** 2), "y": Y[:40]}, head)
    made = json.loads(dataset.attrs["experiment"])
    assert made["periods"] is None and Gains(**made["gains"]) == Gains(1.0, 0.0, 0.1)
    head = HEAD.replace(EXCITATION, 'excitation = { kind = "none" }')
    read(tmp_path, {"F": np.zeros(40), "y": Y[:40]}, head)  # nothing is excited: a quiet force is no error


def changed(values, at, value):
    values = np.array(values)
    values[at] = value
    return values


TIME = np.arange(Y.size) / 1000
MANY = slice(700, 730)  # more samples than can be masked
WITH_TIME = SOURCES + 'time = { from = "t" }\n'


@pytest.mark.parametrize(
    ("columns", "head", "sources", "words"),
    [
        ({"y": Y}, {}, SOURCES, ["there is no column 'F'", "Available: y", "channel 'force'"]),
        ({"F": FORCE, "y": Y.astype(str)}, {}, SOURCES, ["column 'y'", "not real numbers", "channel 'displacement'"]),
        ({"F": FORCE, "y": changed(Y, MANY, np.nan)}, {}, SOURCES, ["column 'y': 30 of 2000", "0.7 s (sample 700)"]),
        ({"F": changed(FORCE, MANY, -np.inf), "y": Y}, {}, SOURCES, ["column 'F'", "start = 730, samples = 1270"]),
        ({"F": FORCE, "y": Y[:-1]}, {}, SOURCES, ["channel 'displacement'", "1999 samples", "'F' 2000"]),
        ({"F": FORCE[:999], "y": Y[:999]}, {}, SOURCES, ["2.00 periods of 500", "at least two whole periods"]),
        (None, {"role": "start = 2000\nrole"}, SOURCES, ["start = 2000", "beyond the file's 2000 samples"]),
        (None, {"role": "start = 600\nsamples = 1401\nrole"}, SOURCES, ["start = 600 and samples = 1401", "2000"]),
        (None, {"3.0 }": "3.0, periods = 5 }"}, SOURCES, ["samples = 2500 (5 periods of 500)", "2000 samples"]),
        ({"F": FORCE, "y": 0 * Y + 2.5}, {}, SOURCES, ["displacement is 2.5 m in every sample while force moves"]),
        ({"F": 0 * FORCE, "y": Y}, {}, SOURCES, ["channel 'force' is 0 in every sample"]),
        ({"F": FORCE, "y": Y}, {"[1, 2, 5, 9]": "[1, 2, 5, 7, 8]"}, SOURCES, ["line 7 (14 Hz)", "2 of 5", "'force'"]),
        ({"F": Y, "y": FORCE}, {}, SOURCES, ["channel 'force': no excitation at line"]),
        (
            {"F": FORCE, "y": Y, "t": TIME + (TIME > 1.2) * 0.1},
            {},
            WITH_TIME,
            ["100 samples are missing after 1.2 s (sample 1200)", "use start = 0, samples = 1201"],
        ),
        (
            {"F": FORCE, "y": Y, "t": TIME - (TIME > 1.2) * 0.1},
            {},
            WITH_TIME,
            ["time runs backward after 1.2 s (sample 1200)", "samples = 1200"],
        ),
        ({"F": FORCE, "y": Y, "t": TIME * 1.05}, {}, WITH_TIME, ["channel 'time': mean rate 952.38095 Hz", "1000 Hz"]),
        (
            {"F": FORCE, "y": Y, "t": TIME * 1.0005},
            {},
            WITH_TIME,
            ["channel 'time': mean rate 999.50025 Hz", "1000 Hz"],
        ),
        ({"F": FORCE, "y": Y, "t": changed(TIME, MANY, np.nan)}, {}, WITH_TIME, ["column 't': 30 of 2000 values"]),
        (
            {"F": FORCE, "y": np.clip(np.round(100 * FORCE), -250, 999)},
            {},
            SOURCES,
            ["channel 'displacement' (column 'y')", "clipped at -250 from", "% of the samples"],
        ),
    ],
)
def test_each_error_names_file_channel_and_sample(tmp_path, columns, head, sources, words):
    text = HEAD
    for old, new in head.items():
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(ValueError) as error:
        read(tmp_path, columns, text, sources)
    for word in [str(tmp_path / "r.npz"), *words]:
        assert word in str(error.value)


def test_samples_are_counted_from_the_start_of_the_file(tmp_path):
    head = HEAD.replace("role", "start = 500\nrole")
    read(tmp_path, {"F": FORCE, "y": changed(Y, 499, np.nan)}, head)
    with pytest.raises(ValueError, match=r"sample 1700\)"):
        read(tmp_path, {"F": FORCE, "y": changed(Y, slice(1700, 1730), np.nan)}, head)
    with pytest.raises(ValueError, match=r"1000 samples are missing after 0.3 s \(sample 800\)"):
        read(tmp_path, {"F": FORCE, "y": Y, "t": TIME + (TIME > 0.8)}, head, WITH_TIME)


def test_a_noisy_time_base_within_a_percent_is_accepted(tmp_path):
    jitter = np.random.default_rng(1).uniform(-4e-6, 4e-6, TIME.size)
    dataset = read(tmp_path, {"F": FORCE, "y": Y, "t": TIME + 7.5 + jitter}, HEAD, WITH_TIME)
    assert "time" not in dataset.data_vars and dataset["time"].values[0] == 0


def test_clipping_of_one_of_two_averaged_probes(tmp_path):
    clipped = np.clip(FORCE, None, 2.0)
    sources = SOURCES.replace('"y" }', '["y", "z"], weights = [0.5, 0.5] }')
    with pytest.raises(ValueError, match=r"channel 'displacement' \(column 'z'\) is clipped at 2 "):
        read(tmp_path, {"F": FORCE, "y": Y, "z": clipped}, HEAD, sources)


def test_csv_text_names_the_sample_and_the_channel(tmp_path):
    write_csv(tmp_path / "r.csv", {"F": FORCE, "y": Y})
    lines = (tmp_path / "r.csv").read_text().splitlines()
    lines[18:48] = ["1.0,oops"] * 30
    (tmp_path / "r.csv").write_text("\n".join(lines))
    (tmp_path / "campaign.toml").write_text((HEAD + SOURCES).replace("npz", "csv"))
    campaign = load_campaign(tmp_path)
    with pytest.raises(
        ValueError, match=r"r\.csv: column 'y': 'oops' in line 19 \(sample 17\) is not a number \(channel 'displ"
    ):
        read_recording(campaign, campaign.recordings[0])


def test_a_start_up_in_the_first_period_is_no_missing_excitation(tmp_path):
    force = FORCE + np.random.default_rng(2).normal(scale=0.01, size=FORCE.size)
    force[:250] = 0
    read(tmp_path, {"F": force, "y": Y})


def test_overflowing_scales_are_found(tmp_path):
    campaign = load_campaign(_written(tmp_path))
    spec = campaign.recordings[0]
    channels = {**spec.channels, "displacement": ChannelSource(("y",), (1.0,), 1e308, 0.0)}
    with pytest.raises(ValueError, match=r"channel 'displacement': sample \d+ is not a finite number"):
        read_recording(campaign, replace(spec, channels=channels))


def _written(folder: Path) -> Path:
    read(folder)
    return folder


@settings(max_examples=60, deadline=None)
@given(
    samples=st.sampled_from([512, 1000, 5000]),
    last=st.integers(1, 150),
    seed=st.integers(0, 1000),
    schroeder=st.booleans(),
    bits=st.sampled_from([3, 5, 8, 12, 16]),
    noise=st.sampled_from([0.0, 1e-4, 1e-2]),
    offset=st.floats(-1, 1),
)
@example(samples=512, last=14, seed=200, schroeder=False, bits=8, noise=1e-4, offset=-0.7583305700127321)  # a flat peak
def test_quantised_multisines_and_sines_are_not_clipped(samples, last, seed, schroeder, bits, noise, offset):
    for lines in (np.arange(1, last + 1), [last]):
        design = sphs(lines, samples) if schroeder else random_phase(lines, samples, seed)
        signal = np.tile(synthesise(design, samples), 3) + offset
        signal = signal + noise * np.random.default_rng(seed).normal(size=signal.size)
        step = 4 / 2**bits
        assert not clipped_samples(np.round(signal / step) * step).any()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    level=st.floats(0.3, 0.9),
    bits=st.sampled_from([12, 16, 60]),
    sign=st.sampled_from([-1, 1]),
)
def test_a_clipped_multisine_is_found(seed, level, bits, sign):
    signal = np.tile(synthesise(random_phase(np.arange(1, 41), 5000, seed), 5000), 3)
    top = level * signal.max()
    step = 4 / 2**bits
    clipped = sign * np.round(np.minimum(signal, top) / step) * step
    at = clipped_samples(clipped)
    assert at.any() and np.unique(clipped[at]).size == 1 and abs(at.mean() - (signal >= top).mean()) < 5e-3


SLANTED = (
    Excitation("low_crest", "force", 10.0, tuple(range(1, 21)), 1.5, seed=7, direction=30.0),
    Excitation("multisine", "current", 10.0, (22, 24, 30), 0.05, seed=8, direction=-45.0),
    Excitation("sphs", "current", 10.0, (23, 25), 0.05, direction=90.0),
)
PAIRS = {
    "one controller": Gains(8000.0, 2000.0, 5.2),
    "gains of each axis": (Gains(8000.0, 2000.0, 5.2), Gains(9000.0, 2000.0, 6.0, 2e-4)),
    "a filter for both": LinearController((1e4, -8.7e3, 1 / 3), (1.0, -0.5, 0.1)),
    "filters": (LinearController((1e4,), (1.0, -0.1)), LinearController((1.0, 2.0), (1.0, 0.0, 1 / 7))),
}


@pytest.fixture(scope="module")
def radial():
    experiment = short("hmb_radial", excitations=SLANTED, gains=PAIRS["gains of each axis"], offset=1e-6)
    return experiment, simulate(experiment)


def test_simulated_x_y_recordings_have_every_channel_of_both_axes(radial):
    experiment, dataset = radial
    names = [f"{name}_{axis}" for name in (*MEASURED, "injection", "reference") for axis in "xy"]
    assert list(dataset.data_vars) == names and dataset.sizes == {"time": 6000}
    assert dataset["force_y"].attrs["units"] == "N" and dataset["injection_x"].attrs["units"] == "A"
    slanted, across, y = (e.waveform(20_000.0) for e in SLANTED)
    injected = dataset["injection_x"].values.reshape(3, -1), dataset["injection_y"].values.reshape(3, -1)
    np.testing.assert_allclose(injected[0], [np.sqrt(0.5) * across] * 3, atol=1e-15)
    np.testing.assert_allclose(injected[1], [y - np.sqrt(0.5) * across] * 3, atol=1e-15)
    force = np.array([dataset[f"force_{axis}"].values for axis in "xy"])
    noise = force - np.outer([np.sqrt(0.75), 0.5], np.tile(slanted, 3))
    assert np.abs(noise.std(axis=1) / experiment.rig.noise.force - 1).max() < 0.05  # and nothing else
    assert abs(np.corrcoef(noise)[0, 1]) < 0.05
    np.testing.assert_array_equal(dataset["reference_x"], 1e-6)
    assert not dataset["reference_y"].values.any()
    made = json.loads(dataset.attrs["experiment"])
    assert made["gains"]["y"] == {"kp": 9000.0, "ki": 2000.0, "kd": 6.0, "td": 2e-4, "ti": 0.0318}


@pytest.mark.parametrize("data_format", ["npz", "mat", "csv"])
@pytest.mark.parametrize("controllers", PAIRS)
def test_an_x_y_campaign_reads_back_bit_for_bit(tmp_path, radial, data_format, controllers):
    experiment, dataset = radial
    experiment = replace(experiment, gains=PAIRS[controllers])
    campaign = load_campaign(
        write_campaign(tmp_path, "hmb_radial", {}, [("a", "fit", dataset, experiment)], data_format)
    )
    (spec,) = campaign.recordings
    assert spec.gains == PAIRS[controllers] and spec.excitations == SLANTED and spec.periods == 3
    read = read_recording(campaign, spec)
    assert list(read.data_vars) == list(dataset.data_vars)
    for name in (*dataset.data_vars, "time"):
        assert read[name].values.tobytes() == dataset[name].values.tobytes()
        assert read[name].attrs == dataset[name].attrs


@pytest.mark.parametrize(("rate", "samples"), [(8000.0, 2400), (1000.0, 300)])
def test_a_recording_at_another_rate_reads_back(tmp_path, rate, samples):
    """Between and at the control samples: the same motion, the waveforms repeated or left out."""
    controlled = short(
        "pedestal", rig=with_parameters(load_rig("pedestal"), {"control_rate": 4000.0}), sample_rate=rate
    )
    dataset, base = simulate(controlled), simulate(replace(controlled, sample_rate=None))
    assert dataset.sizes == {"time": samples} and dataset.attrs["sample_rate"] == rate
    np.testing.assert_allclose(np.diff(dataset["time"]), 1 / rate)
    recordings = [("a", "fit", dataset, controlled)]
    campaign = load_campaign(write_campaign(tmp_path, "pedestal", {"control_rate": 4000.0}, recordings))
    (spec,) = campaign.recordings
    assert spec.samples_per_period * 3 == samples and spec.periods == 3
    read = read_recording(campaign, spec)
    every, repeat = (4, 1) if rate < 4000 else (1, 2)
    noise = controlled.rig.noise
    for name, rms in (("displacement", noise.displacement), ("force", noise.force)):
        np.testing.assert_array_equal(read[name], dataset[name])
        same, expected = read[name].values[::repeat], base[name].values[::every]
        assert np.abs(same - expected).max() < 8 * rms < 0.1 * np.abs(expected).max()


def test_the_rotor_moves_on_between_control_samples():
    quiet = short("pedestal", rig=with_parameters(load_rig("pedestal"), {"control_rate": 4000.0, "adc_bits": 32}))
    quiet = replace(quiet, rig=replace(quiet.rig, noise=replace(quiet.rig.noise, displacement=1e-15, force=0.0)))
    base, fine = simulate(quiet), simulate(replace(quiet, sample_rate=8000.0))
    moved = fine["displacement"].values
    np.testing.assert_allclose(moved[::2], base["displacement"], atol=2e-5 * np.abs(moved).max())
    between = moved[1:-1:2] - (moved[:-2:2] + moved[2::2]) / 2  # a straight line, but for h^2 / 2 of the acceleration
    assert 0 < np.abs(between).max() < 1e-2 * np.abs(moved).max()
    np.testing.assert_array_equal(fine["force"].values.reshape(-1, 2), base["force"].values[:, None].repeat(2, axis=1))


def test_a_recorded_excitation_is_written_with_its_direction_and_band(tmp_path, radial):
    experiment, dataset = radial
    noise = Excitation("recorded", direction=30.0, band=(10.0, 200.0))
    described = replace(experiment, excitations=(noise,))
    campaign = load_campaign(write_campaign(tmp_path, "hmb_radial", {}, [("a", "fit", dataset, described)]))
    assert campaign.recordings[0].excitations == (noise,)
