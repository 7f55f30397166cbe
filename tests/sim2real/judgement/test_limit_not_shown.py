"""What explains as much without its limit is said, not named."""

from dataclasses import replace
from math import inf

import numpy as np

from maglev_env.rig.rig_file import load_rig
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.limit_not_shown import not_asked_in_words, without_limit_in_words

NAMES = ((), ("amplifier_lag",), ("hysteresis",), ("sensor_resonance",))
REFUSED = np.array([inf, inf, 95.0, 90.0])
EVIDENCE = Evidence(
    NAMES, np.array([900.0, 100.0, inf, inf]), 900.0, np.zeros((4, 1)), np.ones(1), (("plant", "force", 16.0),), {}, {},
    refused=REFUSED,
)  # fmt: skip


def test_a_hysteresis_that_is_a_lag_is_said_beside_the_lag():
    (said,) = without_limit_in_words(EVIDENCE, [1])
    assert said.startswith("hysteresis would explain as much, but as") and "lag" in said
    assert without_limit_in_words(replace(EVIDENCE, refused=REFUSED + 10.0), [1]) == []
    assert without_limit_in_words(EVIDENCE, []) == []
    assert without_limit_in_words(replace(EVIDENCE, refused=None), [1]) == []


def test_an_effect_of_a_coil_that_is_not_stated_is_said_not_to_be_asked():
    rig = load_rig("hmb_free")
    (said,) = not_asked_in_words(replace(rig, coil_inductance=None))
    assert said.startswith("amplifier_voltage_limit was not asked") and "coil_inductance" in said
    assert not_asked_in_words(replace(rig, coil_inductance=1e-3)) == []
