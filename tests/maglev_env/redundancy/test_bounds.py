"""What is said of means that do not balance, and of a motion that the rig leaves no room for."""

import numpy as np

from maglev_env.redundancy.bounds import _of_one_coil, clearance
from maglev_env.redundancy.view import View
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.rig.rig_file import load_rig


def test_a_mean_current_of_the_size_of_the_bias_is_that_of_one_coil():
    rig = with_parameters(load_rig("eframe"), {"bias_current": 1.5})
    swing = 0.3 * np.sin(np.linspace(0, 60, 1000))
    assert "offset = -1.5" in _of_one_coil(rig, 1.5 + swing) and "offset = 1.5" in _of_one_coil(rig, swing - 1.5)
    assert not _of_one_coil(rig, swing) and not _of_one_coil(rig, 0.8 + swing)


def said_of(rig, displacement):
    columns = {"displacement": "y"}
    view = View("r", 100.0, {"displacement": displacement}, frozenset(columns), columns, (), frozenset(), None, (),
                rig, rig.mass)  # fmt: skip
    return [(f.kind, f.message) for f in clearance(view)]


def test_below_one_magnet_there_is_more_room_than_towards_it():
    rig = Rig(name="ball", magnet="electromagnet", mass=0.02, gap=4e-3, force_constant=8e-5)
    swing = np.sin(np.linspace(0, 60, 1000))
    assert not said_of(rig, -3e-3 + 4e-3 * swing)  # 7 mm away from a magnet that is 4 mm above
    ((kind, message),) = said_of(rig, 2e-3 + 4e-3 * swing)
    assert kind == "wiring" and message.startswith("displacement: it reaches 0.006 m (its mean is 0.002")
    ((kind, message),) = said_of(rig, -8e-3 + 1e-3 * swing)  # counted from the magnet
    assert kind == "wiring" and "it reaches -0.009 m" in message
    ((kind, _),) = said_of(rig, 0.5 * swing)
    assert kind == "contradiction"
    pair = with_parameters(load_rig("eframe"), {})
    assert said_of(pair, 3 * pair.clearance * swing)[0][0] == "contradiction"
