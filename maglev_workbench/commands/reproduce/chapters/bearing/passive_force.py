"""The force with which the magnets draw the rotor back along its axis, by the section of flux-map."""

from math import nan

import numpy as np
import scipy

from maglev_env.rotor.rotor import Rotor
from maglev_workbench.commands.reproduce.chapters.bearing.flux_map import RING, STEP, field, section
from selfsense.coil import MU_0

TABLE_5_4 = 2.471e3  # N/m, of both bearings
FACES = 16  # of two bearings


class Passive:
    """The passive force along the axis: that of the section, or in proportion to it with another stiffness.

    Attributes:
        stiffness: At the centre, N/m.
        most: Largest force, N.
    """

    def __init__(self, z: np.ndarray, pull: np.ndarray, stiffness: float | None = None) -> None:
        # Odd in z, so that the curve is smooth at the centre.
        curve = scipy.interpolate.CubicSpline(np.r_[-z[:0:-1], z], np.r_[-pull[:0:-1], pull])
        own = float(curve(0.0, 1))
        self.stiffness = own if stiffness is None else stiffness
        self._far, self._scale = float(z[pull.argmax()]), self.stiffness / own
        self._curve, self._slope = curve, curve.derivative()
        self.most = self._scale * float(pull.max())

    def at(self, load: float) -> tuple[float, float]:
        """Displacement (m) under a load (N), and the stiffness there over that without one; nan if it does not hold."""
        if load > self.most:
            return nan, nan
        place = scipy.optimize.brentq(lambda z: self._scale * float(self._curve(z)) - load, 0.0, self._far)
        return float(place), float(self._slope(place) / self._slope(0.0))


def axial_pull(rotor: Rotor) -> tuple[np.ndarray, np.ndarray]:
    """Axial displacements (n,) m and the passive force (n,) N of both bearings, by virtual work at a fixed potential.

    One ring is also drawn along the axis at the centre; that of the other end of its magnet draws against it.
    """
    shifts = np.arange(-30, 31, 4)
    permeance = np.array([section(rotor.axis.gap, int(s)).total for s in shifts])
    drop = field(rotor.axis, section(rotor.axis.gap, 0).total) * rotor.axis.gap
    slope = np.diff(permeance) / np.diff(shifts * STEP)
    force = -0.5 * drop**2 / MU_0 * rotor.axis.pole_area / RING * FACES * (slope - slope[::-1]) / 2
    z = (shifts[1:] + shifts[:-1]) / 2 * STEP
    return z[z >= 0], force[z >= 0]
