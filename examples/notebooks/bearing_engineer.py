# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # What a delay costs a bearing
# A notebook as text: `jupytext --to ipynb bearing_engineer.py`, or open it in an editor that knows cells.

# %%
from dataclasses import replace

from maglev_workbench import evaluate, load_rig, protocol_experiment

rig = load_rig("hmb_free")
rig.gains

# %% [markdown]
# Three proportional gains, with and without 75 µs of delay. Each is one identification experiment; stiffness and
# damping are those of the target band, with 95 % intervals.

# %%
gains = [replace(rig.gains, kp=kp) for kp in (7000.0, 9000.0, 11000.0)]  # A/m
ideal = evaluate([protocol_experiment(rig, g) for g in gains])
late = evaluate([protocol_experiment(rig, g, effects={"delay": {"time": 75e-6}}) for g in gains])
columns = ["stiffness", "stiffness_low", "stiffness_high", "damping", "peak_sensitivity", "score"]
table = ideal.to_pandas()[columns].join(late.to_pandas()[columns].add_suffix(" late"))
table

# %% [markdown]
# The delay takes damping and margin, and leaves the stiffness nearly as it is.

# %%
late.plot()
