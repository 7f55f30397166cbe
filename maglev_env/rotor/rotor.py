"""A free rigid rotor in two radial bearings, read from a TOML file (schema maglev-rotor/1) and checked."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import log1p
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from maglev_env.design.motor import Motor
from maglev_env.design.thermal import ThermalMass
from maglev_env.fields import is_number
from maglev_env.loop.gains import Gains
from maglev_env.rig.rig import ROTOR_FOLDER, ROTORS, Rig, load_rig
from maglev_env.fields import check_known, check_range, increasing_pair, quantity, table_as, toml_text

SCHEMA = "maglev-rotor/1"
# Inputs of the two controllers of each direction: the centre of mass and half the difference of both planes, or each
# plane; see `linear.control_matrices`.
CONTROLS = (("translation", "tilt"), ("a", "b"))


class _Checked:
    """Checks its own fields on construction."""

    def __post_init__(self) -> None:
        for f in fields(self):  # pyright: ignore[reportArgumentType]  # every subclass is a dataclass
            value = getattr(self, f.name)
            if f.metadata:
                check_range(f.name, value, f.metadata)
                continue
            if not isinstance(value, tuple):
                raise ValueError(f"{f.name} = {value!r} must be a list of numbers")
            for one in value:
                check_range(f.name, one, {"unit": "", "low": -1e9, "high": 1e9})


@dataclass(frozen=True)
class Body(_Checked):
    """The rotor's body.

    Attributes:
        mass: kg.
        transverse_inertia: About the centre of mass, across the axis, kg m2.
        polar_inertia: Along the axis, kg m2.
        radius: Of the surface, m.

    Raises:
        ValueError: Inertias that no body can have: the polar one is at most twice the transverse one.
    """

    mass: float = quantity("kg", 1e-6, 1e5)
    transverse_inertia: float = quantity("kg m2", 1e-12, 1e6)
    polar_inertia: float = quantity("kg m2", 1e-12, 1e6)
    radius: float = quantity("m", 1e-5, 10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.polar_inertia > 2 * self.transverse_inertia:
            raise ValueError(
                f"[body]: polar_inertia = {self.polar_inertia:g} kg m2 is more than twice transverse_inertia = "
                f"{self.transverse_inertia:g} kg m2: no body has that (triangle inequality)"
            )


@dataclass(frozen=True)
class Planes(_Checked):
    """Positions of magnets and probes along the axis, m from the centre of mass, a before b."""

    magnets: tuple[float, float]
    probes: tuple[float, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, pair in (("magnets", self.magnets), ("probes", self.probes)):
            if not (isinstance(pair, tuple) and len(pair) == 2 and pair[0] < pair[1]):
                raise ValueError(f"[planes]: {name} = {pair!r}; give two positions in m, bearing a comes before b")


@dataclass(frozen=True)
class Axial(_Checked):
    """The passive axial support of one bearing.

    Attributes:
        displacement: m.
        force: At these displacements, computed or measured, N.
        damping: Of both bearings, N s/m.
        clearance: m.
        probe_radius: Distance of an axial probe from the axis, m.
    """

    displacement: tuple[float, ...]
    force: tuple[float, ...]
    damping: float = quantity("N s/m", 0.0, 1e6, 0.0)
    clearance: float = quantity("m", 1e-6, 0.1, 5e-4)
    probe_radius: float = quantity("m", 0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self.displacement) == len(self.force) > 1 or list(self.displacement) != sorted(self.displacement):
            raise ValueError("[axial]: give as many forces as displacements, two or more, displacements increasing")
        if not self.stiffness > 0:
            raise ValueError(f"[axial]: a passive stiffness of {self.stiffness:g} N/m does not hold the rotor")

    @property
    def stiffness(self) -> float:
        """Stiffness of one bearing, N/m: least squares through zero force at rest, which follows from symmetry."""
        z, f = np.array(self.displacement), np.array(self.force)
        off = f - np.interp(0.0, z, f)
        return float(-(z @ off) / (z @ z))

    @property
    def capacity(self) -> float:
        """Axial load (N) that both bearings carry at the end of the clearance."""
        return 2 * self.stiffness * self.clearance


@dataclass(frozen=True)
class Unbalance(_Checked):
    """static: mass times eccentricity, kg m; couple: product of inertia, kg m2; angle between them, degrees."""

    static: float = quantity("kg m", 0.0, 1.0, 0.0)
    couple: float = quantity("kg m2", 0.0, 1.0, 0.0)
    angle: float = quantity("deg", -360.0, 360.0, 0.0)


@dataclass(frozen=True)
class Runout(_Checked):
    """Reading of each probe plane once per turn without motion: amplitude m, phase degrees."""

    amplitude: tuple[float, float] = (0.0, 0.0)
    phase: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self.amplitude) == len(self.phase) == 2:
            raise ValueError("[runout]: give two amplitudes and two phases, of probe planes a and b")


@dataclass(frozen=True)
class Fluid(_Checked):
    """Effect of a fluid: mass kg, transverse inertia kg m2; stiffness N/m and damping N s/m at each magnet plane."""

    added_mass: float = quantity("kg", 0.0, 1e5, 0.0)
    added_inertia: float = quantity("kg m2", 0.0, 1e6, 0.0)
    stiffness: float = quantity("N/m", -1e9, 1e9, 0.0)
    damping: float = quantity("N s/m", 0.0, 1e7, 0.0)


@dataclass(frozen=True)
class Rejection(_Checked):
    """Rejection of the unbalance force: a generalised notch at the speed of rotation ahead of both controllers.

    Attributes:
        rate: At which the synchronous part of what the controllers read decays, 1/s. The faster, the wider the notch.
        from_speed: Least speed at which it acts, rpm.
    """

    rate: float = quantity("1/s", 0.1, 1e3, 10.0)
    from_speed: float = quantity("rpm", 1.0, 1e6, 500.0)


@dataclass(frozen=True)
class Touchdown(_Checked):
    """Contact at the clearance: stiffness N/m, restitution of an impact at a speed m/s, friction coefficient."""

    stiffness: float = quantity("N/m", 1.0, 1e10, 2e6)
    restitution: float = quantity("", 0.05, 1.0, 0.6)
    friction: float = quantity("", 0.0, 2.0, 0.15)
    speed: float = quantity("m/s", 1e-4, 100.0, 0.5)

    @property
    def damping(self) -> float:
        """Damping d, per m/s, in contact force = stiffness depth (1 + d speed) (Hunt and Crossley 1975).

        An impact at `speed` v must rebound at r v. The energy integral gives (1 + d v) exp(-d v) =
        (1 - r d v) exp(r d v), which is solved for d.
        """
        r = self.restitution
        if r == 1.0:
            return 0.0
        a = scipy.optimize.brentq(
            lambda a: log1p(a) - a - log1p(-r * a) - r * a, 1e-3 * (1 - r), (1 - 1e-12) / r, xtol=1e-14
        )
        return a / self.speed  # pyright: ignore[reportOperatorIssue]  # full_output is False


@dataclass(frozen=True)
class Rotor:
    """A free rotor.

    Attributes:
        name: Its name.
        axis: One radial axis of both bearings together (see `Rig`); each bearing has half of it.
        body: Its body.
        planes: Positions of magnets and probes.
        axial: Its passive axial support.
        gains: By what they act on (`CONTROLS`).
        unbalance: Its unbalance.
        runout: Its runout.
        fluid: Effect of a fluid.
        touchdown: Contact at the axis' clearance, in both planes.
        gravity: Along x, y and z, m/s2.
        bounds: Bounds of the gains.
        motor: Its motor, if known; the simulation keeps the given speed, whatever drives it.
        thermal: Its thermal mass, if known.
        rejection: Its rejection of unbalance forces; None: there is none.
        known: The rotor by whose model the rejection is designed, where that is not the rotor itself (a drawn one).
    """

    name: str
    axis: Rig
    body: Body
    planes: Planes
    axial: Axial
    gains: Mapping[str, Gains]
    unbalance: Unbalance = Unbalance()
    runout: Runout = Runout()
    fluid: Fluid = Fluid()
    touchdown: Touchdown = Touchdown()
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    motor: Motor | None = None
    thermal: ThermalMass | None = None
    rejection: Rejection | None = None
    known: "Rotor | None" = None

    def __post_init__(self) -> None:
        if tuple(self.gains) not in CONTROLS:
            raise ValueError(f"[gains]: {', '.join(self.gains)}; give translation and tilt, or a and b")
        if self.axis.axes != 1 or "pair" not in self.axis.capabilities:
            raise ValueError(f"axis: rig {self.axis.name} is not one axis of a pair of magnets")
        if not (isinstance(self.gravity, tuple) and len(self.gravity) == 3) or not all(map(is_number, self.gravity)):
            raise ValueError(f"gravity = {self.gravity!r}; give three accelerations, m/s2")
        load = abs(self.gravity[2]) * self.body.mass
        if load > self.axial.capacity:
            raise ValueError(
                f"gravity: an axial load of {load:.3g} N is beyond the passive force of {self.axial.capacity:.3g} N "
                f"at the axial clearance"
            )

    @property
    def moving_mass(self) -> float:
        """Moving mass, kg, with the fluid."""
        return self.body.mass + self.fluid.added_mass

    @property
    def moving_inertia(self) -> float:
        """Inertia across the axis, kg m2, with the fluid."""
        return self.body.transverse_inertia + self.fluid.added_inertia


def hollow_cylinder(mass: float, inner: float, outer: float, length: float) -> tuple[float, float]:
    """Transverse and polar inertia (kg m2) of a hollow cylinder; mass in kg, radii and length in m."""
    square = inner**2 + outer**2
    return mass * (3 * square + length**2) / 12, mass * square / 2


def load_rotor(source: str | Path) -> Rotor:
    """Load a preset by name, or a rotor TOML by path.

    Args:
        source: name of a preset, or path of a .toml file.

    Raises:
        ValueError: A value does not fit; the message names the file and key.
        OSError: The file cannot be read.
    """
    if str(source) in ROTORS:
        text, where = (ROTOR_FOLDER / f"{source}.toml").read_text(), str(source)
    else:
        path = Path(source)
        if path.suffix != ".toml":
            raise ValueError(f"rotor {str(source)!r} is neither a preset ({', '.join(ROTORS)}) nor a .toml file")
        text, where = toml_text(path, "rotor"), str(path)
    try:
        return _build(tomllib.loads(text), Path(where).parent)
    except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"{where}: {error}") from error


_TABLES: Mapping[str, type] = {
    "body": Body,
    "planes": Planes,
    "axial": Axial,
    "unbalance": Unbalance,
    "runout": Runout,
    "fluid": Fluid,
    "touchdown": Touchdown,
    "motor": Motor,
    "thermal": ThermalMass,
    "rejection": Rejection,
}


def _build(data: dict[str, Any], folder: Path) -> Rotor:
    if data.get("schema") != SCHEMA:
        raise ValueError(f'schema = {data.get("schema")!r}; a rotor file has schema = "{SCHEMA}"')
    check_known(data, ("schema", "name", "axis", "gravity", "gains", "bounds", *_TABLES), "top level")
    for key in ("name", "axis", "body", "planes", "axial", "gains"):
        if key not in data:
            raise ValueError(f"{key} is missing")
    for key in ("gains", "bounds", *_TABLES):
        if not isinstance(data.get(key, {}), dict):
            raise ValueError(f"[{key}] = {data[key]!r} must be a table")
    for key, gains in data["gains"].items():
        if not isinstance(gains, dict):
            raise ValueError(f"[gains] {key} = {gains!r} must be a table: [gains.{key}] with kp, ki, kd")
    parts = {
        name: table_as(cls, {name: {k: tuple(v) if isinstance(v, list) else v for k, v in data[name].items()}}, name)
        for name, cls in _TABLES.items()
        if name in data
    }
    gains = {name: table_as(Gains, data["gains"], name) for name in data["gains"]}
    bounds = {k: increasing_pair(v, f"[bounds] {k}") for k, v in data.get("bounds", {}).items()}
    check_known(bounds, [f.name for f in fields(Gains)], "[bounds]")
    source = data["axis"]
    axis = load_rig(folder / source if str(source).endswith(".toml") else source)
    gravity = data.get("gravity", [0.0, 0.0, 0.0])
    gravity = tuple(gravity) if isinstance(gravity, list) else gravity
    return Rotor(data["name"], axis, gains=gains, gravity=gravity, bounds=bounds, **parts)
