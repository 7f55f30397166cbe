"""Force and displacement alone, of rotors that a controller holds of which nothing is known: closed-form loops."""

import numpy as np
import pytest

from maglev_env.redundancy.coverage import uncovered
from maglev_env.redundancy.explained import explained
from maglev_env.redundancy.newton import moved
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import Excitation

RATE, PERIODS, SAMPLES = 10e3, 6, 10000
LINES = tuple(range(2, 260, 3))  # Hz, at a fundamental of 1 Hz
W = 2 * np.pi * np.array(LINES)


def stiffness(mass, bandwidth, damping, filtered, late, integral):
    """Force over displacement of a filtered PID behind a dead time that holds a rotor on negative springs, (n,)."""
    s = 1j * W
    own, wanted = -mass * (0.5 * bandwidth) ** 2, mass * bandwidth**2
    kp, kd = wanted - own, 2 * damping * mass * bandwidth
    control = kp * (1 + integral / s) + kd * s / (1 + filtered * s)
    return own - mass * W**2 + control * np.exp(-late * s)


def view(z, mass, rng, noise=0.01, force=1.0, displacement=1.0):
    """A recording of a force on all lines, as two channels with responses of their own (n,) show it."""
    spectra = np.zeros((2, SAMPLES // 2 + 1), complex)
    drive = np.exp(2j * np.pi * rng.random(len(LINES)))
    spectra[:, list(LINES)] = drive * force * SAMPLES / 2, drive / z * displacement * SAMPLES / 2
    f, y = np.tile(np.fft.irfft(spectra, SAMPLES), PERIODS)
    y = y + noise * np.abs(1 / z[-1]) * rng.normal(size=y.size)
    channels = {"force": f, "displacement": y}
    names = frozenset(channels)
    excitation = Excitation("sphs", "force", 1.0, LINES, 10.0)
    return View("run", RATE, channels, names, {n: n for n in names}, (excitation,), frozenset(), None, (), None, mass)


def drawn(rng):
    """A loop of a mass (kg): natural frequency 10 to 60 Hz, filter and dead time as common controllers have."""
    mass = np.exp(rng.uniform(np.log(0.05), np.log(2.0)))
    slow = rng.uniform(1.0, 6.0) / RATE
    return stiffness(mass, 2 * np.pi * rng.uniform(10, 60), rng.uniform(0.3, 1.2), slow, rng.uniform(0.5, 2) / RATE,
                     rng.uniform(0, 10)), mass  # fmt: skip


def test_what_an_unknown_controller_does_is_no_delay():
    rng = np.random.default_rng(3)
    rows = [row for z, mass in (drawn(rng) for _ in range(100)) for row in moved(view(z, mass, rng))]
    assert len(rows) > 90 and sum(row.delay is not None for row in rows) > 90
    assert sum(row.off for row in rows) == 0


@pytest.mark.parametrize("name, sign", [("displacement", 1.0), ("force", -1.0)])
def test_a_delay_or_a_filter_of_either_channel_is_named(name, sign):
    rng = np.random.default_rng(5)
    for _ in range(10):
        z, mass = drawn(rng)
        own = {name: np.exp(-1j * W * 8 / RATE)}
        (row,) = moved(view(z, mass, rng, **own))
        assert row.delay_off() and sign * row.delay * RATE > 5  # the springs make it look larger in the force
        (said,) = explained(view(z, mass, rng), [row])
        assert name in said.channel and said.kind == "effect" and "maglev diagnose" in said.message
        assert f"{name} late" in said.message
        own = {name: 1 / (1 + 1j * W / (2 * np.pi * 300))}
        (row,) = moved(view(z, mass, rng, **own))
        assert row.delay_off() and np.sign(row.delay) == sign


def test_the_least_delay_that_can_be_told_is_said():
    rng = np.random.default_rng(7)
    z, mass = drawn(rng)
    seen = view(z, mass, rng)
    (note,) = uncovered(seen, moved(seen))
    assert "time between force and displacement below " in note.message and "name the rig" in note.message
