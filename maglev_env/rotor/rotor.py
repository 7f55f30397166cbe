"""A free rigid rotor in two radial bearings, read from a TOML file (schema maglev-rotor/1) and checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any


from maglev_env.channels import SENSORS
from maglev_env.design.motor import Motor
from maglev_env.design.thermal import ThermalMass
from maglev_env.fields import is_number
from maglev_env.loop.gains import Gains
from maglev_env.rig.rig_file import ROTOR_FOLDER, ROTORS, load_rig
from maglev_env.rig.rig import Rig
from maglev_env.rig.self_sensor import check_in_loop, self_sensor
from maglev_env.fields import check_known, increasing_pair, table_as, toml_tables, toml_text
from maglev_env.rotor.parts import Axial, Body, Fluid, Planes, Rejection, Runout, Touchdown, Unbalance
from selfsense.sensor import SelfSensor

SCHEMA = "maglev-rotor/1"
# Inputs of the two controllers of each direction: the centre of mass and half the difference of both planes, or each
# plane; see `linear.control_matrices`.
CONTROLS = (("translation", "tilt"), ("a", "b"))


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
        known: The rotor by whose model the rejection and the estimators are designed, where that is not the rotor
            itself (a drawn one).
        sensor: What the controllers read: "probe", or "self_sensing" by the coils of the four radial axes, as the
            axis' [self_sensing] describes them, or a self-sensor, one like it at each coil. The probes then only watch.
    """

    name: str
    axis: Rig
    body: Body
    planes: Planes
    axial: Axial
    gains: Mapping[str, Gains]
    unbalance: Unbalance = field(default_factory=Unbalance)
    runout: Runout = field(default_factory=Runout)
    fluid: Fluid = field(default_factory=Fluid)
    touchdown: Touchdown = field(default_factory=Touchdown)
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    motor: Motor | None = None
    thermal: ThermalMass | None = None
    rejection: Rejection | None = None
    known: "Rotor | None" = None
    sensor: str | SelfSensor = "probe"

    def __post_init__(self) -> None:
        if tuple(self.gains) not in CONTROLS:
            raise ValueError(f"[gains]: {', '.join(self.gains)}; give translation and tilt, or a and b")
        if self.axis.axes != 1 or "pair" not in self.axis.capabilities:
            raise ValueError(f"axis: rig {self.axis.name} is not one axis of a pair of magnets")
        held = [name for name in ("support_stiffness", "support_damping") if getattr(self.axis, name)]
        if without := [*held, *(f"[effects.{name}]" for name in self.axis.effects)]:
            raise ValueError(
                f"axis: rig {self.axis.name} states {', '.join(without)}, which a rotor does not have; leave it out, "
                "and give what holds the rotor beside its magnets in [fluid]"
            )
        if not (isinstance(self.gravity, tuple) and len(self.gravity) == 3) or not all(map(is_number, self.gravity)):
            raise ValueError(f"gravity = {self.gravity!r}; give three accelerations, m/s2")
        load = abs(self.gravity[2]) * self.body.mass
        if load > self.axial.capacity:
            raise ValueError(
                f"gravity: an axial load of {load:.3g} N is beyond the passive force of {self.axial.capacity:.3g} N "
                f"at the axial clearance"
            )

        if not isinstance(self.sensor, SelfSensor) and self.sensor not in SENSORS:
            raise ValueError(f"sensor = {self.sensor!r}; use {' or '.join(SENSORS)}, or a SelfSensor")
        if self.self_sensor is not None:
            check_in_loop(self.self_sensor)

    @property
    def self_sensor(self) -> SelfSensor | None:
        """The self-sensor of each of the four coils that are read; None on the probes.

        Raises:
            ValueError: As `maglev_env.rig.self_sensor.self_sensor`.
        """
        if isinstance(self.sensor, SelfSensor):
            return self.sensor
        return None if self.sensor == "probe" else self_sensor(self.axis, (self.known or self).axis)

    @property
    def read_planes(self) -> tuple[float, float]:
        """Positions (m) at which the controllers read the displacement: of the probes, or of the magnets' coils."""
        return self.planes.probes if self.sensor == "probe" else self.planes.magnets

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
        return _build(toml_tables(text), Path(where).parent)
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
