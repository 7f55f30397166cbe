# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # Small steps against random ones
# 16 rigs, drawn widely and simulated as one batch; one step is one identification experiment of every rig.

# %%
import numpy as np

from maglev_workbench import RigVectorEnv

STEPS = 6


def best_scores(act) -> np.ndarray:
    """The best score of each rig in one episode.

    Args:
        act: from the actions of the best experiments so far, shape (rigs, gains), to those of the next.
    """
    env = RigVectorEnv(16, rig="hmb_free", randomization="wide", budget=STEPS, protocol="quick")
    env.reset(seed=1)
    best, tried = np.full(16, -np.inf), np.zeros(env.action_space.shape)
    for _ in range(STEPS):
        action = act(tried).astype(env.action_space.dtype)
        reward = env.step(action)[1]
        tried = np.where((reward > best)[:, None], action, tried)
        best = np.maximum(best, reward)
    env.close()
    return best


# %% [markdown]
# Actions are points of the box of gains, -1 to 1; 0 is the middle.

# %%
random = np.random.default_rng(2)
anywhere = best_scores(lambda tried: random.uniform(-1, 1, tried.shape))
nearby = best_scores(lambda tried: np.clip(tried + 0.3 * random.standard_normal(tried.shape), -1, 1))
anywhere.mean(), nearby.mean()

# %% [markdown]
# Both are far from what a search or a trained policy reaches: `maglev compare` shows the distance.
