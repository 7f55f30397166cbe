"""Run-up and identification of a rotor, with its linear model, motor and thermal model for comparison."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from estimation.iso_14839 import iso_14839_2_zone
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rotor.evaluation import identified_speeds
from maglev_env.rotor.identification import RotorIdentification, identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import closed_loop_poles, probe_readings, unbalance_response, undamped_frequencies
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.run_up import RunUp, run_up
from maglev_env.rotor.simulate import PLACES


@dataclass(frozen=True)
class Report:
    """Results of one rotor; identified: k identifications at id_speeds (k,) in rpm; result: those of the run-up.

    On self-sensing also on_probes: the same rotor on its probes, and at_coils: identifications on probes that stand in
    the planes of the coils.
    """

    rotor: Rotor
    seed: int
    result: RunUp
    id_speeds: tuple[float, ...]
    identified: RotorIdentification
    on_probes: "Report | None" = None
    at_coils: RotorIdentification | None = None

    @property
    def identifications(self) -> dict[str, RotorIdentification]:
        """By what the controllers read."""
        if self.on_probes is None or self.at_coils is None:
            return {"probes": self.identified}
        beside = {"probes at the coils": self.at_coils, "probes": self.on_probes.identified}
        return {"self-sensing": self.identified} | beside

    @property
    def speeds(self) -> np.ndarray:
        """Speeds of the run-up (s,), rpm."""
        return self.result.speed_rpm

    @cached_property
    def expected(self) -> np.ndarray:
        """`readings` at the speeds, (s, 2)."""
        return readings(self.rotor, self.speeds)

    @property
    def zones(self) -> list[str]:
        """Zone of ISO 14839-2 by the larger peak of both planes, per speed."""
        clearance = self.rotor.axis.clearance
        return [iso_14839_2_zone(float(peak), clearance) for peak in self.result.peak[0].max(axis=-1)]

    @cached_property
    def touchdowns(self) -> list[dict[str, Any] | None]:
        """Place, time (s) and greatest force (N) of the first contact at each speed."""
        found: list[dict[str, Any] | None] = []
        for first, contact in zip(self.result.first_contact[0], self.result.contact[0], strict=True):
            where = int(np.argmin(np.where(np.isnan(first), np.inf, first)))
            one = {"place": PLACES[where], "time": float(first[where]), "force": float(contact[where])}
            found.append(None if np.isnan(first).all() else one)
        return found

    @property
    def motor(self) -> dict[str, np.ndarray] | None:
        """Torque (N m), peak current (A), copper loss (W) and power (W), (s,) each, at each speed, without driver."""
        motor, speeds = self.rotor.motor, abs(self.speeds) * np.pi / 30
        if motor is None:
            return None
        torque, current, loss = (
            np.array([of(w) for w in speeds]) for of in (motor.drag_torque, motor.current, motor.copper_loss)
        )
        return {"torque": torque, "current": current, "copper_loss": loss, "power": torque * speeds + loss}

    @property
    def spin_up_time(self) -> float | None:
        """Time (s) from rest to the greatest speed; None without a motor or without a speed above 0."""
        top = float(abs(self.speeds).max())
        motor = self.rotor.motor
        return motor.spin_up_time(top, self.rotor.body.polar_inertia) if motor is not None and top > 0 else None

    @property
    def heat(self) -> np.ndarray:
        """Heat (W), (s,), of coils and, with a motor, windings and drag; all is assumed to stay in the housing."""
        return self.result.copper_loss[0] + (self.motor["power"] if self.motor else 0.0)


def report(rotor: Rotor, speeds: np.ndarray, seed: int, threads: int | None) -> Report:
    """Run up, and identify at standstill and near the top speed, where no harmonic of the rotation is on a line."""
    at = tuple(sorted(identified_speeds(rotor, speeds).tolist(), key=abs))

    def identified(one: Rotor) -> RotorIdentification:
        return identify_runs([Run(one, v, (seed, 1, i)) for i, v in enumerate(at)], threads=threads)

    found = Report(rotor, seed, run_up([rotor], speeds, seed, threads), at, identified(rotor))
    if rotor.sensor == "probe":
        return found
    stated = replace(rotor, sensor="probe")
    moved = replace(stated, planes=replace(rotor.planes, probes=rotor.planes.magnets))
    return replace(found, on_probes=report(stated, speeds, seed, threads), at_coils=identified(moved))


def slowest(rotor: Rotor, speed_rpm: float) -> float:
    """Largest real part (1/s) of the poles of the linear loop at a speed; positive where it is not stable."""
    largest = np.abs(closed_loop_poles(rotor, float(speed_rpm) * np.pi / 30)).max()
    return float(np.log(largest) * rotor.axis.control_rate)


def readings(rotor: Rotor, speeds: np.ndarray) -> np.ndarray:
    """Once-per-turn amplitude of the probes in x by the linear model.

    Args:
        rotor: the rotor.
        speeds: (s,), rpm.

    Returns:
        (s, 2) at planes a and b, m; nan at rest and where the loop is not stable.
    """
    found = np.full((len(speeds), 2), np.nan)
    for i, w in enumerate(np.asarray(speeds) * np.pi / 30):
        if w and abs(closed_loop_poles(rotor, w)).max() < 1:
            at = np.array([w])
            found[i] = abs(probe_readings(rotor, unbalance_response(rotor, at), at)[0, ::2])
    return found


def spring(rotor: Rotor) -> float:
    """Stiffness (N/m) at each magnet plane, by the proportional gain of the first controller and the magnets."""
    gain, stiffness = linearise(force_law(rotor.axis))
    return (gain * next(iter(rotor.gains.values())).kp + stiffness) / 2


def whirl(rotor: Rotor, speeds: np.ndarray) -> np.ndarray:
    """Undamped whirl frequencies (s, 4) in Hz on `spring` at speeds (rpm); backward ones are negative; nan if none."""
    k = spring(rotor)
    if k <= 0:
        return np.full((len(speeds), 4), np.nan)
    return np.array([undamped_frequencies(rotor, k, w) for w in np.asarray(speeds) * np.pi / 30])


def damped(rotor: Rotor, speed_rpm: float, top: float = 500.0) -> np.ndarray:
    """Frequency (Hz) and damping ratio below 0.95 (n, 2) of the closed loop's modes up to `top` (Hz), sorted."""
    z = closed_loop_poles(rotor, speed_rpm * np.pi / 30)
    s = np.log(z[abs(z) > 1e-6]) * rotor.axis.control_rate
    s = s[(s.imag > 0.3 * abs(s)) & (s.imag < 2 * np.pi * top)]
    found = np.stack([s.imag / (2 * np.pi), -s.real / abs(s)], axis=-1)
    return found[np.argsort(found[:, 0])]
