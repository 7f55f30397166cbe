"""The values that gains of a rig are scored against; what its file leaves out is that of its own gains."""

import numpy as np

from estimation.max_likelihood import maximum_likelihood
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.evaluation.score import ScoreTarget
from maglev_env.experiment import Experiment
from maglev_env.kept import by_value
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig


def score_target(rig: Rig) -> ScoreTarget:
    """Target of a one-axis rig; a stiffness or damping that it does not give is that of its nominal preset loop.

    For an axis of an x-y rig see `rig.axis_rig`.

    Raises:
        ValueError: The preset gains do not stabilise the nominal loop.
    """
    t = rig.target
    stiffness, damping = t.stiffness, t.damping
    if stiffness is None or damping is None:
        nominal = _nominal_coefficients(rig)
        stiffness, damping = stiffness or nominal[0], damping or nominal[1]
    return ScoreTarget(stiffness, damping, t.peak_sensitivity, rig.clearance, t.current_limit, rig.gap)


def protocol_of(rig: Rig) -> Protocol:
    """The identification experiment of a rig.

    Raises:
        ValueError: The rig has none.
    """
    if rig.protocol is None:
        raise ValueError(f"rig {rig.name}: its TOML has no [protocol], by which gains are scored; give one")
    return rig.protocol


@by_value(16)
def _nominal_coefficients(rig: Rig) -> tuple[float, float]:
    p = protocol_of(rig)
    experiment = Experiment(rig, rig.gains or NO_CONTROLLER, p.excitations, p.periods, p.transient_periods)
    radius = np.abs(closed_loop_poles(experiment)).max()
    if radius >= 1:
        raise ValueError(
            f"rig {rig.name}: [gains] do not stabilise it (pole radius {radius:.4f}); set [target] or gains"
        )
    statistics = force_statistics(
        expected_statistics(experiment, lines_at(experiment.excitations, "force")), experiment
    )
    estimate = maximum_likelihood(statistics, np.array([rig.target.band]), rig.mass, intervals=False)
    return float(estimate.stiffness[0]), float(estimate.damping[0])
