"""What is said of means that do not balance."""

import numpy as np

from maglev_env.redundancy.bounds import _of_one_coil
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import load_rig


def test_a_mean_current_of_the_size_of_the_bias_is_that_of_one_coil():
    rig = with_parameters(load_rig("eframe"), {"bias_current": 1.5})
    swing = 0.3 * np.sin(np.linspace(0, 60, 1000))
    assert "offset = -1.5" in _of_one_coil(rig, 1.5 + swing) and "offset = 1.5" in _of_one_coil(rig, swing - 1.5)
    assert not _of_one_coil(rig, swing) and not _of_one_coil(rig, 0.8 + swing)
