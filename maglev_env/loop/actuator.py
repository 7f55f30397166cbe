"""The actuator's block: from the coil's current to the force on the rotor."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite

import numpy as np

from maglev_env.loop import eddy, saturation
from maglev_env.loop.amplifier import X2
from maglev_env.loop.card import EffectCard, Parameter, relative
from maglev_env.loop.exponential import faded
from maglev_env.loop.magnets.knee import creeping_share
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, linearise
from maglev_env.loop.magnets.powers import exponential, logarithm
from maglev_env.loop.magnets.rows import DECAY, EXPONENT, PER_GAP
from maglev_env.loop.system import System, Values
from maglev_lanes.elementary import root
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece


def _knee() -> Parameter:
    """A current that saturates."""
    return Parameter("A", 1e-3, 1e4, inf, absent=inf, shape=2.0, starts=(0.1, 0.3, 1.0), beyond_rest=True)


EFFECTS: Mapping[str, EffectCard] = {
    "actuator_gain": EffectCard(
        "actuator",
        {
            **relative((-0.3, -0.05, 0.05, 0.4, 1.5, 3.5)),
            "force_share": Parameter("", 0.0, 1.0, 0.0, scale=1.0, shape=0.5, centre=0.5),
        },
        # With 0 the current that pulls is another one, as of an amplifier or of windings. With 1 every current pulls
        # more, as of another force constant. They differ in what the square of the current does.
        "relative change of df/di: D 5.2.3 measures 5.7, eq 3.13 1.28; (1 + change)^(1 - force_share) scales the "
        "current, the rest the force",
        "current, force and displacement",
        ("magnets",),
        nominal="actuator_gain",
        plain_kernel=("force_share",),
    ),
    "negative_stiffness": EffectCard(
        "actuator",
        {
            **relative((-0.7, -0.4, -0.15, 0.2, 1.0)),
            "distance_share": Parameter("", -0.5, 1.0, 0.0, scale=1.0, shape=0.75, centre=0.25),
        },
        # With 0 the pull without current is scaled over the gap. With 1 all distances of the law are divided by
        # 1 + change, as of magnets that are nearer. With -0.5 the pull of a pair without current changes by a constant
        # stiffness, to third order. The prior reaches both ends, of which 1 is the likelier one on a bench.
        "relative change of -df/dy at y = 0, D eq 3.12; in another form, distances are divided by (1 + change)^share",
        "current, force and displacement",
        ("magnets",),
        nominal="negative_stiffness",
        plain_kernel=("distance_share",),
        describes=True,
    ),
    "force_law": EffectCard(
        "actuator",
        {
            "exponent": Parameter("", -3.0, 40.0, scale=0.05, starts=(-0.5, -0.05, 0.05, 0.5, 3.0)),
            "offset": Parameter("", -0.8, 20.0, 0.0, scale=0.1, starts=(-0.3, 0.5, 4.0)),
        },
        "the pull falls off otherwise with the gap: 1 / (x + offset gap)^(n + exponent) for 1 / x^n, the same at y = 0",
        "current and displacement at two static offsets or gaps",
        ("magnets",),
        like="negative_stiffness",
        form_share=0.01,
        describes=True,
    ),
    **eddy.EFFECTS,
    "hysteresis": EffectCard(
        "actuator",
        {
            "strength": Parameter("", 0.0, 0.9, scale=0.05, starts=(0.05, 0.3)),
            "width": Parameter("A", 1e-4, 1e4, 0.1, starts=(0.01, 0.05, 0.2), sought=100.0),
            "power": Parameter("", 0.2, 20.0, 1.0, shape=0.6),
            "unloading": Parameter("", -1.0, 1.0, 1.0, scale=1.0, shape=1.0),
            # Noise and ripple move the current to and fro. Their way counts as any other does, and wipes out what the
            # iron remembers: the loop that the slow current traces becomes narrower, until only a lag in time is left.
            "ripple": Parameter("A/s", 0.0, 1e5, 0.0, shape=1.5, centre=10.0),
        },
        "a share of the current lags by a width in A, by Dahl's rate-independent model (Dahl 1968); in another form by "
        "that of Bouc and Wen (Wen 1976): dz/dx = 1 - |z|^power while loading, 1 + unloading |z|^power on the way "
        "back, where the way is sqrt(di^2 + (ripple dt)^2) under noise or ripple of so many A/s (dither, Zames and "
        "Shneydor 1976)",
        "current and displacement at two amplitudes",
        ("magnets",),
        flexible=True,
        linear=False,
        form_share=0.1,
        dither="maybe",
        describes=True,
    ),
    "saturation": EffectCard(
        "actuator",
        {
            "field": Parameter(
                "T",
                0.01,
                1000.0,
                inf,
                absent=inf,
                starts=(1.2, 1.8, 2.6, 4.0),
                starts_per="field at rest",
                needs=("pair",),
            ),
            "sharpness": Parameter("", 1.0, 100.0, 4.0, shape=0.8),
            "current": _knee(),
            "command": _knee(),
            "creep": Parameter("", 0.0, 0.6, 0.0, scale=1.0, shape=0.2, needs=("yoke",)),
            "distance_share": Parameter("", 0.0, 1.5, 0.0, scale=1.0, shape=0.5, centre=0.5, needs=("iron",)),
        },
        # With 0 the current of the knee is the same at every distance. With 1 the flux of a single magnet saturates,
        # which goes with the root of its pull: nearer, less current makes it. Iron whose field strength is the power n
        # of the flux never stops, it creeps; and its knee goes with the distance a little more, by n / (n - 1). That of
        # a pair's field, in series with the gap, does so by itself (`magnets.law`).
        "the iron saturates: B of each gap becomes B / (1 + |B / B_s|^sharpness)^(1 / sharpness); with current or "
        "command, so does the current that pulls, or the command: of a pair the control current, of a single magnet "
        "all of it, with the current that carries the weight; with a creep c the exponent is (1 - c) / sharpness, so "
        "that far beyond the knee it still grows, as the power c of what is asked for, and B_s goes with the gap to "
        "the power c / (1 - c), as of iron in series with it",
        "current and displacement at two amplitudes",
        ("magnets",),
        form_share=0.01,
        describes=True,
    ),
    "actuator_offset": EffectCard(
        "actuator",
        {"current": Parameter("A", -10.0, 10.0, scale=0.02, starts=(-0.2, -0.02, 0.02, 0.2), within_bias=True)},
        "a constant error of the force-producing current, for instance a drifted zero of the amplifier",
        "displacement and current at two static offsets",
        ("magnets",),
        flexible=True,
        linear=False,  # the tangent of a pair changes only with the square of the offset
    ),
    "eccentricity": EffectCard(
        "actuator",
        {"offset": Parameter("m", -0.01, 0.01, scale=1e-5, starts=(-4e-5, -5e-6, 5e-6, 4e-5))},
        "the magnetic centre is offset from the sensed one, or the zero of the displacement is, D 5.2.3",
        "displacement at two static offsets",
        ("magnets",),
        flexible=True,
    ),
}


REMEMBERED = ("remembered",)  # by the iron, of a current whose ripple wipes it out
STATES = (*eddy.STATES, *REMEMBERED)


def pulling_current(system: System, values: Values, current: np.ndarray) -> np.ndarray:
    """The force-producing current from the coil's current, with the tangents of hysteresis and of a knee at rest.

    For currents far below its width, hysteresis subtracts its whole strength; under ripple, what it remembers follows
    the current by a lag of width / ripple.

    Args:
        system: with all of STATES, whose equations are written.
        values: of its lanes.
        current: signal of the coil's current, A.

    Returns:
        Signal of the force-producing current, A.
    """
    pulls = eddy.pulling_current(system, values, current)
    through, _ = saturation.slopes(values)
    strength, width, ripple = (values.effect("hysteresis", key) for key in (None, "width", "ripple"))
    forgotten = current
    if not system.without(REMEMBERED, forgets := (strength > 0) & (ripple > 0)):
        remembered = system.signal(REMEMBERED[0])
        forgotten = current - np.where(forgets, 1.0, 0.0)[:, None] * remembered
        system.put(REMEMBERED[0], (system.step * ripple / width)[:, None] * (current - remembered), forgets)
    return through[:, None] * (pulls - strength[:, None] * forgotten)


def force(values: Values, pulling: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Force of the magnets, linearised at their eccentricity and i = 0.

    Args:
        values: of the lanes.
        pulling: signal of the force-producing current, A.
        displacement: signal of the rotor's displacement, m.

    Returns:
        Signal of the force, N.
    """
    knees = zip(*(values.effect("saturation", key).tolist() for key in ("field", "sharpness", "creep")), strict=True)
    laws = [
        replace(law, saturation=field, sharpness=sharpness, creep=creep) if isfinite(field) else law
        for law, (field, sharpness, creep) in zip(values.laws, knees, strict=True)
    ]
    gain, stiffness = _tangents(values, laws, values.effect("eccentricity"))
    stiffness = stiffness - gain * saturation.slope_by_nearness(values)
    return gain[:, None] * pulling - stiffness[:, None] * displacement


def current_scale(values: Values) -> np.ndarray:
    """Factor (n,) on the current by the calibrated force law (1 without magnets) and the effect actuator_gain."""
    return np.array([law.gain_scale if law else 1.0 for law in values.laws]) * (1 + values.effect("actuator_gain"))


def central_tangent(values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Actuator gain (N/A) and stiffness (N/m) of centred, unsaturated magnets, (n,) each; 0 without magnets."""
    return _tangents(values, values.laws, np.zeros(len(values.laws)))


def _tangents(
    values: Values, laws: Sequence[ForceLaw | SingleSidedLaw | None], offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Actuator gain and stiffness of laws at offsets (m), with the effects that scale them."""
    places = list(zip(map(id, laws), offset.tolist(), strict=True))  # lanes of one rig share the law itself
    known = {at: linearise(law, at[1]) if law else (0.0, 0.0) for at, law in zip(places, laws, strict=True)}
    found = [known[at] for at in places]
    gain, stiffness = np.array(found).T
    return gain * (1 + values.effect("actuator_gain")), stiffness * (1 + values.effect("negative_stiffness"))


# Rows of a lane. HELD: state of Dahl's hysteresis, -1 .. 1; HOLD: largest current by which the force lags, A;
# PER_WIDTH: one over the width, 1/A; ZERO: force-producing current at zero coil current, A. Of other forms, POWER: its
# exponent less one, UNLOADING; RIPPLE_SQ: the way of the ripple in a step over the width, squared; PER_KNEE: one over
# the current that saturates, 1/A; SHARPNESS, FALL: of that knee; NEARNESS: half the share with which it goes with
# the flux; CARRIES, PULLS: what the coil carries at rest, A, and what of it pulls.
HELD, HOLD, PER_WIDTH, ZERO, POWER, UNLOADING, RIPPLE_SQ, _KNEE = rows_after(
    eddy.END, "HELD HOLD PER_WIDTH ZERO POWER UNLOADING RIPPLE_SQ"
)
PER_KNEE, SHARPNESS, FALL, NEARNESS, CARRIES, PULLS, END = rows_after(
    _KNEE, "PER_KNEE SHARPNESS FALL NEARNESS CARRIES PULLS"
)
STILL = 1e-24  # least square of a relative way in a step: nothing is divided by zero, and nothing forgotten


def fill(x: LaneRows, values: Values, h: np.ndarray) -> None:
    """Write the constants of hysteresis, of the actuator's offset and of a current that saturates, for integration
    steps of h (s), (n,)."""
    width, scale = values.effect("hysteresis", "width"), current_scale(values)
    x[HOLD], x[PER_WIDTH] = scale * values.effect("hysteresis") * width, 1 / width
    x[ZERO] = scale * values.effect("actuator_offset")
    x[POWER], x[UNLOADING] = values.effect("hysteresis", "power") - 1, values.effect("hysteresis", "unloading")
    x[RIPPLE_SQ] = (values.effect("hysteresis", "ripple") * h / width) ** 2 + STILL
    x[PER_KNEE] = 1 / (scale * values.effect("saturation", "current"))
    x[SHARPNESS], x[FALL] = values.effect("saturation", "sharpness"), saturation.fall(values)
    x[NEARNESS] = values.effect("saturation", "distance_share") / 2
    pulls, carries, _ = saturation.at_rest(values)
    x[CARRIES], x[PULLS] = scale * carries, scale * pulls


@piece
def hold(x, k):
    """Coil current minus force-producing current at the start of the step, A: hysteresis minus the offset."""
    return x[k + HOLD] * x[k + HELD] - x[k + ZERO]


@piece
def hold_at(x, k, held):
    """The same difference of currents for a given state of the hysteresis."""
    return x[k + HOLD] * held - x[k + ZERO]


@piece
def held_next(x, k, x2):
    """State of the hysteresis at the end of a step in which the coil's current changes to x2 (Dahl 1968)."""
    change = x2 - x[k + X2]
    toward = 1.0 if change > 0.0 else -1.0
    return toward + (x[k + HELD] - toward) * faded(abs(change) * x[k + PER_WIDTH])


@piece
def held_next_shaped(x, k, x2):
    """The same by the model of Bouc and Wen under ripple, in two steps that are exact where its exponent is one."""
    change = (x2 - x[k + X2]) * x[k + PER_WIDTH]
    path = root(change * change + x[k + RIPPLE_SQ])
    toward, z = change / path, x[k + HELD]
    half = _moved(z, toward, 0.5 * path, _slowing(x, k, z, change))
    z = _moved(z, toward, path, _slowing(x, k, half, change))
    return min(max(z, -1.0), 1.0)


@piece
def _slowing(x, k, z, change):
    """c of dz/dx = s - c z, with the direction s of the change."""
    size = max(abs(z), 1e-3)
    return exponential(x[k + POWER] * logarithm(size)) * (1.0 if z * change > 0.0 else x[k + UNLOADING])


@piece
def _moved(z, toward, path, slowing):
    """The state after a relative path of the current at a constant c."""
    way = slowing * path
    left = exponential(-way)
    share = 1.0 - 0.5 * way if abs(way) < 1e-5 else (1.0 - left) / way
    return z * left + toward * path * share


@piece
def saturated_current(x, k, y, current):
    """The force-producing current of a saturating pair."""
    return current * creeping_share(abs(current) * x[k + PER_KNEE], x[k + SHARPNESS], x[k + FALL])


@piece
def saturated_current_near(x, k, y, current):
    """That of a saturating single magnet at a displacement, beside what pulls at rest."""
    steep = y * x[k + DECAY] - x[k + EXPONENT] * logarithm(1.0 - y * x[k + PER_GAP])
    whole = current + x[k + CARRIES]
    size = abs(whole) * x[k + PER_KNEE] * exponential(x[k + NEARNESS] * steep)
    return whole * creeping_share(size, x[k + SHARPNESS], x[k + FALL]) - x[k + PULLS]


@piece
def store_held(x, k, held):
    x[k + HELD] = held
    return 0.0
