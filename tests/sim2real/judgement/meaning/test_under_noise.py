"""A hysteresis of which noise leaves but a lag is told by whether the noise that is there can have done so."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement.meaning.within_reach import shows_limit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

CURRENT, OMEGA = np.tile([0.02, 0.2], 30), np.geomspace(20.0, 2000.0, 60)
NOISE = 1e-4
H = Hypothesis(("hysteresis",), {}, shaped=("hysteresis",))


def lagging(noise):
    """A simulator in which a share of the current lags by its width over the way that it goes in a second: its own,
    that of the ripple, and where noise is simulated, that of the noise (A/s)."""

    def simulate(points):
        found = []
        for p in points:
            own = {"strength": 0.0, "width": 1.0, "ripple": 0.0} | p.effects.get("hysteresis", {})
            way = OMEGA * CURRENT + own["ripple"] + (noise if p.dithered else 0.0)
            found.append(-own["strength"] * 1j * OMEGA * own["width"] / (way + 1j * OMEGA * own["width"]) / NOISE)
        return np.array(found)

    return simulate


@pytest.mark.parametrize(("noise", "ripple", "shown"), [(1e4, 0.0, True), (0.0, 1e4, False)])
def test_a_lag_in_time_is_a_hysteresis_where_the_noise_makes_its_ripple(noise, ripple, shown):
    simulate = lagging(noise)
    truth = SimpleNamespace(effects={"hysteresis": {"strength": 0.2, "width": 20.0, "ripple": ripple}}, dithered=True)
    data = simulate([truth])[0]
    start = np.zeros(H.size)
    start[:2] = [c.at({"strength": 0.1, "width": 5.0}[c.parameter]) for c in H.coordinates]
    start[len(H.coordinates) + H.calibrated.index("hysteresis.ripple")] = 3.5
    fits = begin([H], [start], data, simulate)
    iterate(fits, data, simulate, 40)
    differentiate(fits, data, simulate, True)
    nothing = float(np.vdot(data, data).real)
    assert fits[0].cost < 0.01 * nothing
    assert shows_limit(SimpleNamespace(data=data, simulate=simulate), fits[0], "hysteresis", nothing) == shown
