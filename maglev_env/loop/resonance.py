"""Second-order modes: the parameters that every resonance has."""

import numpy as np

from maglev_env.loop.card import Parameter

# A resonance can have any frequency, so fits start from a grid of frequencies. The damping ratio at the start is half
# the relative grid spacing, so that neighbouring resonance curves overlap.
RESONANCE_FREQUENCY = Parameter("Hz", 1.0, 2000.0, starts=tuple(np.geomspace(8.0, 1500.0, 36)))
RESONANCE_DAMPING = Parameter("", 1e-3, 0.7, 0.02, starts=(0.07,))


def further_mode(ratio: Parameter) -> dict[str, Parameter]:
    """The parameters of a further mode that a form adds, by name.

    Args:
        ratio: its size beside that of the first one.
    """
    # It is looked for at every frequency, as the first one is; low and high are multiples of that one's.
    frequency = Parameter("", 0.05, 20.0, 2.5, shape=1.0, starts=tuple(np.geomspace(0.15, 7.0, 28)), added=True)
    damping = Parameter("", 1e-3, 0.7, 0.02, shape=1.0, starts=(0.07,), added=True)
    return {"further_ratio": ratio, "further_frequency": frequency, "further_damping": damping}
