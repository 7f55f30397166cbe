"""Linear equations of the loop over a batch of lanes: named states into which every block writes its own.

A signal is an array (n, S): what it takes of each of the S states, in each of n lanes. A block's function takes the
signals that enter the block, writes the derivatives of the block's states, and returns the signal that leaves it.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw


class Values(Protocol):
    """The numbers of n lanes, each of one axis, as the blocks ask for them; `maglev_env.lane_values` makes them."""

    @property
    def mass(self) -> np.ndarray:
        """Moving mass, kg, its effect included: (n,)."""
        ...

    @property
    def laws(self) -> Sequence[ForceLaw | SingleSidedLaw | None]:
        """Each lane's force law without its effects; None without magnets."""
        ...

    @property
    def inductance(self) -> np.ndarray:
        """The coil's, H, infinite where the rig does not give it: (n,)."""
        ...

    @property
    def noise(self) -> np.ndarray:
        """Rms of the reading's noise, m: (n,)."""
        ...

    @property
    def speed(self) -> np.ndarray:
        """Of rotation, rad/s: (n,)."""
        ...

    def effect(self, name: str, parameter: str | None = None) -> np.ndarray:
        """A parameter of an effect (default: its first) in every lane, (n,); where absent the value that means so."""
        ...

    def rig(self, name: str) -> np.ndarray:
        """A parameter of the rig in every lane, (n,)."""
        ...


class System:
    """Equations dx/dt = a x of S named states in n lanes, with t in a unit of time of each lane's own.

    Inputs and held values are states whose derivative nobody writes.

    Args:
        states: names, in the order of the matrices.
        step: the unit of time (s), (n,).
        packed: whether a lane's absent lags come last in their cascade, whatever their names, so that a kernel with a
            single pole finds it in the first place.
        lean: whether states that no lane has may be left out, which saves the time of writing their equations. An
            exact chain keeps them, so that a lane's matrix does not depend on the lanes beside it.

    Attributes:
        a: (n, S, S), in 1 / unit of time.
        there: (n, S), whether a lane has the state. Nothing else depends on a state that is absent, and it may be
            dropped.
        shown: (n, S, S), what is read as each state: the state itself, or in place of an absent lag the signal that
            enters it.
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
        """Where states stand in the matrices."""
        return [self._at[name] for name in names]

    def signal(self, name: str) -> np.ndarray:
        """A state as a signal; read only."""
        return self._states[:, self._at[name]]

    def signals(self, names: Sequence[str]) -> np.ndarray:
        """Several states as signals, (n, names, S)."""
        return self._states[:, self.at(*names)]

    def without(self, names: Sequence[str], there: np.ndarray) -> bool:
        """Whether the equations of these states are left out; there: which lanes have them, (n,)."""
        if not self.lean or there.any():
            return False
        self.there[:, self.at(*names)] = False
        return True

    def put(self, name: str, rate: np.ndarray, there: np.ndarray | bool = True) -> None:
        """Write a state's derivative (a signal, per unit of time), and which lanes have the state."""
        at = self._at[name]
        self.a[:, at], self.there[:, at] = rate, there

    def put_all(self, names: Sequence[str], rates: np.ndarray, there: np.ndarray | bool = True) -> None:
        """Write the derivatives (n, names, S) of several states that a lane has together or not at all."""
        at = self.at(*names)
        self.a[:, at], self.there[:, at] = rates, np.expand_dims(there, -1)

    def integrate(self, names: Sequence[str]) -> None:
        """Make each of these states the integral of the one after it."""
        for name, following in pairwise(names):
            self.a[:, self._at[name], self._at[following]] = 1.0

    def lags(self, names: Sequence[str], time_constants: Sequence[np.ndarray], signal: np.ndarray) -> np.ndarray:
        """Lags 1 / (1 + s T) one after the other.

        Args:
            names: their states.
            time_constants: s, (n,) each; a lane has no lag where it is 0, and the signal passes.
            signal: what enters the first.

        Returns:
            What leaves the last.
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

    def oscillator(
        self,
        names: tuple[str, str],
        frequency: np.ndarray,
        damping_ratio: np.ndarray,
        stiffer: np.ndarray | float = 1.0,
    ) -> np.ndarray:
        """A second-order mode: writes that its position changes with its velocity.

        Args:
            names: states of its position and its velocity.
            frequency: Hz, (n,).
            damping_ratio: (n,).
            stiffer: factor (n,) on its spring and its damper.

        Returns:
            The acceleration by its spring and its damper, per unit of time squared.
        """
        position, velocity = names
        self.integrate(names)
        turn = 2 * np.pi * frequency * self.step
        returning = np.zeros(self.there.shape)
        returning[:, self._at[position]] = -stiffer * turn**2
        returning[:, self._at[velocity]] = -2 * damping_ratio * stiffer * turn
        return returning
