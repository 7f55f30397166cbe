"""Every effect of the registry is simulated, linearised, sealed, documented and fitted, or its card says why not."""

from dataclasses import replace
from functools import cache
from math import inf
from pathlib import Path

import numpy as np
import pytest

from maglev_env.experiment import protocol_experiment, without_noise
from maglev_env.kernel.lanes import lane_batch, structure_of
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import EFFECTS, effect, meaningful
from maglev_env.loop.free.places import NAMES as FREE
from maglev_env.rig.rig_file import load_rig
from sim2real.blind import menu

DOCS = Path(__file__).parents[3] / "docs" / "formats.md"
# A rig with all that an effect may need.
RIG = replace(load_rig("hmb_free"), axes=2, support_stiffness=500.0, support_damping=3.0, coil_inductance=0.02)
# With these, which change nothing, all lanes share one kernel.
NEUTRAL = {
    **effect("eddy_current", inf),
    **effect("saturation", inf),
    **effect("force_law", 0.0),
    **effect("friction", 0.0, presliding=1e-9),
    **effect("cross_coupling", 0.0),
    **effect("asymmetric_gain", 0.0),
}
# Free corrections have a kernel and tests of their own.
PHYSICAL = [name for name in EFFECTS if name not in FREE]
FREQUENCY = np.geomspace(2.0, 2000.0, 30)


def given(name):
    """The effect with the first values at which a diagnosis starts; where it does not fit it, a plain value."""
    parameters = EFFECTS[name].plain  # other forms have a kernel of their own, and their own tests
    values = {key: p.on(RIG.scales).starts[0] for key, p in parameters.items() if p.starts}
    return effect(name, **values) if values else effect(name, {"gain_drift": 0.1}.get(name, 1e-6))


def with_effects(effects):
    """A short experiment without noise."""
    e = without_noise(protocol_experiment(RIG, effects=effects))
    parts = tuple(replace(x, fundamental=4.0, lines=tuple(n for n in x.lines if n < 200)) for x in e.excitations)
    return replace(e, excitations=parts, periods=1, transient_periods=0, speed_rpm=3000.0)


@cache
def records():
    """Readings in x (samples,) of each effect alone, and of none ("")."""
    lanes = [with_effects(NEUTRAL), *(with_effects({**NEUTRAL, **given(name)}) for name in PHYSICAL)]
    return dict(zip(["", *PHYSICAL], simulate_records(lanes)[:, 0], strict=True))


def responses(effects):
    """Responses (3, n, 2, 2) of the linear loop, each over that of x without effects."""
    found, none = (loop_response(with_effects(given), FREQUENCY) for given in (effects, {}))
    pairs = ((getattr(found, name), getattr(none, name)) for name in ("plant", "receptance", "amplifier"))
    return np.array([one / np.abs(other[:, :1, :1]) for one, other in pairs])


@pytest.mark.parametrize("name", PHYSICAL)
def test_it_changes_the_simulated_record(name):
    assert meaningful(name, RIG.capabilities)
    none, found = records()[""], records()[name]
    together = np.isfinite(none) & np.isfinite(found)
    assert together.sum() > 100
    assert np.abs(found - none)[together].max() > 1e-6 * np.abs(none[together]).max()
    # Alone, too, it reaches its lane: another kernel, or other constants of the same one.
    alone, nominal = with_effects(given(name)), with_effects({})
    if structure_of(alone) == structure_of(nominal):
        assert not np.array_equal(lane_batch([alone]).rows, lane_batch([nominal]).rows)


@pytest.mark.parametrize("name", [name for name, card in EFFECTS.items() if card.linear and not card.not_fitted])
def test_it_changes_the_linear_response(name):
    assert np.abs(responses(given(name)) - responses({})).max() > 1e-6


@pytest.mark.parametrize("name", EFFECTS)
def test_the_sealed_twin_has_it_or_its_card_says_why_not(name):
    card, sealed = EFFECTS[name], menu.EFFECTS.get(name)
    assert (sealed is None) == bool(card.not_sealed)
    if sealed:
        assert sealed.block == card.block


@pytest.mark.parametrize("name", EFFECTS)
def test_the_table_of_effects_has_it(name):
    assert f"| `{name}` | {EFFECTS[name].block} |" in DOCS.read_text()


@pytest.mark.parametrize("name", [name for name, card in EFFECTS.items() if not card.not_fitted])
def test_a_fit_starts_within_its_bounds(name):
    for key, p in EFFECTS[name].plain.items():
        assert p.starts, key
        assert all(p.low <= start <= p.high and start != p.absent for start in p.starts), key
