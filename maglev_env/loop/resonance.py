"""Second-order modes: the parameters that every resonance has."""

import numpy as np

from maglev_env.loop.card import Parameter

# A resonance may lie anywhere, so its frequency is searched on a grid; the first damping ratio is half the spacing.
RESONANCE_FREQUENCY = Parameter("Hz", 1.0, 2000.0, starts=tuple(np.geomspace(8.0, 1500.0, 36)))
RESONANCE_DAMPING = Parameter("", 1e-3, 0.7, 0.02, starts=(0.07,))
