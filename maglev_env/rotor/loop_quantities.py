"""What a goal requires of a rotor's linear loop at a speed, by mode and sensor plane; docs/goals.md defines each.

The loop is linearised where it runs (`operating_point`) and exactly sampled. It has two inputs and two outputs in
x + i y, and frequencies of both signs; so what is largest over both is largest over all directions of real x and y.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from estimation.gain_margin import gain_factors
from estimation.stability_margins import margin_arrays
from maglev_env.rig.goal import QUANTITIES
from maglev_env.rotor.identification import MODES
from maglev_env.rotor.linear import (
    closed_loop, control_response, held_current, mechanics, plant_response, sampled, sensitivity,
)  # fmt: skip
from maglev_env.rotor.operating_point import by_direction
from maglev_env.rotor.rotor import Rotor

PLANES = ("plane a", "plane b")
TOGETHER = "all together"
LOWEST, HIGHEST, POINTS = 2.0, 0.45, 140  # Hz, share of the control rate, number of frequencies
BAND = (60.0, 180.0)  # Hz, of stiffness and damping, as `identification.Protocol`
AGAIN = 17  # frequencies between the neighbours of a peak
BESIDE = np.geomspace(0.02, 30.0, 24)  # rad/s over the notch's rate: distances from the speed of rotation


@dataclass(frozen=True)
class Found:
    """One quantity: its values (speeds, places), nan where it has none, at speeds in rpm, of the named places."""

    speeds: tuple[float, ...]
    places: tuple[str, ...]
    values: np.ndarray


def linear_quantities(rotor: Rotor, speed_rpm: float, band: tuple[float, float]) -> dict[str, Found] | None:
    """The quantities of the linear loop at one speed, the worse of x and y, by name; None where it is unstable there.

    Args:
        rotor: The rotor.
        speed_rpm: Speed, rpm.
        band: Frequencies among which the worst compliance is sought, Hz.

    Raises:
        ValueError: The rotor is on self-sensing.
    """
    if rotor.sensor != "probe":
        raise ValueError("goal: a rotor's requirements are those of its loop on the probes")
    speed = speed_rpm * np.pi / 30
    if abs(np.linalg.eigvals(closed_loop(rotor, speed)[0])).max() >= 1:
        return None
    try:
        directions = by_direction(rotor, speed)
    except ValueError:  # its orbit or its sag leaves the gap, where the force law pulls no more: it cannot run there
        return None
    every = []
    for here in directions:
        whole, error = closed_loop(here, speed)
        if abs(np.linalg.eigvals(whole)).max() >= 1:
            return None
        found = _margins(here, speed)
        found["compliance"] = MODES, _compliance(here, speed, band)
        found["stiffness"], found["damping"] = ((MODES, one) for one in _coefficients(here))
        found["noise_current"] = PLANES, _noise_current(here, speed, whole, error)
        every.append(found)
    worse = {name: np.fmax if QUANTITIES[name].most else np.fmin for name in every[0]}
    return {
        name: Found((speed_rpm,), places, worse[name].reduce([found[name][1] for found in every])[None])
        for name, (places, _) in every[0].items()
    }


def frequencies(rotor: Rotor, speed: float) -> np.ndarray:
    """Frequencies (n,) Hz at which the loop is looked at: evenly in their logarithm, and dense beside the notch."""
    top = HIGHEST * rotor.axis.control_rate
    grid = np.geomspace(LOWEST, top, POINTS)
    if rotor.rejection is None or not speed:
        return grid
    away = BESIDE * rotor.rejection.rate
    beside = abs(speed + np.concatenate([-away, [0.0], away])) / (2 * np.pi)
    return np.union1d(grid, beside[(beside >= LOWEST) & (beside <= top)])


def _margins(rotor: Rotor, speed: float) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Peak sensitivity and margins, places and values (places,).

    Of a plane or a mode the loop in x is broken there alone while all others are closed; of all together the largest
    singular value counts.
    """
    f = frequencies(rotor, speed)
    planes = _at_readings(rotor, f, speed), _at_readings(rotor, -f, speed)
    loops, places = [planes], PLANES
    if tuple(rotor.gains) == MODES:
        loops.append((sensitivity(rotor, f, speed), sensitivity(rotor, -f, speed)))
        places = (*PLANES, *MODES)
    own = [(ahead[:, i, i] + back[:, i, i].conj()) / 2 for ahead, back in loops for i in range(2)]
    margins = margin_arrays(f, np.array(own))
    factor = np.fmin(*gain_factors(f, np.array(own), margins))
    peak, offset = (_peak(rotor, f, speed, planes, part) for part in (0.0, 0.5))
    every = (*places, TOGETHER)
    return {
        "peak_sensitivity": (every, np.append(margins["peak_sensitivity"], peak)),
        "disk_margin": (every, np.append(margins["disk_margin"], 1 / offset)),
        "phase_margin": (places, margins["phase_margin"]),
        "gain_margin": (places, factor),
    }


def _at_readings(rotor: Rotor, frequency: np.ndarray, speed: float) -> np.ndarray:
    """Response (n, 2, 2) of the readings of both planes to errors of them, at frequency (n,) Hz of either sign."""
    loop = plant_response(rotor, frequency, speed) @ control_response(rotor, frequency, speed)
    return np.linalg.inv(np.eye(2) + loop)


def _peak(rotor: Rotor, f: np.ndarray, speed: float, planes: tuple[np.ndarray, ...], part: float) -> float:
    """Largest singular value of S - part I over all frequencies of both signs; looked at again beside its largest."""
    found = []
    for sign, s in zip((1.0, -1.0), planes, strict=True):
        i = int(_largest_singular(s - part * np.eye(2)).argmax())
        near = np.geomspace(f[max(i - 1, 0)], f[min(i + 1, f.size - 1)], AGAIN)
        found.append(_largest_singular(_at_readings(rotor, sign * near, speed) - part * np.eye(2)).max())
    return max(found)


def _largest_singular(matrices: np.ndarray) -> np.ndarray:
    return np.linalg.svd(matrices, compute_uv=False)[..., 0]


def _arms(rotor: Rotor) -> np.ndarray:
    """Factors (2,) that refer a motion to metres: of the centre of mass, and of the tilt at half the magnets' distance.

    So equal springs at both magnets have one stiffness in both modes.
    """
    return np.array([1.0, np.diff(rotor.planes.magnets)[0] / 2])


def _compliance(rotor: Rotor, speed: float, band: tuple[float, float]) -> np.ndarray:
    """Largest displacement per force (2,) of both modes, m/N, without the notch: no load turns with the rotor."""
    f = frequencies(rotor, 0.0)
    f = f[(f >= band[0]) & (f <= band[1])]
    if not f.size:
        raise ValueError(f"goal: compliance in {band[0]:g}..{band[1]:g} Hz: give a band within {LOWEST:g} Hz and 45 % "
                         "of the control rate, wide enough for one of its frequencies")  # fmt: skip
    a, b, c = sampled(rotor, speed)
    both = np.concatenate([f, -f])
    control = control_response(rotor, both)
    z = np.exp(2j * np.pi * both / rotor.axis.control_rate)
    closed = z[:, None, None] * np.eye(8) - a + b[:, :2] @ control @ c
    moved = np.linalg.solve(closed, b[:, 2:])[:, :2]
    return np.array([abs(moved[:, i, i]).max() for i in range(2)]) * _arms(rotor) ** 2


def _coefficients(rotor: Rotor) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping (2,) of both modes, N/m and N s/m: means over BAND of what holds a mode but its inertia."""
    f = frequencies(rotor, 0.0)
    f = f[(f >= BAND[0]) & (f <= BAND[1])]
    m, w = mechanics(rotor), 2 * np.pi * f
    lag = held_current(rotor, f) / (1 + 1j * w * rotor.axis.sensor_time_constant)
    held = m.drive[:2, ::2] @ control_response(rotor, f) @ m.probes[::2, :2] * lag[:, None, None]
    dynamic = np.diagonal(held + m.stiffness[:2, :2] + 1j * w[:, None, None] * m.damping[:2, :2], axis1=1, axis2=2)
    per_arm = _arms(rotor) ** 2
    return dynamic.real.mean(axis=0) / per_arm, (dynamic.imag / w[:, None]).mean(axis=0) / per_arm


def _noise_current(rotor: Rotor, speed: float, whole: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Current (2,) A rms of one coil pair at each plane, from the noise and the steps of probes and converters."""
    axis = rotor.axis
    reading = axis.noise.displacement**2 + axis.reading_step**2 / 12
    command = axis.command_step**2 / 12
    _, b, _ = sampled(rotor, speed)
    held = np.vstack([b[:, :2], np.zeros((len(whole) - 8, 2))])
    power = reading * error @ error.conj().T + command * held @ held.conj().T
    # The variance of x + i y is twice that of x, and so is that of its noise.
    spread = scipy.linalg.solve_discrete_lyapunov(whole, power)
    return np.sqrt(spread.diagonal()[6:8].real)


def joined(parts: list[Mapping[str, Found]]) -> dict[str, Found]:
    """Quantities of several speeds in one."""
    return {
        name: Found(
            tuple(v for part in parts for v in part[name].speeds),
            parts[0][name].places,
            np.concatenate([part[name].values for part in parts]),
        )
        for name in parts[0]
    }
