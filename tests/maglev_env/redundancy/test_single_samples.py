"""Single lost readings of a record that never repeats are found; steps, blows and coarse noise are sound."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.redundancy.single_samples import single_samples

RATE, N = 2000.0, 6000
T = np.arange(N) / RATE


def _view(displacement, **others):
    channels = {"displacement": displacement, **others}
    return SimpleNamespace(
        periodic=False, channels=channels, recorded=frozenset(channels), rate=RATE, recording="run", masked=None
    )


def _sound(kind, seed, fine=False):
    rng = np.random.default_rng(seed)
    noise, step = 10 ** rng.uniform(-8, -5.5), 10 ** rng.uniform(-8, -5)
    step = min(step, noise) if fine else step
    heavy = noise * rng.standard_t(4, N)
    if kind == "steps":
        pole = rng.uniform(0.5, 0.99)
        moved = lfilter([1 - pole], [1, -pole], 2e-4 * np.sign(np.sin(2 * np.pi * 3 * T)))
    elif kind == "blows":  # a mode as fast as a fifth of the rate is rung by single blows
        r, angle = rng.uniform(0.7, 0.99), 2 * np.pi * rng.uniform(0.01, 0.2)
        blows = np.where(rng.uniform(size=N) < 0.001, 1e-4 * rng.uniform(0.5, 1.5, N), 0.0)
        moved = lfilter([0, np.sin(angle)], [1, -2 * r * np.cos(angle), r * r], blows)
    elif kind == "chirp":
        moved = 1e-4 * np.sin(2 * np.pi * (1 + 10 * T) * T)
    else:
        moved = np.zeros(N)
    return np.round((moved + 4e-4 + heavy) / step) * step


@pytest.mark.parametrize("kind", ["steps", "blows", "chirp", "rest"])
def test_sound_records_are_not_accused(kind):
    assert not [seed for seed in range(60) if single_samples(_view(_sound(kind, seed)))]


@pytest.mark.parametrize("kind", ["steps", "blows", "chirp", "rest"])
@pytest.mark.parametrize("lost", [0.0, -9.999])
def test_lost_readings_are_found_with_their_time(kind, lost):
    for seed in range(100, 110):
        values = _sound(kind, seed, fine=True)  # one that rests on one level tells no reading from another
        values[[500, 1200, 1900, 2700]] = lost
        (found,) = single_samples(_view(values))
        assert (found.code, found.channel, found.kind) == ("spike", "displacement", "wiring")
        assert "4 single samples, the first at 0.25 s" in found.message


def test_what_a_probe_hears_of_a_step_of_the_current_is_no_lost_reading():
    wanted = np.where(T < 1, 0.0, 2e-4)
    values = _sound("rest", 3)
    at = int(np.flatnonzero(np.diff(wanted))[0]) + 2
    values[at] += 1e-3
    assert single_samples(_view(values)) and not single_samples(_view(values, reference=wanted))


def test_nothing_is_said_beside_samples_that_are_bridged():
    values = _sound("rest", 3)
    values[700] = 0.0
    view = _view(values)
    assert single_samples(view)
    view.masked = np.arange(N) == 701
    assert not single_samples(view)
