"""The converters of the loop: one for the reading, one for the command."""

import numpy as np

from maglev_env.loop.system import Values


def converter_bits(values: Values, name: str) -> np.ndarray:
    """Bits to which a converter rounds ("adc_bits" or "dac_bits"), (n,); 0 of one that does not round."""
    return np.where(values.rig("rounds"), values.rig(name), 0)


def converter_range(values: Values) -> np.ndarray:
    """Largest voltage of either converter, (n,); infinite of ideal ones, `adc_bits` = `dac_bits` = 0."""
    ideal = (values.rig("adc_bits") == 0) & (values.rig("dac_bits") == 0)
    return np.where(ideal, np.inf, values.rig("voltage_range"))
