"""The actuator's block: what lies between the coil's current and the force on the rotor."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite

import numpy as np

from maglev_env.loop import eddy
from maglev_env.loop.amplifier import X2
from maglev_env.loop.card import EffectCard, Parameter, relative
from maglev_env.loop.exponential import faded
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, linearise
from maglev_env.loop.system import System, Values
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "actuator_gain": EffectCard(
        "actuator",
        relative((-0.3, -0.05, 0.05, 0.4, 1.5, 3.5)),
        "relative change of df/di: D 5.2.3 measures 5.7, eq 3.13 1.28",
        "current, force and displacement",
        ("magnets",),
        nominal="actuator_gain",
    ),
    "negative_stiffness": EffectCard(
        "actuator",
        relative((-0.7, -0.4, -0.15, 0.2, 1.0)),
        "relative change of -df/dy, D eq 3.12",
        "current, force and displacement",
        ("magnets",),
        nominal="negative_stiffness",
    ),
    **eddy.EFFECTS,
    "hysteresis": EffectCard(
        "actuator",
        {
            "strength": Parameter("", 0.0, 0.9, scale=0.05, starts=(0.05, 0.3)),
            "width": Parameter("A", 1e-4, 100.0, 0.1, starts=(0.01, 0.05, 0.2)),
        },
        "a share of the current lags by a width, as Dahl's rate-independent model has it (Dahl 1968)",
        "current and displacement at two amplitudes",
        ("magnets",),
        flexible=True,
        linear=False,
        form_share=0.2,
        dither="maybe",
    ),
    "saturation": EffectCard(
        "actuator",
        {"field": Parameter("T", 0.1, 100.0, absent=inf, starts=(0.7, 1.0, 1.5, 2.2))},
        "the iron bends: B^2 of each gap becomes B^2 / sqrt(1 + (B / B_s)^4)",
        "current and displacement at two amplitudes",
        ("pair",),
        form_share=0.02,
    ),
    "actuator_offset": EffectCard(
        "actuator",
        {"current": Parameter("A", -10.0, 10.0, scale=0.02, starts=(-0.2, -0.02, 0.02, 0.2))},
        "a constant error of the current that pulls, as a drifted zero of the amplifier makes",
        "displacement and current at two static offsets",
        ("magnets",),
        flexible=True,
        linear=False,  # the tangent of a pair changes with its square alone
    ),
    "eccentricity": EffectCard(
        "actuator",
        {"offset": Parameter("m", -0.01, 0.01, scale=1e-5, starts=(-4e-5, -5e-6, 5e-6, 4e-5))},
        "the magnetic centre lies beside the sensed one, D 5.2.3",
        "displacement at two static offsets",
        ("magnets",),
        flexible=True,
    ),
}


STATES = eddy.STATES


def pulling_current(system: System, values: Values, current: np.ndarray) -> np.ndarray:
    """From the coil's current to the one that pulls, both signals in A, with the tangent of hysteresis.

    For currents far below its width hysteresis takes its whole strength.
    """
    pulls = eddy.pulling_current(system, values, current)
    return pulls - values.effect("hysteresis")[:, None] * current


def force(values: Values, pulling: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    """Force (N) of the magnets about their eccentricity and i = 0.

    Args:
        values: of the lanes.
        pulling: the current that pulls, A.
        displacement: of the rotor, m.
    """
    laws = [
        replace(law, saturation=saturation) if isfinite(saturation) else law
        for law, saturation in zip(values.laws, values.effect("saturation").tolist(), strict=True)
    ]
    gain, stiffness = _tangents(values, laws, values.effect("eccentricity"))
    return gain[:, None] * pulling - stiffness[:, None] * displacement


def current_scale(values: Values) -> np.ndarray:
    """How the calibrated force law scales the current, (n,); 1 without magnets."""
    return np.array([law.gain_scale if law else 1.0 for law in values.laws]) * (1 + values.effect("actuator_gain"))


def central_tangent(values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Actuator gain (N/A) and stiffness (N/m) of centred magnets that do not saturate, (n,) each; 0 without magnets."""
    return _tangents(values, values.laws, np.zeros(len(values.laws)))


def _tangents(
    values: Values, laws: Sequence[ForceLaw | SingleSidedLaw | None], offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Actuator gain and stiffness of laws at offsets (m), with the effects that change them in proportion."""
    found = [linearise(law, y) if law else (0.0, 0.0) for law, y in zip(laws, offset.tolist(), strict=True)]
    gain, stiffness = np.array(found).T
    return gain * (1 + values.effect("actuator_gain")), stiffness * (1 + values.effect("negative_stiffness"))


# Rows of a lane. HELD: state of Dahl's hysteresis, -1 .. 1; HOLD: the current by which it lags, A; PER_WIDTH: 1 / A;
# ZERO: the current that pulls where the coil carries none, A.
HELD, HOLD, PER_WIDTH, ZERO, END = rows_after(eddy.END, "HELD HOLD PER_WIDTH ZERO")


def fill(x: LaneRows, values: Values) -> None:
    """Write the constants of hysteresis and of the offset."""
    width, scale = values.effect("hysteresis", "width"), current_scale(values)
    x[HOLD], x[PER_WIDTH] = scale * values.effect("hysteresis") * width, 1 / width
    x[ZERO] = scale * values.effect("actuator_offset")


@piece
def hold(x, k):
    """What the coil's current has more than the one that pulls as the step begins: hysteresis less the offset."""
    return x[k + HOLD] * x[k + HELD] - x[k + ZERO]


@piece
def hold_at(x, k, held):
    """That current at another state of the hysteresis."""
    return x[k + HOLD] * held - x[k + ZERO]


@piece
def held_next(x, k, x2):
    """State of the hysteresis at the end of a step that takes the coil's current to x2 (Dahl 1968)."""
    change = x2 - x[k + X2]
    toward = 1.0 if change > 0.0 else -1.0
    return toward + (x[k + HELD] - toward) * faded(abs(change) * x[k + PER_WIDTH])


@piece
def store_held(x, k, held):
    x[k + HELD] = held
    return 0.0
