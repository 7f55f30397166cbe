"""The slotless three-phase motor: torque by the Lorentz force, and what limits it on the way to a speed (D eq 3.3-3.6).

Currents and voltages are peak values of a phase. The current is kept in phase with the back-EMF (phi = 0 in D eq 3.6)
and the winding's inductance is left out: R A + E is the voltage of a phase.
"""

from dataclasses import dataclass, fields
from math import cos, pi, sqrt

import scipy

from selfsense.coil import is_number


@dataclass(frozen=True)
class Motor:
    """A motor of six coils in three phases, SI; speeds in rad/s.

    Attributes:
        turns: N, of each coil.
        radius: r, of the conductors, m.
        length: l, m.
        flux_density: B, peak in the gap, T.
        pole_pairs: Number of pole pairs.
        winding_resistance: Of one phase, ohm.
        current_limit: A, peak of a phase.
        supply_voltage: Direct voltage, V; a star-connected phase gets 1 / sqrt(3) of it at most.
        viscous_drag: Of the rotor, N m s.
        quadratic_drag: Of the rotor, N m s2.

    Raises:
        ValueError: Unless all are finite and positive, the drags at least 0, and pole_pairs is an integer.
    """

    turns: float
    radius: float
    length: float
    flux_density: float
    pole_pairs: int
    winding_resistance: float
    current_limit: float
    supply_voltage: float
    viscous_drag: float = 0.0
    quadratic_drag: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value, drag = getattr(self, f.name), f.name.endswith("drag")
            if not (is_number(value) and (value >= 0 if drag else value > 0)):
                raise ValueError(f"motor: {f.name} = {value!r} must be a number {'of at least' if drag else 'above'} 0")
        if self.pole_pairs != int(self.pole_pairs):
            raise ValueError(f"motor: pole_pairs = {self.pole_pairs!r} must be a whole number")

    @property
    def torque_constant(self) -> float:
        """6 N r l B, N m per A of a phase's peak current: twelve coil sides, on average at half the peak field."""
        return 6 * self.turns * self.radius * self.length * self.flux_density

    @property
    def phase_voltage(self) -> float:
        """Greatest peak voltage of a phase, V."""
        return self.supply_voltage / sqrt(3)

    def torque(self, current: float, phase: float = 0.0) -> float:
        """T = 6 N r l A B cos(phi), N m, at a current A (A) and phase phi (rad) (D eq 3.6).

        It is N r l times the integral of B_g i_m over a full turn. D writes twice an integral from -7/8 pi to 7/8 pi;
        that range contains more than the half of the coil sides for which its factor two stands.
        """
        return self.torque_constant * current * cos(phase)

    def back_emf(self, speed: float) -> float:
        """Peak voltage (V) that the rotor induces in a phase: 4 N r l B speed, so that 3/2 E A = torque * speed."""
        return 4 * self.turns * self.radius * self.length * self.flux_density * speed

    def electrical_frequency(self, speed: float) -> float:
        """Frequency (Hz) of the currents."""
        return self.pole_pairs * speed / (2 * pi)

    def drag_torque(self, speed: float) -> float:
        """Torque (N m) that the rotor loses at a speed of at least 0."""
        return (self.viscous_drag + self.quadratic_drag * speed) * speed

    def greatest_current(self, speed: float) -> float:
        """Largest peak current (A) within the limit that the supply can drive against the back-EMF."""
        left = (self.phase_voltage - self.back_emf(speed)) / self.winding_resistance
        return max(0.0, min(self.current_limit, left))

    def greatest_torque(self, speed: float) -> float:
        """The largest torque (N m) at a speed."""
        return self.torque(self.greatest_current(speed))

    def current(self, speed: float) -> float:
        """Peak current (A) that keeps a speed against the drag.

        Raises:
            ValueError: No current does; the message gives the torques.
        """
        self._check_reaches(speed)
        return self.drag_torque(speed) / self.torque_constant

    def copper_loss(self, speed: float) -> float:
        """Heat (W) in the windings of the three phases while a speed is kept.

        Raises:
            ValueError: The speed cannot be kept.
        """
        return 1.5 * self.winding_resistance * self.current(speed) ** 2

    def top_speed(self) -> float:
        """The speed (rad/s) at which the drag uses all available torque; without drag the no-load speed."""
        no_load = self.phase_voltage / self.back_emf(1.0)
        if self._net(no_load) >= 0:  # without drag, but for rounding
            return no_load
        return float(scipy.optimize.brentq(self._net, 0.0, no_load, xtol=1e-12 * no_load))

    def spin_up_time(self, to_rpm: float, inertia: float) -> float:
        """Time (s) from rest to a speed (rev/min) at the greatest torque, for a rotor of `inertia` (kg m2).

        Raises:
            ValueError: Inertia or speed is not positive, or no torque is left at the speed.
        """
        for name, value in (("to_rpm", to_rpm), ("inertia", inertia)):
            if not (is_number(value) and value > 0):
                raise ValueError(f"spin_up_time: {name} = {value!r} must be a number above 0")
        speed = to_rpm * pi / 30
        self._check_reaches(speed, accelerating=True)
        # The torque has a kink where the supply begins to limit it; quadrature is exact on either side.
        left = self.phase_voltage - self.winding_resistance * self.current_limit
        bend = min(max(left / self.back_emf(1.0), 0.0), speed)
        parts = [
            scipy.integrate.quad(lambda w: 1 / self._net(w), *ends, epsrel=1e-10)[0]
            for ends in ((0.0, bend), (bend, speed))
        ]
        return inertia * sum(parts)

    def _net(self, speed: float) -> float:
        return self.greatest_torque(speed) - self.drag_torque(speed)

    def _check_reaches(self, speed: float, accelerating: bool = False) -> None:
        if speed < 0:
            raise ValueError(f"motor: speed = {speed:g} rad/s must be at least 0")
        net = self._net(speed)
        if net > 0 or (net == 0 and not accelerating and self.back_emf(speed) <= self.phase_voltage):
            return
        at_limit = self.greatest_current(speed) == self.current_limit
        limit = f"current limit of {self.current_limit:g} A" if at_limit else f"supply of {self.supply_voltage:g} V"
        torques = f"{self.greatest_torque(speed):.4g} N m against a drag of {self.drag_torque(speed):.4g} N m"
        raise ValueError(
            f"motor: {_rpm(speed):.5g} rpm is out of reach: the {limit} leaves {torques}; "
            f"the top speed is {_rpm(self.top_speed()):.5g} rpm"
        )


def _rpm(speed: float) -> float:
    return speed * 30 / pi
