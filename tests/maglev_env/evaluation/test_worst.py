"""The worst of several rigs or axes, quantity by quantity, where their lines hide what the loops have between them."""

from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.evaluation.judging import _worst_required
from maglev_env.evaluation.worst import worst_hidden
from maglev_env.rig.goal import parse_goal

GOAL = parse_goal("peak_sensitivity <= 3, phase_margin >= 20, worst of 2 rigs")
NAN = np.nan


def arrays(**values):
    return {name: np.array([value]) for name, value in values.items()}


def test_each_quantity_between_the_lines_is_the_worst_of_all():
    names = ("peak_sensitivity", "peak_frequency", "phase_margin", "gain_margin", "disk_margin")
    each = [(2.9, 700.0, 30.0, 1.9, 0.5), (2.8, 650.0, 8.0, 2.0, NAN), (NAN,) * 5]
    found = worst_hidden([arrays(**dict(zip(names, values, strict=True))) for values in each])
    assert [found[name][0] for name in names] == [2.9, 700.0, 8.0, 1.9, 0.5]
    nothing = arrays(**dict.fromkeys(names, NAN))
    assert all(np.isnan(values).all() for values in worst_hidden([nothing, nothing]).values())


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_bounds_hold_what_is_hidden_where_the_lines_are_not_the_worst(order):
    both = [((2.0, 35.0), (86.0, 30.0)), ((2.5, 36.0), (2.8, 8.0))]  # peak |S| and phase margin of lines, and hidden
    parts = [
        SimpleNamespace(
            required=arrays(peak_sensitivity=peak, phase_margin=phase),
            required_low=arrays(peak_sensitivity=0.98 * peak, phase_margin=min(0.98 * phase, hidden[1])),
            required_high=arrays(peak_sensitivity=max(1.02 * peak, hidden[0]), phase_margin=1.02 * phase),
            between_lines=arrays(peak_sensitivity=hidden[0], phase_margin=hidden[1], peak_frequency=700.0),
        )
        for (peak, phase), hidden in both
    ]
    value, low, high = _worst_required(GOAL, [parts[i] for i in order])
    assert value == {"peak_sensitivity": 2.5, "phase_margin": 35.0}
    assert high["peak_sensitivity"] == 86.0 and low["peak_sensitivity"] == pytest.approx(0.98 * 2.5)
    assert low["phase_margin"] == 8.0 and high["phase_margin"] == pytest.approx(1.02 * 35)
