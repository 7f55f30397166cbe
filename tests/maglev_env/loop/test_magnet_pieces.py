"""The magnets' pieces of the kernel, as plain functions of one lane, against the force laws that they write out."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from maglev_env.loop.magnets import rows
from maglev_env.loop.magnets.kinds import KINDS, force_law
from maglev_env.loop.magnets.law import force
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES, LaneRows, row

PER_MASS = 3e-9 / 0.08  # s2/kg
GAPS, CURRENTS = (-0.35, -0.1, 0.0, 0.2, 0.4), (-0.6, 0.0, 0.9)


def pulled(piece, law, effects, displacement, current):
    """Acceleration by a piece in lane 3 of a block that has the constants of a law, N."""
    values = np.zeros((row(rows.END), LANES))

    def effect(name, parameter=None):
        return np.full(LANES, effects.get((name, parameter), 0.0))

    rows.fill(LaneRows(values), [law] * LANES, np.full(LANES, PER_MASS), effect)
    return piece(values.reshape(-1), 3, displacement, law.gain_scale * current) / PER_MASS


@pytest.mark.parametrize("name", ["hmb_free", "eframe", "hmb_free, through the magnet"])
@pytest.mark.parametrize(
    ("saturation", "sharpness", "creep", "exponent", "shape"),
    [
        (inf, 4.0, 0.0, 0.0, None),
        (0.6, 4.0, 0.0, 0.0, (True, False, False)),
        (0.6, 2.5, 0.0, 0.0, (True, False, True)),
        (0.4, 4.0, 0.3, 0.0, (True, False, True)),
        (inf, 4.0, 0.0, 0.7, (False, True, False)),
        (0.5, 3.0, 0.2, -0.4, (True, True, True)),
    ],
)
def test_a_pairs_piece_is_its_law(name, saturation, sharpness, creep, exponent, shape):
    rig = axis_rig(load_rig(name.split(",")[0]), 0)
    rig = replace(rig, flux_path="magnet") if "," in name else rig
    kind = KINDS[rig.magnet]
    piece = kind.pull if shape is None else kind.shaped_pull(*shape)
    bend = {"sharpness": sharpness, "creep": creep}
    effects = {("saturation", None): saturation, **{("saturation", key): value for key, value in bend.items()}}
    law = replace(force_law(rig), saturation=saturation, exponent=exponent, **bend)
    for share in GAPS:
        for part in CURRENTS:
            y, i = share * rig.gap, part * rig.bias_current
            expected = force(law, y, i)
            assert pulled(piece, law, effects, y, i) == pytest.approx(expected, rel=1e-8, abs=1e-9)
    assert abs(force(law, 0.4 * rig.gap, 0.9 * rig.bias_current)) > 0.01
