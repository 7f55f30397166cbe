# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # The loop in python-control, modelled and measured
# It needs python-control: `pip install "maglev-workbench[bench]"`.

# %%
import control
import numpy as np

from maglev_workbench import identify_experiment, load_rig, protocol_experiment, to_control

experiment = protocol_experiment(load_rig("hmb_free"), effects={"delay": {"time": 1e-4}})
plant, controller, closed = to_control(experiment)
plant.poles()

# %% [markdown]
# The magnet's negative stiffness makes one pole of the plant unstable; the controller brings all inside the unit
# circle.

# %%
np.abs(closed.poles()).max()

# %% [markdown]
# The same loop, simulated with noise and identified from an injected current.

# %%
found = identify_experiment(experiment)
measured = found.to_control()
modelled = control.frd(controller * plant, measured.omega)
margins = {"modelled": control.stability_margins(modelled)[:3], "measured": control.stability_margins(measured)[:3]}
margins

# %%
found
