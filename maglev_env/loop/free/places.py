"""The places of free corrections: their cards, rows and pieces."""

from collections.abc import Callable, Mapping

import numpy as np

from maglev_env.loop.actuator import current_scale
from maglev_env.loop.card import Block, EffectCard, Need, Parameter
from maglev_env.loop.free import element
from maglev_env.loop.free.element import END_OF_STEP, LINE_ROWS, MEMORY_ROWS, RATIO, RELAXATIONS, line, slopes
from maglev_env.loop.further import blocks as further
from maglev_env.loop.mechanics import STEPS, V
from maglev_env.loop.system import System, Values
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

_NOT_FITTED = "no cause: it is fitted where no effect explains the gap, see `sim2real.free`"
_NOT_SEALED = "a free correction is no cause"


def _card(
    block: Block, parameters: Mapping[str, Parameter], source: str, identified_by: str, needs: tuple[Need, ...] = ()
) -> EffectCard:
    return EffectCard(
        block, parameters, source, identified_by, needs, flexible=True, not_fitted=_NOT_FITTED, not_sealed=_NOT_SEALED
    )


def _of(unit: str, most: float, of: str, remembers: str = "") -> dict[str, Parameter]:
    """Parameters of a line, and with the unit of a memory also those."""
    found = element.line_parameters(unit, -most, most, of)
    return found | (element.memory_parameters(remembers, most) if remembers else {})


EFFECTS: Mapping[str, EffectCard] = {
    "free_command": _card(
        "amplifier",
        _of("A", 1e4, "A") | element.memory_parameters("", 1e4),
        "the command plus a free function of it drives the amplifier",
        "command and current",
        ("magnets",),
    ),
    "free_current": _card(
        "actuator",
        _of("A", 1e4, "A") | element.memory_parameters("", 1e4),
        "the force-producing current plus a free function of it pulls",
        "current, force and displacement",
        ("magnets",),
    ),
    "free_gain": _card(
        "actuator",
        _of("", 10.0, "m"),
        "the force-producing current is multiplied by 1 plus a free function of the displacement",
        "current and displacement at two amplitudes",
        ("magnets",),
    ),
    "free_gain_velocity": _card(
        "actuator",
        _of("", 10.0, "m/s"),
        "the force-producing current is multiplied by 1 plus a free function of the velocity",
        "current and displacement at two amplitudes",
        ("magnets",),
    ),
    "free_spring": _card(
        "mechanics",
        _of("N", 1e6, "m") | element.memory_parameters("N/m", 1e12),
        "a force against the displacement, a free function of it",
        "force and displacement",
    ),
    "free_damper": _card(
        "mechanics",
        _of("N", 1e6, "m/s"),
        "a force against the velocity, a free function of it",
        "force and displacement",
    ),
    "free_reading": _card(
        "sensor",
        _of("m", 1.0, "m") | element.memory_parameters("", 1e4),
        "the displacement read plus a free function of it",
        "force and displacement",
    ),
}
NAMES = frozenset(EFFECTS)
REMEMBERING = tuple(name for name, card in EFFECTS.items() if "direct" in card.parameters)

# Rows of a lane: lines and memories of every place, see `element`.
COMMAND_LINE, CURRENT_LINE, GAIN_LINE, _MORE = rows_after(
    further.END, f"COMMAND_LINE[{LINE_ROWS}] CURRENT_LINE[{LINE_ROWS}] GAIN_LINE[{LINE_ROWS}]"
)
SPEED_LINE, SPRING_LINE, DAMPER_LINE, READING_LINE, _MEMORIES = rows_after(
    _MORE, f"SPEED_LINE[{LINE_ROWS}] SPRING_LINE[{LINE_ROWS}] DAMPER_LINE[{LINE_ROWS}] READING_LINE[{LINE_ROWS}]"
)
COMMAND_MEMORY, CURRENT_MEMORY, _LAST = rows_after(
    _MEMORIES, f"COMMAND_MEMORY[{MEMORY_ROWS}] CURRENT_MEMORY[{MEMORY_ROWS}]"
)
SPRING_MEMORY, READING_MEMORY, END = rows_after(_LAST, f"SPRING_MEMORY[{MEMORY_ROWS}] READING_MEMORY[{MEMORY_ROWS}]")


def fill(x: LaneRows, values: Values, h: np.ndarray) -> None:
    """Write the constants for integration steps of h (s), (n,)."""
    scale, per_mass, sample = current_scale(values), h**2 / values.mass, 1 / values.rig("control_rate")
    for name, first, of, per in (
        ("free_command", COMMAND_LINE, 1.0, 1.0),
        ("free_current", CURRENT_LINE, scale, scale),
        ("free_gain", GAIN_LINE, 1.0, 1.0),
        ("free_gain_velocity", SPEED_LINE, h, 1.0),
        ("free_spring", SPRING_LINE, 1.0, per_mass),
        ("free_damper", DAMPER_LINE, h, per_mass),
        ("free_reading", READING_LINE, 1.0, 1.0),
    ):
        element.fill_line(x, first, values, name, of, per, name in REMEMBERING)
    for name, first, of, per, dt in (
        ("free_command", COMMAND_MEMORY, 1.0, 1.0, sample),
        ("free_current", CURRENT_MEMORY, scale, scale, h),
        ("free_spring", SPRING_MEMORY, 1.0, per_mass, h),
        ("free_reading", READING_MEMORY, 1.0, 1.0, sample),
    ):
        element.fill_memory(x, first, values, name, of, per, dt, h)


_at_sample = element.memory(END_OF_STEP)


@piece
def commanded(x, k, u):
    """The command (A) that acts, once per sample."""
    found = u + line(x, k + COMMAND_LINE, u) + _at_sample(x, k + COMMAND_MEMORY, u, x[k + STEPS])
    element.advance(x, k + COMMAND_MEMORY, u, 1.0)
    return found


@piece
def read(x, k, sensed, share):
    """The displacement read (m); share: 1 once per sample, 0 for readings in between."""
    found = sensed + line(x, k + READING_LINE, sensed) + _at_sample(x, k + READING_MEMORY, sensed, x[k + STEPS])
    element.advance(x, k + READING_MEMORY, sensed, share)
    return found


def pulling(node: int) -> Callable:
    """A piece for the current (A) that pulls at a node of the step and the displacement y there."""
    remembered = element.memory(node)

    @piece
    def pulls(x, k, y, current):
        found = current + line(x, k + CURRENT_LINE, current) + remembered(x, k + CURRENT_MEMORY, current, x[k + STEPS])
        if node == END_OF_STEP:
            element.advance(x, k + CURRENT_MEMORY, current, 1.0)
        return found * (1.0 + line(x, k + GAIN_LINE, y) + line(x, k + SPEED_LINE, x[k + V]))

    return pulls


def pushed_back(node: int) -> Callable:
    """A piece for the deceleration by the free spring at a node of the step and the displacement y there."""
    remembered = element.memory(node)

    @piece
    def pushes(x, k, y):
        found = line(x, k + SPRING_LINE, y) + remembered(x, k + SPRING_MEMORY, y, x[k + STEPS])
        if node == END_OF_STEP:
            element.advance(x, k + SPRING_MEMORY, y, 1.0)
        return found

    return pushes


@piece
def damped(x, k, v):
    """Deceleration by the free damper at the velocity v."""
    return line(x, k + DAMPER_LINE, v)


STATES = {name: tuple(f"{name} {key}" for key in RELAXATIONS) for name in REMEMBERING}


def linear(system: System, values: Values, name: str, signal: np.ndarray) -> np.ndarray:
    """Signal that a free correction adds, linearised over its range; the states of its relaxations are written.

    A play counts as what it passes of a motion over the range.
    """
    _, slope = slopes(values, name)
    total = 0.5 * np.diff([-1.0, *element.KNOTS, 1.0]) @ slope
    if name not in REMEMBERING:
        return total[:, None] * signal
    total = total + values.effect(name, "direct")
    total = total + sum(
        values.effect(name, key) * (1 - width) for key, width in zip(element.PLAYS, element.WIDTHS, strict=True)
    )
    added, states = total[:, None] * signal, STATES[name]
    weights = [values.effect(name, key) for key in RELAXATIONS]
    there = np.any(weights, axis=0)
    if system.without(states, there):
        return added
    for j, (state, weight) in enumerate(zip(states, weights, strict=True)):
        own = system.signal(state)
        rate = system.step / (values.effect(name, "time") * RATIO**j)
        system.put(state, rate[:, None] * (signal - own), there)
        added = added + weight[:, None] * own
    return added
