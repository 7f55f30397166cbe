"""Jittered clocks, masked samples and fundamentals that do not divide the rate."""

import numpy as np
import pytest

from maglev_env.recordings.alarms.alarm import alarms_of
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.files import write_npz
from maglev_env.recordings.formats.time_stamps import check_clock
from maglev_env.recordings.masking import bridged, masked_periods, masked_samples
from maglev_env.recordings.quality import recording_quality
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import record_spectra
from maglev_env.rig.excitation import Excitation

HEAD = """schema = "maglev-campaign/1"
parameters = {{ mass = 1.0 }}
[[recording]]
file = "r.npz"
sample_rate = 1000.0
excitation = {excitation}
[recording.channels]
force = {{ from = "F" }}
displacement = {{ from = "y" }}
"""
PERIODIC = '{ kind = "sphs", fundamental = 7.0, lines = [1, 2, 3, 5], amplitude = 3.0 }'


def read(folder, columns, excitation=PERIODIC, more="", alarmed=False):
    write_npz(folder / "r.npz", columns)
    (folder / "campaign.toml").write_text(HEAD.format(excitation=excitation) + more)
    campaign = load_campaign(folder)
    (spec,) = campaign.recordings
    dataset = read_recording(campaign, spec, alarmed)
    return dataset, recorded_signals(campaign, spec, dataset, excited=False), spec


def periodic(samples=8000, noise=1e-3, seed=0):
    """A force of 7 Hz, whose period is 142.86 samples, and a displacement of 2 m/N that is late by 10 ms."""
    t, rng = np.arange(samples) / 1000, np.random.default_rng(seed)
    force = sum(np.cos(2 * np.pi * 7 * n * t + n**2) for n in (1, 2, 3, 5))
    late = sum(2 * np.cos(2 * np.pi * 7 * n * (t - 0.01) + n**2) for n in (1, 2, 3, 5))
    return t, force, late + noise * rng.standard_normal(samples)


def test_a_fundamental_that_does_not_divide_the_rate_uses_the_smallest_block(tmp_path):
    _, force, y = periodic()
    _, signals, spec = read(tmp_path, {"F": force, "y": y})
    assert spec.samples_per_period == 1000
    found = record_spectra(signals)
    np.testing.assert_allclose(found.force.frequency, [7, 14, 21, 35])
    response = found.force.amplitude("displacement") / found.force.amplitude("force")
    np.testing.assert_allclose(response, 2 * np.exp(-2j * np.pi * found.force.frequency * 0.01), atol=1e-3)


def test_blocks():
    assert Excitation("sphs", fundamental=10.0, lines=(1,)).block(1000.0) == (100, 1)
    seven = Excitation("sphs", fundamental=7.0, lines=(1, 3))
    assert seven.block(1000.0) == (1000, 7)
    assert seven.on_grid(1000.0).lines == (7, 21) and seven.on_grid(1000.0).samples_per_period(1000.0) == 1000
    n = np.arange(1000)
    wave = seven.on_grid(1000.0).waveform(1000.0)
    assert abs(np.fft.rfft(wave)[[7, 21]]).min() > 100 and n.size == wave.size
    with pytest.raises(ValueError, match=r"Hz would fit \(707 samples\)"):
        Excitation("sphs", fundamental=np.sqrt(2), lines=(1,)).block(1000.0)


def test_periods_with_masked_samples_are_left_out(tmp_path):
    _, force, y = periodic()
    y = np.where((np.arange(y.size) > 4200) & (np.arange(y.size) < 4230), y.max() * 1.2, y)
    dataset, signals, _ = read(tmp_path, {"F": force, "y": y})
    masked = masked_samples(dataset)
    assert 0 < masked.mean() < 0.01 and set(np.flatnonzero(masked) // 1000) == {4} == set(signals.left_out)
    assert any("spectra leave them out" in note for note in signals.assumed)
    assert [a.code for a in alarms_of(dataset)] == ["rail"]
    quality = recording_quality(signals, alarms=alarms_of(dataset))
    assert "good" not in {b.verdict for b in quality.bands}
    assert not any(v.startswith("yes") for v in quality.can.values())


def test_masks():
    masked = np.zeros(600, bool)
    masked[150] = True
    assert masked_periods(masked, 100) == (1,) and masked_periods(masked, 150) == ()
    np.testing.assert_allclose(bridged(np.arange(600.0) * ~masked, masked), np.arange(600.0))


def test_a_jittered_clock_is_resampled_and_said(tmp_path):
    rng = np.random.default_rng(1)
    t = (np.arange(8000) + rng.uniform(-0.15, 0.15, 8000)) / 1000
    force = sum(np.cos(2 * np.pi * 7 * n * t + n**2) for n in (1, 2, 3, 5))
    y = sum(2 * np.cos(2 * np.pi * 7 * n * (t - 0.01) + n**2) for n in (1, 2, 3, 5))
    dataset, signals, _ = read(tmp_path, {"F": force, "y": y, "t": t}, more='time = { from = "t" }\n')
    assert any("jitter by" in note and "resampled at 1000 Hz" in note for note in dataset.attrs["notes"])
    found = record_spectra(signals).force
    phase = np.angle(found.amplitude("displacement") / found.amplitude("force"))
    np.testing.assert_allclose(phase, np.angle(np.exp(-2j * np.pi * found.frequency * 0.01)), atol=2e-3)


def test_stamps_that_are_only_rounded_are_a_regular_clock():
    t = np.arange(5000) / 300
    assert check_clock(np.round(t, 3), 300.0).instants is None
    assert check_clock(t, 300.0).instants is None
    coarse = np.round(np.arange(5000) * 0.001768, 3)
    assert check_clock(coarse, 565.6).instants is None
    (note,) = check_clock(coarse, 565.75).notes
    assert "ppm off" in note
    with pytest.raises(ValueError, match="mean rate 565"):
        check_clock(coarse, 566.0)


def test_few_missing_samples_are_bridged_and_masked(tmp_path):
    t, force, y = periodic(noise=0)
    keep = np.delete(np.arange(8000), [3210, 3211])
    columns = {"F": force[keep], "y": y[keep], "t": t[keep]}
    dataset, signals, _ = read(tmp_path, columns, more='time = { from = "t" }\n')
    assert dataset.sizes["time"] == 8000
    np.testing.assert_array_equal(np.flatnonzero(masked_samples(dataset)), [3210, 3211])
    np.testing.assert_allclose(dataset["displacement"], y, atol=3e-2)
    (alarm,) = alarms_of(dataset)
    assert alarm.severity == "warning" and alarm.time == pytest.approx(3.209) and signals.left_out == (3,)


def test_quality_of_a_recording_that_nothing_excites(tmp_path):
    rng = np.random.default_rng(2)
    columns = {"F": rng.standard_normal(3000), "y": rng.standard_normal(3000)}
    _, signals, _ = read(tmp_path, columns, excitation='{ kind = "none" }')
    quality = recording_quality(signals)
    assert (
        quality.periods == 0 and not quality.bands and {c.name for c in quality.channels} == {"force", "displacement"}
    )
    assert {"estimate", "diagnose", "tune"} <= quality.can.keys() and all(
        v.startswith("no") for v in quality.can.values()
    )


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (np.zeros(50), "repeat the one before"),
        (np.append(np.arange(49) * 1e-3, 1e308), "reach from 0 to 1e\\+308 s"),
        (np.append(np.arange(49) * 1e-3, 1e4), "more than 99 would be missing"),
    ],
)
def test_stamps_that_are_no_clock_are_refused(stamps, words):
    with pytest.raises(ValueError, match=words):
        check_clock(stamps, 1000.0)


def test_two_clocks_that_differ_a_little_are_said_and_no_other_rate():
    """Crystals differ by a hundred parts per million. A controller samples by its own."""
    ticks = np.arange(20_000) / 1000.0
    clock = check_clock(ticks / 1.000138, 1000.0)
    assert clock.instants is None and clock.notes == (
        "by its stamps the rate is +138 ppm off: rows are taken as ticks of 1000 Hz",
    )
    assert check_clock(ticks / 1.00005, 1000.0).notes == ()
    with pytest.raises(ValueError, match=r"mean rate 1000\.4 Hz, not sample_rate = 1000 Hz; state the one"):
        check_clock(ticks / 1.0004, 1000.0)
