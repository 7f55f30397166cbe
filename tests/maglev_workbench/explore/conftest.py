"""A small sweep of hmb_free as `maglev sweep` writes it, as far as the page reads it."""

import json

import numpy as np
import pytest
import xarray as xr


@pytest.fixture(scope="session")
def swept(tmp_path_factory):
    """Folder of a sweep of 3 kp, 4 kd and 2 ki. The first set does not hold the rotor, the 20th is the best."""
    folder = tmp_path_factory.mktemp("sweep")
    grid = [(kp, ki, kd) for ki in (1e3, 2e3) for kd in (4.0, 5.0, 6.0, 7.0) for kp in (6e3, 8e3, 1e4)]
    gains = dict(zip(("kp", "ki", "kd"), np.array(grid).T, strict=True))
    n = len(grid)
    score = np.where(np.arange(n) == 19, 0.9, 0.5)
    values = {"score": score, "peak_sensitivity": np.full(n, 2.5), "stiffness": np.full(n, 35e3), "damping": score * 40}
    values["feasible"] = np.arange(n) > 0
    coords = gains | {"td": np.full(n, 1e-4), "ti": np.full(n, 0.0318)}
    data = xr.Dataset(
        {name: ("experiment", v) for name, v in values.items()},
        {name: ("experiment", v) for name, v in coords.items()},
        {"rig": json.dumps({"name": "hmb_free"}), "log": "false"},
    )
    data.to_netcdf(folder / "sweep.nc", engine="h5netcdf")
    return folder
