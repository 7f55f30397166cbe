"""The large-signal test: a hovering rotor is pushed, or released from its touchdown bearing, and followed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.kernel.layout import AXIS
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.state import State, put_lanes, stretches
from maglev_env.loop.amplifier import X1, X2
from maglev_env.loop.controller import RAW, U
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.mechanics import Y
from maglev_env.loop.sensor import SEEN, Z1, Z2
from maglev_env.rig.goal import EventKind
from maglev_env.rig.rig import axis_rig
from maglev_lanes.layout import row
from maglev_lanes.threads import over_threads

# Control samples for which a rotor at rest is read before its amplifier is switched on: several time constants of a
# derivative's filter, so that switching on is no step of the derivative.
HELD = 32


@dataclass(frozen=True)
class Event:
    """One event of the test; on an x-y rig it acts along both axes.

    Args:
        kind: "impulse" (N s, within the first control sample), "step" (N, from the first sample on) or "lift_off" (m,
            where the rotor lies before its amplifier is switched on).
        size: in the unit of its kind.
        samples: control samples that are followed.
    """

    kind: EventKind
    size: float
    samples: int


def simulated_events(
    blocks: Sequence[Block], hover: int, events: Sequence[Event], threads: int | None = None
) -> list[np.ndarray]:
    """Displacement readings and coil currents: first while hovering, then in every event.

    A rotor that is pushed hovers before; every event starts anew, so that none depends on another one.

    Args:
        blocks: of n experiments, see `simulate.own_lanes`; their excitations are not used.
        hover: control samples of hovering.
        events: the events.
        threads: None for all cores.

    Returns:
        Of hovering and of each event (n, 2, axes, samples); nan throughout where the rotor touched down in it.
    """
    rig, count = blocks[0].experiment.rig, sum(len(block.members) for block in blocks)
    axes, rate = rig.axes, rig.control_rate
    found = [np.empty((count, 2, axes, n)) for n in (hover, *(e.samples for e in events))]

    def run(block: Block) -> None:
        state = State(block)
        _follow(block, state, np.zeros(hover), found[0])
        hovering = state.rows.copy(), state.history.copy(), state.step
        for event, series in zip(events, found[1:], strict=True):
            force = np.full(event.samples, event.size if event.kind == "step" else 0.0)
            if event.kind == "impulse":
                force[0] = event.size * rate
            if event.kind == "lift_off":
                state = _lying(block, event.size)
            else:
                state.rows[:], state.history[:], state.step = hovering[0], hovering[1], hovering[2]
            _follow(block, state, force, series)

    for _ in over_threads(run, blocks, threads):
        pass
    return found


def _follow(block: Block, state: State, force: np.ndarray, series: np.ndarray) -> None:
    """Write displacement and current under a force (samples,) on every axis into the members of series, (n, 2, ...)."""
    still = np.zeros(state.axes * force.size)
    for out in stretches(block, state, [[np.tile(force, state.axes), still, still]]):
        put_lanes(out[:, :, [0, -1], : len(block.members)], series, block.members)
    series[block.members[~state.alive()[: len(block.members)]]] = np.nan


def _lying(block: Block, distance: float) -> State:
    """Lanes at rest at a distance (m) from the centre, whose controllers have been reading it for HELD samples.

    Everything except the controllers is put back after every sample: the amplifier is off, and the rotor lies. Below a
    single magnet it lies farther from it, and the coil has no current, not even that which carries the weight.
    """
    state = State(block)
    rig = block.experiment.rig
    for at in (Y, Z1, Z2, SEEN):
        state.axis_rows(at)[:] = distance if "pair" in rig.capabilities else -distance
    for axis in range(state.axes):
        for at in (X1, X2):
            state.axis_rows(at)[axis] = -force_law(axis_rig(rig, axis)).rest_current
    lying, per_axis = state.rows.copy(), row(AXIS)
    sample = [np.zeros(state.axes)] * 3
    for _ in stretches(block, state, [sample] * HELD):
        for axis in range(state.axes):
            own = slice(axis * per_axis, (axis + 1) * per_axis)
            controller = state.rows[own][row(U) : row(RAW) + 1].copy()
            state.rows[own] = lying[own]
            state.rows[own][row(U) : row(RAW) + 1] = controller
    return state
