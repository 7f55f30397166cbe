"""The parts of a rotor as its file describes them: body, planes, support, unbalance, runout, fluid and touchdown."""

from dataclasses import dataclass, fields
from math import log1p
import numpy as np
import scipy
from maglev_env.fields import check_range, quantity


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
        off = f - (np.interp(0.0, z, f) if z[0] <= 0 <= z[-1] else 0.0)
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
