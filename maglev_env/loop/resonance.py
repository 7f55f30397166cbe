"""Second-order modes: the parameters that every resonance has."""

import numpy as np

from maglev_env.loop.card import Parameter

# A resonance can have any frequency, so fits start from a grid of frequencies. The damping ratio at the start is half
# the relative grid spacing, so that neighbouring resonance curves overlap.
RESONANCE_FREQUENCY = Parameter("Hz", 1.0, 2000.0, starts=tuple(np.geomspace(8.0, 1500.0, 36)))
RESONANCE_DAMPING = Parameter("", 1e-3, 0.7, 0.02, starts=(0.07,))
