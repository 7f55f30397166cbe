"""Evidence of campaigns drawn from a known judge's world, to learn from."""

import numpy as np

from maglev_env.rig.rig_file import load_rig
from sim2real.blind.learning.examples import Example
from sim2real.judgement.dispersion import ChiSquare, Dispersion
from sim2real.judgement.evidence import Evidence

RIG = load_rig("hmb_free")
NAMES = ("delay", "damping", "mass", "friction", "saturation", "amplifier_lag")
GROUPS = (("plant", "force", 16.0), ("plant", "force", 32.0))


def drawn(rng, truth: str, gap: float, apart: float) -> Evidence:
    """Costs of a campaign: the truth is the best but for noise, and the others are apart by about so much."""
    cost = 200.0 + gap + np.concatenate([[0.0], -gap + apart * rng.exponential(size=len(NAMES))])
    if truth in NAMES:
        cost[1 + NAMES.index(truth)] = 200.0 + 10 * rng.exponential()
    unknown = truth == "unknown"
    left = np.where(np.isin(["", *NAMES], [truth]), 0.0, cost - 200.0) + (150.0 * rng.exponential() if unknown else 0.0)
    excess = np.repeat(left[:, None] / 2, 2, axis=1)
    chi = ChiSquare(200.0 + left.min(), 200.0, 1.5)
    effects = ((), *((name,) for name in NAMES))
    return Evidence(
        effects, cost, 200.0 + gap, excess, np.full(2, 20.0), GROUPS, {}, {}, {}, Dispersion(chi, chi), np.zeros(7)
    )


def examples(n: int, seed: int) -> list[Example]:
    rng = np.random.default_rng(seed)
    found = []
    for i in range(n):
        truth = str(rng.choice([*NAMES, "none", "unknown"]))
        gap = 0.0 if truth == "none" else 10 ** rng.uniform(1.5, 4)
        family = f"{truth} {i % 8}" if truth in ("none", "unknown") else truth
        found.append(Example(family, frozenset({truth}), drawn(rng, truth, gap, 25.0), RIG))
    return found
