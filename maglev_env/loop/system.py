"""Linear equations of the loop for a batch of lanes: named states, whose derivatives each block writes.

A signal is an array (n, S): its coefficients of the S states in each of n lanes. A block's function takes the signals
that enter the block, writes the derivatives of the block's states, and returns the signal that leaves the block.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw


class Values(Protocol):
    """Parameters of n lanes, each of one axis, as the blocks read them; `maglev_env.lane_values` implements it."""

    @property
    def mass(self) -> np.ndarray:
        """Mass (kg) of the mover, including the effect mass and without bodies on springs that belong to it, (n,)."""
        ...

    @property
    def laws(self) -> Sequence[ForceLaw | SingleSidedLaw | None]:
        """Force law of each lane with the effect force_law and without the others; None without magnets."""
        ...

    @property
    def inductance(self) -> np.ndarray:
        """Inductance of the coil (H), infinite if the rig does not give it, (n,)."""
        ...

    @property
    def noise(self) -> np.ndarray:
        """Rms of the reading's noise (m), (n,)."""
        ...

    @property
    def speed(self) -> np.ndarray:
        """Speed of rotation (rad/s), (n,)."""
        ...

    def effect(self, name: str, parameter: str | None = None) -> np.ndarray:
        """A parameter of an effect (default: its first) in every lane, (n,); where absent, its neutral value."""
        ...

    def rig(self, name: str) -> np.ndarray:
        """A parameter of the rig in every lane, (n,)."""
        ...


class System:
    """Equations dx/dt = a x of S named states in n lanes; the unit of time t may differ between lanes.

    Inputs and held values are states whose derivative stays zero.

    Args:
        states: names, in the order of the matrices.
        step: the unit of time (s), (n,).
        packed: whether a lane's absent lags are moved to the end of their cascade, so that a kernel with a single pole
            always finds it in the first state.
        lean: whether states that no lane has may be left out, which saves the time of writing their equations. The
            exact chains of the kernel keep them, so that a lane's matrix does not depend on the other lanes.

    Attributes:
        a: (n, S, S), in 1 / unit of time.
        there: (n, S), whether a lane has the state. No other equation depends on an absent state, so it may be
            dropped.
        shown: (n, S, S), the signal that replaces each state when it is read: the state itself, or for an absent lag
            the signal that enters it.
    """

    def __init__(self, states: Sequence[str], step: np.ndarray, packed: bool = False, lean: bool = False):
        lanes, size = len(step), len(states)
        self.step, self.packed, self.lean = step, packed, lean
        self.a = np.zeros((lanes, size, size))
        self.there = np.ones((lanes, size), dtype=bool)
        self._states = np.broadcast_to(np.eye(size), (lanes, size, size))
        self.shown = self._states.copy()
        self._at = {name: k for k, name in enumerate(states)}

    def at(self, *names: str) -> list[int]:
        """Indices of states in the matrices."""
        return [self._at[name] for name in names]

    def signal(self, name: str) -> np.ndarray:
        """A state as a signal, (n, S); read only."""
        return self._states[:, self._at[name]]

    def signals(self, names: Sequence[str]) -> np.ndarray:
        """Several states as signals, (n, names, S)."""
        return self._states[:, self.at(*names)]

    def without(self, names: Sequence[str], there: np.ndarray) -> bool:
        """Whether the equations of these states can be left out, which are then marked as absent.

        Args:
            names: of the states.
            there: (n,), which lanes have them.
        """
        if not self.lean or there.any():
            return False
        self.there[:, self.at(*names)] = False
        return True

    def put(self, name: str, rate: np.ndarray, there: np.ndarray | bool = True) -> None:
        """Write a state's derivative and which lanes have the state.

        Args:
            name: of the state.
            rate: signal of its derivative, per unit of time.
            there: (n,), which lanes have it.
        """
        at = self._at[name]
        self.a[:, at], self.there[:, at] = rate, there

    def add(self, name: str, rate: np.ndarray) -> None:
        """Add a signal, per unit of time, to a state's derivative."""
        self.a[:, self._at[name]] += rate

    def put_all(self, names: Sequence[str], rates: np.ndarray, there: np.ndarray | bool = True) -> None:
        """Write the derivatives of several states that a lane has either all or none of.

        Args:
            names: of the states.
            rates: signals of their derivatives per unit of time, (n, names, S).
            there: (n,), which lanes have them.
        """
        at = self.at(*names)
        self.a[:, at], self.there[:, at] = rates, np.expand_dims(there, -1)

    def integrate(self, names: Sequence[str]) -> None:
        """Write that each of these states is the integral of the following one."""
        for name, following in pairwise(names):
            self.a[:, self._at[name], self._at[following]] = 1.0

    def lags(self, names: Sequence[str], time_constants: Sequence[np.ndarray], signal: np.ndarray) -> np.ndarray:
        """Write a cascade of lags 1 / (1 + s T).

        Args:
            names: their states.
            time_constants: s, (n,) each; where it is 0 the lane has no lag and the signal passes unchanged.
            signal: input of the first lag.

        Returns:
            Output of the last lag, a signal.
        """
        if self.packed:
            times = np.array(time_constants)
            time_constants = np.take_along_axis(times, np.argsort(times == 0, axis=0, kind="stable"), axis=0)
        for name, time in zip(names, time_constants, strict=True):
            there, own = time > 0, self.signal(name)
            rate = np.divide(self.step, time, out=np.zeros(len(time)), where=there)
            self.put(name, rate[:, None] * (signal - own), there)
            self.shown[:, self._at[name]] = signal = np.where(there[:, None], own, signal)
        return signal

    def feed_back(
        self, names: tuple[str, str], time_constants: tuple[np.ndarray, np.ndarray], share: np.ndarray
    ) -> None:
        """Make two lags T_0 and T after each other a loop of second order, 1 / (1 + s (T_0 + (1 - f) T) + s^2 T_0 T).

        The rate of the second state is fed back to the first one; `lags` wrote both.

        Args:
            names: their states.
            time_constants: s, (n,) each.
            share: f, (n,); without effect where a lane lacks one of the lags.
        """
        first, second = time_constants
        share = np.where((first > 0) & (second > 0), share, 0.0)
        if share.any():
            rate = np.divide(self.step * share, first, out=np.zeros(len(first)), where=share != 0)
            one, other = (self.signal(name) for name in names)
            self.add(names[0], rate[:, None] * (one - other))

    def oscillator(
        self,
        names: tuple[str, str],
        frequency: np.ndarray,
        damping_ratio: np.ndarray,
    ) -> np.ndarray:
        """A second-order mode: writes the derivative of its position; the caller writes that of its velocity.

        Args:
            names: states of its position and its velocity.
            frequency: Hz, (n,).
            damping_ratio: (n,).

        Returns:
            Signal of the acceleration by its spring and its damper, per unit of time squared.
        """
        position, velocity = names
        self.integrate(names)
        turn = 2 * np.pi * frequency * self.step
        returning = np.zeros(self.there.shape)
        returning[:, self._at[position]] = -(turn**2)
        returning[:, self._at[velocity]] = -2 * damping_ratio * turn
        return returning
