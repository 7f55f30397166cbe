"""What comes at single moments between periods is said; noise, a drift and what the drive modulates are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.bursts import bursts
from sim2real.recorded.records import Record

RIG = load_rig("hmb_free")
PERIODS, SAMPLES, RATE = 4, 2048, 4096.0
SEEDS = range(40)


class Experiment:
    recorded_per_period = SAMPLES
    recorded_rate = RATE


def record(series: np.ndarray, rig=RIG) -> Record:
    return Record("rec1.csv", "fit", rig, Experiment(), *[None] * 5, {"displacement": series[None]}, 0.5, 1, ())


@pytest.fixture(autouse=True)
def counted(monkeypatch):
    monkeypatch.setattr(Record, "count", PERIODS)


def noise(seed: int, pole: float = 0.9) -> np.ndarray:
    """As of a loop: coloured; far above the step of the converter."""
    return 1e-6 * lfilter([1.0], [1, -pole], np.random.default_rng(seed).normal(size=PERIODS * SAMPLES))


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.98])
def test_noise_shows_no_bursts(pole):
    assert not any(bursts([record(noise(seed, pole))]) for seed in SEEDS)


def test_neither_a_drift_nor_noise_that_the_drive_modulates_is_one():
    turn = 2 * np.pi * np.arange(PERIODS * SAMPLES) / SAMPLES
    drift = 2e-6 * np.arange(PERIODS * SAMPLES) / SAMPLES * np.sin(3 * turn)
    modulated = 1 + 4 * (np.sin(turn) > 0.8)
    for seed in SEEDS:
        assert not bursts([record(noise(seed) + drift)]) and not bursts([record(noise(seed) * modulated)])


def test_the_steps_of_a_coarse_converter_are_none():
    rig = replace(RIG, adc_bits=8)
    slow = 0.3 * rig.reading_step * np.sin(2 * np.pi * 0.377 * np.arange(PERIODS * SAMPLES) / SAMPLES)
    stepped = rig.reading_step * np.round((slow + 0.1 * noise(1)) / rig.reading_step + 0.4)
    assert not bursts([record(stepped, rig)])


def test_knocks_are_told_with_their_times():
    at = (700, 3000, 6500)
    for seed in SEEDS:
        knocked = noise(seed)
        for i in at:
            knocked[i : i + 64] += 5e-5
        (found,) = bursts([record(knocked)])
        assert len(found.times) == 3 and found.power > 20
        assert found.times == pytest.approx([0.5 + i / RATE for i in at], abs=64 / RATE)
        assert found.in_words().startswith(
            "rec1.csv: the displacement differs from period to period in 3 bursts (at 0.6"
        )


def test_one_knock_alone_is_not_said():
    knocked = noise(0)
    knocked[700:764] += 5e-5
    assert not bursts([record(knocked)])


@pytest.mark.filterwarnings("error")
def test_where_nothing_scatters_nothing_is_told():
    rig = replace(RIG, adc_bits=0)
    periodic = np.tile(np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES), PERIODS)
    assert bursts([record(periodic, rig)]) == []
    knocked = periodic.copy()
    knocked[700:764] += 1.0
    assert bursts([record(knocked, rig)]) == []
