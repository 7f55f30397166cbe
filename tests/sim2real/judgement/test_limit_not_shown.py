"""What explains as much without its limit is said, not named."""

from dataclasses import replace
from math import inf

import numpy as np

from sim2real.judgement.evidence import Evidence
from sim2real.judgement.limit_not_shown import without_limit_in_words

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
