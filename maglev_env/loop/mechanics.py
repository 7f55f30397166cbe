"""The mechanics' block: the rotor's mass, its support, friction and a second body on the rotor."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop import bodies
from maglev_env.loop.card import EffectCard, Parameter, relative
from maglev_env.loop.exponential import faded
from maglev_env.loop.magnets import rows
from maglev_env.loop.resonance import RESONANCE_DAMPING, RESONANCE_FREQUENCY, further_mode
from maglev_env.loop.system import System, Values
from maglev_lanes.elementary import root
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "mass": EffectCard(
        "mechanics",
        relative((-0.2, -0.03, 0.03, 0.3)),
        "relative change of the moving mass",
        "force and displacement",
        nominal="mass",
    ),
    "support_stiffness": EffectCard(
        "mechanics",
        relative((-0.2, -0.03, 0.03, 0.3)),
        "relative change of the support's stiffness, D Table 5.1",
        "force and displacement",
        ("support",),
        nominal="support_stiffness",
        describes=True,
    ),
    "damping": EffectCard(
        "mechanics",
        {
            # 1 N s/m is 1 / 1600 of the mass over the control period of a rotor of 80 g at 20 kHz.
            "coefficient": Parameter(
                "N s/m",
                -0.0625,
                0.625,
                scale=6.25e-4,
                starts=(-1.25e-3, 6.25e-4, 0.0125),
                per="mass / control period",
            )
        },
        "viscous damping added to the support",
        "force and displacement",
        form_share=0.005,
        describes=True,
    ),
    "friction": EffectCard(
        "mechanics",
        {
            "force": Parameter("N", 0.0, 1e4, scale=0.02, starts=(0.05,)),
            "velocity": Parameter("m/s", 1e-5, 10.0, 1e-3, starts=(3e-4, 3e-3)),
            # The smallest presliding distance has no visible effect; it represents friction without presliding.
            "presliding": Parameter("m", 1e-9, 1e-3, 0.0, starts=(1e-9, 3e-7, 3e-6)),
            "static": Parameter("", 1.0, 5.0, 1.0, scale=1.0, shape=0.3),
            "gradual": Parameter("", 0.0, 1.0, 0.0, scale=1.0, shape=1.0),
            "stribeck": Parameter("m/s", 1e-6, 10.0, 2e-3, shape=1.0),
            "viscous": Parameter("N s/m", 0.0, 0.625, 0.0, scale=6.25e-4, shape=1.5e-4, per="mass / control period"),
        },
        "Coulomb friction, smooth about rest: F v / sqrt(v^2 + v_s^2); with presliding z_s it sticks: F z / z_s, "
        "dz/dt = v - sqrt(v^2 + v_s^2) z / (z_s g) (Dahl 1968; Canudas de Wit et al. 1995), with the share of static "
        "friction g = 1 + (static - 1) e^-(v / stribeck)^2; gradual goes from Dahl's exponent 1 to 1/2, whose loops "
        "are those of many springs that slip one after another (Iwan 1966); viscous adds to the damping",
        "force and displacement at two amplitudes",
        flexible=True,
        linear=False,
        form_share=0.02,
        dither="maybe",
        plain_kernel=("viscous",),
        describes=True,
    ),
    "support_resonance": EffectCard(
        "mechanics",
        {
            "frequency": RESONANCE_FREQUENCY,
            "damping_ratio": RESONANCE_DAMPING,
            "mass_ratio": Parameter("", 0.0, 2.0, 0.05, scale=0.02, starts=(0.01,)),
            # 1: mover and bodies together were weighed, as of a rotor that bends. A support that gives way shows the
            # same, because its mode is added to the motion of the whole mass. What hangs below one magnet is small and
            # stiff.
            "inside": Parameter("", 0.0, 1.0, 0.0, scale=1.0, shape=1.0, needs=("pair",)),
            **further_mode(Parameter("", 0.0, 2.0, 0.0, scale=0.02, shape=0.1, added=True)),
        },
        "a second body on a spring on the mover (a support that gives way, a rotor that bends); frequency: that of the "
        "second body while the mover is fixed; in other forms the part `inside` of its mass is in the stated one, and "
        "there is a further body, at a multiple of that frequency",
        "force and displacement across the resonance",
        flexible=True,
        resonance=True,
        form_share=0.003,
        plain_kernel=("inside",),
    ),
    "cross_coupling": EffectCard(
        "mechanics",
        {"ratio": Parameter("", -0.9, 0.9, scale=0.05, starts=(-0.05, 0.05))},
        "each axis' magnet force also pushes the other axis, by this ratio",
        "displacement of both axes, excited in turn",
        ("magnets", "two_axes"),
        not_sealed="the sealed twin has one axis",
        describes=True,
    ),
}


MOTION = ("position", "velocity")
STATES = ("bristle", *bodies.BODY, *bodies.FURTHER)


def support(system: System, values: Values) -> np.ndarray:
    """Signal of the force (N) by the support and by friction linearised at rest.

    The bristles of friction that sticks act as a spring in series with the viscous slip.
    """
    velocity = system.signal(MOTION[1])
    rub, slip, presliding, static = (
        values.effect("friction", key) for key in ("force", "velocity", "presliding", "static")
    )
    sticks = presliding > 0
    smooth = springs(system, values) - np.where(sticks, 0.0, rub / slip)[:, None] * velocity
    if system.without(("bristle",), sticks):
        return smooth
    bent = system.signal("bristle")
    gives_way = np.where(sticks, presliding, 1.0)[:, None]
    system.put("bristle", (velocity - (slip / static)[:, None] * bent) / gives_way, sticks)
    springing = np.where(sticks, rub, 0.0)
    return smooth - springing[:, None] * bent


def springs(system: System, values: Values) -> np.ndarray:
    """Signal of the force (N) by the support's spring and damper."""
    position, velocity = (system.signal(name) for name in MOTION)
    stiffness = values.rig("support_stiffness") * (1 + values.effect("support_stiffness"))
    damping = values.rig("support_damping") + values.effect("damping") + values.effect("friction", "viscous")
    return -stiffness[:, None] * position - damping[:, None] * velocity


def motion(system: System, values: Values, acceleration: np.ndarray) -> None:
    """Write the rotor's equations of motion, and those of the bodies on it.

    Args:
        system: with all of MOTION and STATES.
        values: of its lanes.
        acceleration: signal of the rotor's acceleration by bearing and held force, m per unit of time squared.
    """
    system.integrate(MOTION)
    system.put(MOTION[1], bodies.with_bodies(system, values, acceleration))


# Rows of a lane (see `maglev_lanes.layout`). Velocities are stored as h v and accelerations as h^2 a, in m. STEPS:
# number of steps until touchdown. CROSS_...: coupling of the other axis' displacement, velocity and calibrated current
# into this axis.
Y, V, ALIVE, STEPS, PER_MASS, LIMIT_SQ, SPRING, DAMPER, CROSS_SPRING, CROSS_DAMPER, CROSS_GAIN, _FRICTION = rows_after(
    rows.END, "Y V ALIVE STEPS PER_MASS LIMIT_SQ SPRING DAMPER CROSS_SPRING CROSS_DAMPER CROSS_GAIN"
)
# Friction. BENT: deflection of the bristles of friction that sticks, as a share of the deflection at which they slide;
# SLIP_SQ: the slip velocity squared; PER_BEND: relative deflection per m of motion.
# STATIC: share of the static friction beyond the sliding one; PER_STRIBECK: one over the velocity at which it is gone.
# STEADY: 1 - gradual; ROOTED: gradual / (1 - gradual).
BENT, FRICTION, SLIP_SQ, PER_BEND, STATIC, PER_STRIBECK, STEADY, ROOTED, END = rows_after(
    _FRICTION, "BENT FRICTION SLIP_SQ PER_BEND STATIC PER_STRIBECK STEADY ROOTED"
)
LEAST_STEADY = 1e-3  # rounding errors of a difference that is divided by STEADY stay below 1e-5
SIXTH = 1.0 / 6.0


def fill(x: LaneRows, values: Values, h: np.ndarray) -> None:
    """Write the constants of the mechanics for integration steps of h (s), (n,)."""
    # The kernel's velocity is h v and its acceleration h^2 a, so every force carries h^2 / m.
    per_mass = h**2 / values.mass
    x[ALIVE], x[PER_MASS] = 1.0, per_mass
    x[SPRING] = values.rig("support_stiffness") * (1 + values.effect("support_stiffness")) * per_mass
    damping = values.rig("support_damping") + values.effect("damping") + values.effect("friction", "viscous")
    x[DAMPER] = damping * per_mass / h
    # The force law is singular where the rotor touches a pole, so contact is assumed just before that.
    nearest = 1 + np.minimum(values.effect("force_law", "offset"), 0.0)
    change, share = (values.effect("negative_stiffness", key) for key in ("change", "distance_share"))
    nearest = nearest / np.maximum((1 + change) ** share, 1.0)  # of magnets that are nearer
    centred = np.maximum(0.999 * nearest * values.rig("gap") - abs(values.effect("eccentricity")), 0.0)
    x[LIMIT_SQ] = np.minimum(values.rig("clearance"), centred) ** 2
    x[FRICTION] = friction = values.effect("friction") * per_mass
    slip, bristle = values.effect("friction", "velocity") * h, values.effect("friction", "presliding")
    # If the friction force could reverse the velocity within one step, the solution would chatter about rest. The slip
    # velocity therefore has a lower bound.
    x[SLIP_SQ] = np.where(bristle > 0, slip, np.maximum(slip, 0.5 * friction)) ** 2
    # Likewise the bristles' spring is limited to one radian per step, which delays stiffer bristles by up to a quarter
    # of a step.
    x[PER_BEND] = np.where(bristle > 0, 1 / np.maximum(np.where(bristle > 0, bristle, 1.0), friction), 0.0)
    x[STATIC] = values.effect("friction", "static") - 1
    x[PER_STRIBECK] = 1 / (values.effect("friction", "stribeck") * h)
    x[STEADY] = steady = np.maximum(1 - values.effect("friction", "gradual"), LEAST_STEADY)
    x[ROOTED] = (1 - steady) / steady


def friction_rate(values: Values) -> np.ndarray:
    """Rate (1/s) at which friction stops the mover or, where it sticks, swings it, at rest, (n,)."""
    held, slip, bristle = (values.effect("friction", key) for key in ("force", "velocity", "presliding"))
    swings = np.sqrt(held / (values.mass * np.where(bristle > 0, bristle, 1.0)))
    return np.where(bristle > 0, swings, held / (values.mass * slip))


@piece
def position(x, k):
    return x[k + Y]


@piece
def velocity(x, k):
    return x[k + V]


@piece
def held_force(x, k, force):
    """Acceleration by an external force (N)."""
    return force * x[k + PER_MASS]


@piece
def spring(x, k, y):
    """Deceleration by the support's spring at the displacement y."""
    return x[k + SPRING] * y


@piece
def damping(x, k, v):
    """Deceleration by the support's damper."""
    return x[k + DAMPER] * v


@piece
def sliding(x, k, v):
    """Deceleration by friction that depends on the velocity only."""
    return x[k + FRICTION] * v / root(v * v + x[k + SLIP_SQ])


@piece
def cross_force(x, k, y, current):
    """Acceleration of this axis by the displacement and the current of the other one."""
    return x[k + CROSS_GAIN] * current - x[k + CROSS_SPRING] * y


@piece
def cross_damping(x, k, v):
    """Deceleration of this axis by the velocity of the other one."""
    return x[k + CROSS_DAMPER] * v


# Friction that sticks: its force depends on the distance that the mover has travelled, not on its velocity.
@piece
def bristles(x, k):
    """Relative deflection of the bristles at the start of the step, -1 .. 1."""
    return x[k + BENT]


@piece
def deflect_bristles(x, k, bent, moved):
    """Relative deflection of the bristles after half a step in which the mover moved by `moved` (m).

    The result is exact at constant velocity, and without slip velocity (Dahl) for any motion that does not reverse. It
    stays within -1 .. 1 for any stiffness of the bristles.
    """
    path = root(moved * moved + 0.25 * x[k + SLIP_SQ])
    toward = moved / path
    return toward + (bent - toward) * faded(path * x[k + PER_BEND])


@piece
def deflect_bristles_shaped(x, k, bent, moved):
    """The same with the Stribeck effect, by which slow motion slides only beyond the static friction, 1 + STATIC, and
    with a gradual slip.

    With w, the deflection that is still missing as a share of the level, dw = -((1 - gradual) w + gradual sqrt(w)) ds
    along the path s. This is linear in sqrt(w), so that a step along a straight path is exact.
    """
    path = root(moved * moved + 0.25 * x[k + SLIP_SQ])
    speed = 2.0 * moved * x[k + PER_STRIBECK]
    level = 1.0 + x[k + STATIC] * faded(speed * speed)
    toward = level * (moved / path)
    missing = root(abs(bent - toward) / level)
    kept = faded(0.5 * x[k + STEADY] * path * x[k + PER_BEND] / level)
    left = max(missing * kept - x[k + ROOTED] * (1.0 - kept), 0.0) / max(missing, 1e-12)
    return toward + (bent - toward) * (left * left)


@piece
def friction(x, k, bent):
    """Deceleration by the bristles at the relative deflection `bent`."""
    return x[k + FRICTION] * bent


@piece
def store_bristles(x, k, bent):
    x[k + BENT] = bent
    return 0.0


# Motion of a free mass: _middle and _end assume a constant acceleration a; _next is Nystrom's quadrature of the
# accelerations at the start (a1), the middle (am) and the end (a4) of the step.
@piece
def y_middle(x, k, y, v, a):
    return y + 0.5 * v + 0.125 * a


@piece
def v_middle(x, k, v, a):
    return v + 0.5 * a


@piece
def y_end(x, k, y, v, a):
    return y + v + 0.5 * a


@piece
def v_end(x, k, v, a):
    return v + a


@piece
def y_next(x, k, y, v, a1, am, a4):
    return y + v + (a1 + 2.0 * am) * SIXTH


@piece
def v_next(x, k, v, a1, am, a4):
    return v + (a1 + 4.0 * am + a4) * SIXTH


@piece
def touch_down(x, k, distance_sq):
    """1 while the lane continues, 0 after touchdown: nothing beyond the clearance is simulated."""
    alive = x[k + ALIVE] if distance_sq < x[k + LIMIT_SQ] else 0.0
    x[k + ALIVE] = alive
    return alive


@piece
def store_state(x, k, y, v, alive):
    """Store the motion, and count the step; after touchdown a lane keeps its position."""
    x[k + STEPS] += alive
    x[k + Y] = y if alive > 0.0 else x[k + Y]
    x[k + V] = v * alive
    return 0.0
