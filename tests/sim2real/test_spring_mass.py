"""A mass on a spring that hardens, pushed by a continuous force and recorded at few samples per cycle.

By a general integrator; the force is a sum of sines, so that it is known between the samples, too.
"""

import numpy as np
import pytest
import scipy.integrate
from pushed_campaign import write_campaign

from sim2real.diagnosis import diagnose
from sim2real.pooled import pooled
from sim2real.recorded.records import read_records
from sim2real.search import attribute

RATE, SAMPLES = 600.0, 5000
MASS, STIFFNESS, DAMPING, CUBIC = 5.3e-3, 1050.0, 0.23, 4e9  # a resonance at 71 Hz
RIG = """\
schema = "maglev-rig/1"
name = "springs"
magnet = "none"

[parameters]
mass = 5.3e-3
support_stiffness = 1000.0
support_damping = 0.23
adc_bits = 0
dac_bits = 0
control_rate = 600.0

[tolerance]
mass = 0.01
support_stiffness = 0.2
"""


def campaign(folder, cubic, rms):
    """A recording of 8 s with a force of this size, N, up to a third of the sample rate."""
    rng, time = np.random.default_rng(3), np.arange(SAMPLES) / RATE
    lines = np.arange(5, 1650, 11) * RATE / SAMPLES * 1.0003  # no period in the recording
    waves = rms * np.sqrt(2 / lines.size) * np.exp(2j * np.pi * rng.uniform(size=lines.size))

    def force(t):
        return np.real(np.exp(2j * np.pi * np.outer(np.atleast_1d(t), lines)) @ waves)

    def slope(t, state):
        x, v = state
        return v, (force(t)[0] - DAMPING * v - STIFFNESS * x - cubic * x**3) / MASS

    x = scipy.integrate.solve_ivp(slope, (0, time[-1]), (0, 0), t_eval=time, rtol=1e-7, atol=1e-11, max_step=1e-3).y[0]
    columns = {"force": force(time), "displacement": x + 2e-8 * rng.standard_normal(SAMPLES)}
    return write_campaign(folder, RIG, RATE, columns)


@pytest.mark.slow
def test_a_continuous_force_at_few_samples_per_cycle_tells_spring_and_damper(tmp_path):
    """Held over its samples, the force acts 0.8 ms late, which is a fifth of a radian at the resonance."""
    found = {c.name: c for c in pooled(read_records(campaign(tmp_path, 0.0, 0.02))[1]).coefficients if c.identified}
    stiffness, damping = found["support_stiffness"], found["damping"]
    assert abs(stiffness.value - STIFFNESS) < 2.5 * stiffness.se < 0.04 * STIFFNESS
    assert abs(damping.value - DAMPING) < 2.5 * damping.se < 0.04 * DAMPING


@pytest.mark.slow
def test_a_spring_that_hardens_is_named(tmp_path, monkeypatch):
    """Among what else changes the springs, the mass or the losses; each other effect would compile a kernel."""
    few = ("cubic_spring", "soft_stop", "mass", "support_stiffness", "damping")
    monkeypatch.setattr(attribute, "single_effects", lambda rig: few)
    found = diagnose(campaign(tmp_path, CUBIC, 0.02))
    named = {name for cause in found.cause for name in cause.split("+")}
    assert found.verdict in ("explained", "ambiguous") and named & {"cubic_spring", "soft_stop"}, found.answer
    fits = [c.fit for c in found.attribution.candidates if c.fit.hypothesis.effects == ("cubic_spring",)]
    (coefficient,) = (f.hypothesis.point(f.u).effects["cubic_spring"]["coefficient"] for f in fits)
    assert coefficient == pytest.approx(CUBIC, rel=0.05)
