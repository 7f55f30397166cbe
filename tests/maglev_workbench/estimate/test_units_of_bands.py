"""The unit of a table of bands is not that of a value that ran away."""

from types import SimpleNamespace

import numpy as np
import pytest

from maglev_workbench.commands.estimate.figures import units_of


@pytest.mark.parametrize(("likely", "unit"), [(4e4, "kN/m"), (7e13, "kN/m"), (-7e13, "kN/m"), (5e6, "MN/m")])
def test_the_unit_is_that_of_least_squares_where_maximum_likelihood_runs_away(likely, unit):
    bands = [
        SimpleNamespace(informative=True, stiffness=likely, ls_stiffness=3.9e4 + k, damping=20.0, ls_damping=20.0)
        for k in range(5)
    ]
    assert units_of(bands)["stiffness"][1] == unit
    assert np.isclose(units_of(bands)["damping"][0], 1.0)
