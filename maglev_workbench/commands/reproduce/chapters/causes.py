"""What may have disturbed the published records of the radial and the axial rig: their responses under each cause."""

from dataclasses import dataclass, field, replace

import numpy as np

from maglev_env.loop.effect import NO_EFFECTS, Effects, effect
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapters.shaker import (
    SWITCHING,
    Shaker,
    planar_response,
    receptance,
    simulated,
    with_noise,
)

RESOLUTION = 0.5e-6  # m rms: the stated one of the probe
ROTOR = 0.13  # kg, rotor and shaft (5.4); the rest of the 0.92 kg is the pedestal
GAINS = (5600.0, 7200.0, 8800.0)  # A/m: k_p of 0.7, 0.9 and 1.1 as 5.3.3 counts it
REPEATS = 2


@dataclass(frozen=True)
class Cause:
    """A cause at one size.

    Args:
        name: with its size.
        noise: of the probes, m rms.
        effects: of the simulator.
        direction: of the force on the radial rig, degrees; the estimators believe in 45.
        joint: natural frequency (Hz) of rotor and shaft on the flexible joint between them and the pedestal, where
            the force acts; 0: rigid.
        mass: kg that the estimators believe in; 0: the true one.
    """

    name: str
    noise: float = RESOLUTION
    effects: Effects = field(default_factory=lambda: NO_EFFECTS)
    direction: float = 45.0
    joint: float = 0.0
    mass: float = 0.0


@dataclass(frozen=True)
class Responses:
    """Responses by cause: frequency (n,), repeats of the same experiment (REPEATS, 2, n), and with GAINS (3, 2, n)."""

    frequency: np.ndarray
    repeats: np.ndarray
    gains: np.ndarray


def causes() -> tuple[Cause, ...]:
    """Those that the text or its readers have named, at sizes that it states or that its rig may have."""
    return (
        Cause("noise of 0.5 µm, the stated resolution"),
        Cause("noise of 0.5 µm and the program's 0.7907 kg", mass=0.7907),
        Cause("noise of 6 µm", noise=6e-6),
        Cause("noise of 12.5 µm, the 100 mV of 4.4.3", noise=SWITCHING),
        Cause("noise of 12.5 µm and the program's 0.7907 kg", noise=SWITCHING, mass=0.7907),
        Cause("probe lag of 0.1 ms and one hold", effects=effect("sensor_lag", 1e-4)),
        Cause("support resonance: 5 % of the mass at 38 Hz",
              effects=effect("support_resonance", 38.0, mass_ratio=0.05)),
        Cause("support resonance: 5 % of the mass at 150 Hz",
              effects=effect("support_resonance", 150.0, mass_ratio=0.05)),
        Cause("support's own dynamics: probe mount at 270 Hz", effects=effect("sensor_resonance", 270.0, coupling=0.3)),
        Cause("support's own dynamics: shaft between force and rotor, 270 Hz", joint=270.0),
        Cause("the same with noise of 2 µm", joint=270.0, noise=2e-6),
        Cause("current ripple: 100 mV at 25 kHz, read at 20 kHz",
              effects=effect("pickup", SWITCHING * np.sqrt(2), frequency=5000.3)),
        Cause("force sensor 5 degrees off", direction=40.0),
        Cause("eddy currents from 200 Hz on", effects=effect("eddy_current", 200.0)),
    )  # fmt: skip


def radial_responses(cause: Cause, seed: int) -> Responses:
    """Responses in x and y of the radial rig over the magnitude of the force."""
    rig = load_rig("hmb_radial")
    gains = [rig.gains] * REPEATS + [replace(rig.gains, kp=kp) for kp in GAINS]
    seeds = [len(gains) * seed + i for i in range(len(gains))]
    shaker = Shaker(250, 1.5, direction=cause.direction)
    noisy = [with_noise(rig, cause.noise)] * len(gains)
    statistics = simulated(noisy, shaker, seeds, gains, cause.effects).statistics
    found = planar_response(statistics)
    if cause.joint:
        quiet = planar_response(simulated([with_noise(rig, 0.0)] * len(gains), shaker, seeds, gains).statistics)
        found = found - quiet + _through_the_joint(quiet * np.sqrt(2), statistics.frequency, rig, cause.joint) / 2**0.5
    return Responses(statistics.frequency, found[:REPEATS], found[REPEATS:])


def axial_responses(cause: Cause, seed: int) -> np.ndarray:
    """Frequency and response (2, n) of the axial rig, as complex numbers."""
    rig = with_noise(load_rig("hmb_axial"), cause.noise)
    statistics = simulated([rig], Shaker(250, 0.15), [seed], effects=cause.effects).statistics
    return np.stack([statistics.frequency.astype(complex), receptance(statistics)[0]])


def _through_the_joint(rigid: np.ndarray, frequency: np.ndarray, rig: Rig, joint: float) -> np.ndarray:
    """Displacement of the rotor over the force on the pedestal, from the response of both as one body.

    The bearing's dynamic stiffness is what the rigid response has beyond spring and mass; it acts on the rotor, the
    spring on the pedestal, and the joint between them is an undamped spring.
    """
    one, w = axis_rig(rig, 0), 2 * np.pi * frequency
    spring = one.support_stiffness + 1j * w * one.support_damping
    bearing = 1 / rigid + rig.mass * w**2 - spring
    link = ROTOR * (2 * np.pi * joint) ** 2
    pedestal = spring - (rig.mass - ROTOR) * w**2 + link
    return link / (pedestal * (bearing - ROTOR * w**2 + link) - link**2)
