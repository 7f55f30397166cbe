"""The axial pump on its mean radius: velocity triangles, pressure, blade numbers and blade angles (D 3.1.3, Table 3.1).

Blade angles are measured from the axial direction at the mean of hub and tip radius. The flow follows the blades
without losses, so pressures are Euler's: rho U times the swirl that the impeller adds. The straightener gives the flow
a swirl at alpha_1 ahead of the impeller, in the direction of rotation.
"""

from dataclasses import dataclass, fields
from math import atan, cos, pi, radians, tan

import numpy as np
import scipy

from selfsense.coil import is_number

MMHG = 101325 / 760  # Pa
FEASIBLE = 1e-9  # relative excess over a constraint that counts as none

MISPRINTS = (
    "100 mmHg is printed as 133.32 Pa; it is 13,332 Pa, which is also what Table 3.1's 13,309.8 Pa is near.",
    "5 L/min is printed as 8.333e-3 m3/s in the text; it is 8.333e-5 m3/s, as in Table 3.1.",
    "The text announces the axial velocity C_a and gives psi instead; no equation for C_a or phi is there.",
    "C_a = 0.656 m/s is not 5 L/min through the annulus between the printed radii (0.547 m/s), nor with nine blades of "
    "0.5 mm across it (0.639 m/s). It is 1.2 times the first: 5 L/min through five sixths of the annulus or 6 L/min "
    "through all of it; D does not say which. With that factor the printed pressure and speed return to all digits.",
    "13,309.8 Pa is 99.83 mmHg; 99.82 follows from 0.0075 mmHg/Pa.",
    "The text cites Figure 3.9 for the trigonometry; the velocity diagram is Figure 3.8.",
    "The straightener's and the diffuser's blade numbers have one symbol, n_s; the diffuser's tip radius, 6.86 mm in "
    "the text, is not in Table 3.1.",
    "The straightener is said to straighten the blood before it returns to the aorta; that is the diffuser's part. "
    "With alpha_1 = 70.24 degrees the straightener gives the flow a swirl in the direction of rotation, without which "
    "the same blade velocity would give rho U^2 = 164 mmHg.",
)


@dataclass(frozen=True)
class Pump:
    """Design conditions of an impeller, SI.

    Attributes:
        flow_rate: m3/s.
        density: kg/m3.
        tip_radius: m.
        hub_radius: m.
        blade_thickness: m.
        open_fraction: Share of the annulus between hub and tip that is open to the flow.
        outlet_angle: beta_2 of the impeller's blades, rad.

    Raises:
        ValueError: Unless hub_radius < tip_radius, open_fraction is at most 1, outlet_angle is within +-pi/2, and the
            rest is positive.
    """

    flow_rate: float
    density: float
    tip_radius: float
    hub_radius: float
    blade_thickness: float
    open_fraction: float = 1.0
    outlet_angle: float = 0.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not is_number(value) or (value <= 0 and f.name != "outlet_angle"):
                raise ValueError(f"pump: {f.name} = {value!r} must be a number above 0 (SI units)")
        if self.hub_radius >= self.tip_radius:
            raise ValueError(f"pump: hub_radius = {self.hub_radius:g} m must be below the tip's {self.tip_radius:g} m")
        if self.open_fraction > 1:
            raise ValueError(f"pump: open_fraction = {self.open_fraction:g} is a share of the annulus, at most 1")
        if not abs(self.outlet_angle) < pi / 2:
            raise ValueError(f"pump: outlet_angle = {self.outlet_angle:g} rad must lie within +-pi/2; give radians")

    @property
    def mean_radius(self) -> float:
        """Mean of hub and tip radius, m."""
        return (self.tip_radius + self.hub_radius) / 2

    @property
    def axial_velocity(self) -> float:
        """C_a, m/s, at the design flow."""
        return self.flow_rate / (self.open_fraction * pi * (self.tip_radius**2 - self.hub_radius**2))


@dataclass(frozen=True)
class Impeller:
    """An impeller at its design point as in Table 3.1, angles in rad.

    Attributes:
        rotor_inlet_angle: beta_1.
        stator_inlet_angle: alpha_2, of the diffuser.
        straightener_angle: alpha_1, at its outlet.
        flow_coefficient: phi = C_a / U.
        loading: psi = pressure / (rho U^2).
        blade_velocity: U, m/s.
        speed: rad/s.
        pressure: Pa.
    """

    rotor_inlet_angle: float
    stator_inlet_angle: float
    straightener_angle: float
    flow_coefficient: float
    loading: float
    blade_velocity: float
    speed: float
    pressure: float


def impeller(pump: Pump, rotor_inlet_angle: float, stator_inlet_angle: float) -> Impeller:
    """The impeller whose velocity triangles have these angles (rad) at the design flow.

    At the outlet U = C_a (tan alpha_2 + tan beta_2) and at the inlet U = C_a (tan alpha_1 + tan beta_1), therefore
    psi = (tan beta_1 - tan beta_2) phi; D's relations are these with beta_2 = 0.

    Raises:
        ValueError: Angles outside 0 .. pi/2, for instance because they are in degrees.
    """
    for name, angle in (("rotor_inlet_angle", rotor_inlet_angle), ("stator_inlet_angle", stator_inlet_angle)):
        if not 0 < angle < pi / 2:
            raise ValueError(f"impeller: {name} = {angle:g} rad must lie between 0 and pi/2; give radians")
    outlet = tan(pump.outlet_angle)
    around = tan(stator_inlet_angle) + outlet  # U / C_a
    if around <= 0:
        raise ValueError("impeller: stator_inlet_angle and outlet_angle give a rotor that stands or turns backwards")
    velocity, turned = pump.axial_velocity * around, tan(rotor_inlet_angle) - outlet
    return Impeller(
        rotor_inlet_angle=rotor_inlet_angle,
        stator_inlet_angle=stator_inlet_angle,
        straightener_angle=atan(around - tan(rotor_inlet_angle)),
        flow_coefficient=1 / around,
        loading=turned / around,
        blade_velocity=velocity,
        speed=velocity / pump.mean_radius,
        pressure=pump.density * velocity * pump.axial_velocity * turned,
    )


def pressure_rise(pump: Pump, design: Impeller, speed: np.ndarray | float, flow_rate: float) -> np.ndarray | float:
    """Pressure (Pa) of fixed blades at other speeds (rad/s) and another flow rate (m3/s); shape of speed.

    It is rho U (U - C_a (tan beta_2 + tan alpha_1)): the straightener and the impeller's outlet determine the swirl.
    Losses of a flow that meets the inlet at another angle than beta_1 are left out.
    """
    around = pump.mean_radius * speed
    axial = pump.axial_velocity * flow_rate / pump.flow_rate
    return pump.density * around * (around - axial * (tan(pump.outlet_angle) + tan(design.straightener_angle)))


def blade_number(tip_radius: float, hub_radius: float, thickness: float) -> float:
    """pi D_t / (h + t), not rounded: blades as far apart at the tip as they are high. Lengths in m."""
    return 2 * pi * tip_radius / (tip_radius - hub_radius + thickness)


def blocked_share(blades: int, thickness: float, angle: float, radius: float) -> float:
    """Share of the circumference at a radius (m) that blades of a thickness (m) at an angle (rad) occupy.

    A slanted blade is thickness / cos(angle) wide along the circumference. D's flow area ignores blades. The result
    exceeds 1 where they overlap.
    """
    return blades * thickness / (2 * pi * radius * cos(angle))


def least_speed(pump: Pump, pressure: float, rotor_inlet_limit: float, stator_inlet_limit: float) -> Impeller:
    """The slowest impeller that gives a pressure (Pa), with beta_1 and alpha_2 (rad) up to a limit each.

    The loading is at most 1: the straightener gives no swirl against the rotation. Pressure alone is not an objective,
    because it grows with both angles without end and a search would only return their limits.

    Raises:
        ValueError: The limits do not reach the pressure.
    """
    most = impeller(pump, rotor_inlet_limit, stator_inlet_limit)
    if most.loading > 1:
        raise ValueError("least_speed: at its limits the impeller is loaded above 1; lower rotor_inlet_limit")
    if most.pressure < pressure:
        raise ValueError(
            f"least_speed: {most.pressure:.5g} Pa is the most within the limits, below {pressure:.5g} Pa; "
            f"raise rotor_inlet_limit or stator_inlet_limit"
        )

    standing = max(0.0, -tan(pump.outlet_angle)) / tan(stator_inlet_limit)  # x[1] at which the rotor does not turn

    def at(x: np.ndarray) -> Impeller:
        return impeller(pump, *np.arctan(x * np.tan([rotor_inlet_limit, stator_inlet_limit])))

    def short(x: np.ndarray) -> np.ndarray:
        """What is left of both constraints, at least 0 where they hold."""
        return np.array([at(x).pressure / pressure - 1, 1 - at(x).loading])

    low = np.array([1e-3, standing + 1e-3])
    tried = [
        scipy.optimize.minimize(
            lambda x: at(x).blade_velocity / most.blade_velocity,
            x0=low + share * (1 - low),
            method="SLSQP",
            bounds=list(zip(low, (1.0, 1.0), strict=True)),
            constraints={"type": "ineq", "fun": short},
            options={"ftol": 1e-14, "maxiter": 200},
        )
        for share in (1.0, 0.9, 0.5)
    ]
    # At the optimum, rounding can end a line search without a word of success: what counts is that constraints hold.
    feasible = [f for f in tried if (short(f.x) > -FEASIBLE).all()]
    if not feasible:
        raise ValueError(f"least_speed: no optimum found ({tried[0].message}); change the limits")
    return at(min(feasible, key=lambda f: f.fun).x)


def nearest_in_whole_degrees(pump: Pump, pressure: float) -> Impeller:
    """The impeller with beta_1 and alpha_2 in whole degrees and a loading up to 1 that is nearest in pressure (Pa)."""
    pairs = ((b, a) for b in range(1, 90) for a in range(1, 90))
    found = (impeller(pump, radians(b), radians(a)) for b, a in pairs if tan(radians(a)) + tan(pump.outlet_angle) > 0)
    return min((i for i in found if i.loading <= 1), key=lambda i: abs(i.pressure - pressure))
