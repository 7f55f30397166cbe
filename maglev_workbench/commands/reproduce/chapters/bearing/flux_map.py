"""Figures 3.20 to 3.22 and Table 3.3: the magnet's flux in a section of the bearing, and the forces that it makes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_env.rotor.rotor import load_rotor
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.page import COLOURS, styled
from selfsense.coil import MU_0

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

STEP = 0.05e-3  # m, of the grid
SHIFT = 2  # steps of the rotor
RING, RADIUS = 2.5e-3, 10e-3  # m: A_g is a quarter of a ring of this width and radius
SLOT = 1.4e-3  # m, between the poles (3.3.1.2)
AIR = 4e-3  # m of air beside and below the rings
PUBLISHED = 4.1207  # N, Table 3.3


@dataclass(frozen=True)
class Section:
    """Half of the section through one stack, from the magnet's middle outward: a grid of scalar potential.

    Attributes:
        potential: (rows, columns), of ring 1 and stator 0; nan in iron and magnet. Columns run along the axis, rows
            from the bore to the yoke.
        total: flux from the ring over mu_0 and potential, per length.
        gap: the part of it that enters the face of the stator's pole.
    """

    potential: np.ndarray
    total: float
    gap: float


def run(_seed: int) -> Outcome:
    """Laplace's equation between ring, pole and yoke of iron without reluctance; forces by virtual work."""
    rig = load_rig("hmb_free")
    rotor = load_rotor("pump")
    still, inward, outward = (section(rig.gap, shift) for shift in (0, -SHIFT, SHIFT))
    ideal = RING / rig.gap
    share = still.gap / ideal
    leak = still.total / still.gap - 1
    plain, lossy = (field(rig, total) for total in (ideal, still.total))
    pull = lossy**2 * rig.pole_area / (2 * MU_0)
    bend = (inward.total - 2 * still.total + outward.total) / (SHIFT * STEP) ** 2
    depth = rig.pole_area / RING
    drop = lossy * rig.gap  # mu_0 times the ring's potential
    face = -0.5 * drop**2 / MU_0 * bend * depth
    table = rotor.axial.stiffness
    rows = (
        Row("flux that leaves the ring beside the pole's face", None, 100 * leak, "%", None,
            "Of that through the face: over the slot, past the pole's sides, and back to the magnet's middle."),
        Row("flux through the face over that of parallel lines", None, share, "", None,
            "Fringing at the pole's edges adds to the face."),
        Row("field in the gap with this leakage", None, lossy, "T", None,
            f"Eq 3.7 without leakage gives {plain:.3f} T."),
        Row("radial force of one face, Table 3.3", PUBLISHED, pull, "N", 0.1,
            f"With the leakage of this section; a stack's two faces have {2 * pull:.1f} N, and the table lies between. "
            "The outline is not published: equal rings and poles of 2.5 mm, of which the printed A_g is a quarter "
            "turn at 10 mm, and 4 mm of air are assumed.", kind="prediction", again="axial-force"),
        Row("axial stiffness of one face", None, 1e-3 * face, "kN/m", None,
            f"By virtual work. A stack has two faces, a bearing eight: {8e-3 * face:.1f} kN/m."),
        Row("axial stiffness, two faces (one stack)", 1e-3 * table, 2e-3 * face, "kN/m", 0.25,
            "Of Table 3.3 by least squares.", kind="prediction"),
        Row("axial stiffness, eight faces (one bearing)", 1e-3 * table, 8e-3 * face, "kN/m", 0.25,
            "As axial-force reads the table, which lies between a stack and a bearing. Two bearings would have "
            f"{16e-3 * face:.1f} kN/m, and 2.471 were measured (Table 5.4).", kind="prediction", again="flux-map"),
        Row("axial mode of the test rig by two bearings of it", 38.0,
            float(np.sqrt(16 * face / 0.13) / (2 * np.pi)), "Hz", 0.1, "Under 0.13 kg (5.4).",
            kind="prediction", again="axial-force"),
    )  # fmt: skip
    note = (
        "The flux goes from ring to pole, through the stator and back, as Figure 3.22 is said to show: the outline is "
        "not published, so the map is one of a bearing like it. The iron has no reluctance here, and the magnet's "
        "sides let no flux out."
    )
    return Outcome(rows, (("Scalar potential between ring, pole and yoke (Figure 3.22)", _figure(still)),), (note,))


def field(rig: Rig, permeance: float) -> float:
    """Field (T) in the gap, by half the magnet's circuit, where the ring gives a flux of mu_0 permeance per length."""
    drive = rig.remanence * rig.magnet_length / 2 / (rig.recoil_permeability * MU_0)
    inner = rig.magnet_length / 2 / (rig.recoil_permeability * MU_0 * rig.magnet_area)
    outer = MU_0 * permeance * rig.pole_area / RING
    return float(MU_0 * drive / (1 + inner * outer) / rig.gap)


def section(gap: float, shift: int, step: float = STEP) -> Section:
    """Potential with the ring moved along the axis by `shift` steps; gap in m."""
    n = {name: round(size / step) for name, size in {"ring": RING, "gap": gap, "slot": SLOT, "air": AIR}.items()}
    below, top = n["air"], n["air"] + n["ring"]
    face = top + n["gap"]
    rows, columns = face + n["slot"] + n["ring"] + 1, 3 * n["ring"] + n["air"] + 1
    y, z = np.mgrid[0:rows, 0:columns]
    left, right = n["ring"], 2 * n["ring"]
    ring = (y >= below) & (y <= top) & (z >= left + shift) & (z <= right + shift)
    magnet = (y > below) & (y < top) & (z < left + shift)
    pole = (y >= face) & (z >= left) & (z <= right)
    yoke = (y >= face + n["slot"]) & (z <= right)
    fixed = ring | pole | yoke | ((z == 0) & ~magnet)
    value = solve(fixed, ring.astype(float), magnet)
    total = flux(value, fixed, ring, magnet)

    into = value[face - 1, left : right + 1].sum()

    return Section(np.where(ring | pole | yoke | magnet, np.nan, value), total, float(into))


def solve(fixed: np.ndarray, value: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Laplace's equation on a grid: `value` where `fixed`; no flux over the border of the grid or into `closed`."""
    free = ~fixed & ~closed
    number = np.full(fixed.shape, -1)
    number[free] = np.arange(free.sum())
    rows, columns, entries, right = [], [], [], np.zeros(free.sum())
    for axis in (0, 1):
        a, b = _pairs(axis, fixed.ndim)
        for here, there in ((a, b), (b, a)):
            open_ = free[here] & ~closed[there]
            at, other = number[here][open_], number[there][open_]
            rows.append(at), columns.append(at), entries.append(np.ones(len(at)))
            inner = other >= 0
            rows.append(at[inner]), columns.append(other[inner]), entries.append(-np.ones(inner.sum()))
            np.add.at(right, at[~inner], value[there][open_][~inner])
    matrix = coo_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))))
    result = value.astype(float)
    result[free] = spsolve(matrix.tocsc(), right)
    return result


def flux(value: np.ndarray, fixed: np.ndarray, source: np.ndarray, closed: np.ndarray) -> float:
    """Flux out of `source` over mu_0, per length: the sum of the differences over its border."""
    total = 0.0
    for axis in (0, 1):
        a, b = _pairs(axis, fixed.ndim)
        for here, there in ((a, b), (b, a)):
            out = source[here] & ~source[there] & ~closed[there]
            total += float((value[here] - value[there])[out].sum())
    return total


def _pairs(axis: int, dimensions: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of all points but the last and but the first along an axis."""
    every = [slice(None)] * dimensions
    low, high = list(every), list(every)
    low[axis], high[axis] = slice(None, -1), slice(1, None)
    return tuple(low), tuple(high)


def _figure(found: Section) -> "Figure":
    from plotly.graph_objects import Contour, Figure

    shown = found.potential[::2, ::2]
    axis = [2e3 * STEP * np.arange(n) for n in shown.shape]
    line = {"color": COLOURS[0]}
    levels = {"start": 0.0, "end": 1.0, "size": 0.1, "coloring": "lines"}
    figure = Figure(Contour(z=np.round(shown, 4), x=axis[1], y=axis[0], contours=levels, line=line, showscale=False))
    figure.update_xaxes(title_text="mm from the magnet's middle").update_yaxes(title_text="mm from below the ring")
    return styled(figure, 480)


ITEM = Item("flux-map", "The magnet's flux and the forces of a face", "Figures 3.20 to 3.22, Table 3.3", run)
