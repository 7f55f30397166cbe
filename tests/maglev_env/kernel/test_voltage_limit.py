"""The supply voltage limits the current that flows and the one that is recorded alike."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment, recorded_channels, without_noise
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

RESISTANCE, INDUCTANCE, VOLTAGE = 2.0, 5.7e-4, 3.0
RIG = replace(load_rig("hmb_free"), coil_resistance=RESISTANCE, coil_inductance=INDUCTANCE)


@pytest.mark.parametrize("lag", [0.0, 1e-4])
@pytest.mark.parametrize("softness", [0.0, 0.3, 1.0])
def test_the_recorded_current_is_the_one_that_the_limit_lets_flow(lag, softness):
    """By the card's formula, step by step, from the recorded commands."""
    wave = Excitation("multisine", "current", 20.0, (101, 151, 173), 0.3, seed=2)
    limit = effect("amplifier_voltage_limit", VOLTAGE, softness=softness)
    rig = replace(RIG, amplifier_time_constant=lag)
    e = without_noise(Experiment(rig, rig.gains, (wave,), 1, 0, limit))
    found = dict(zip(recorded_channels(e), simulate_records([e], threads=1)[0], strict=True))
    h = 1 / rig.control_rate
    slope = -np.expm1(-h * RESISTANCE / INDUCTANCE) / RESISTANCE
    share = -np.expm1(-h / lag) if lag else 1.0
    kept, reach = 1 - RESISTANCE * slope / share, VOLTAGE * slope / share
    flowing, expected = 0.0, []
    for command in found["command"]:
        asked = (command - kept * flowing) / reach
        of_reach = asked / (1 + abs(asked) ** (1 / softness)) ** softness if softness else np.clip(asked, -1, 1)
        after = flowing + share * (kept * flowing + reach * of_reach - flowing)
        expected.append(flowing if lag else after)
        flowing = after
    np.testing.assert_allclose(found["current"], expected, rtol=0, atol=1e-3 * np.ptp(expected))
