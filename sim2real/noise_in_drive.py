"""How much of what tells a coefficient is an answer to the noise in a measured drive.

Where only what an instrument causes is compared, a change of the rig answers to that noise, too, and would seem to
explain it; `recorded.noise_response` takes its answer off as well as the free directions of the windows tell it. Where
gain, damping and stiffness together do next to nothing along the instrument, most of what they do is that answer, and
what is left of it is a bias that no interval has.
"""

from dataclasses import replace

import numpy as np

from sim2real.compared.problem import Part, Problem
from sim2real.search.fit import Fit
from sim2real.search.fitting import differentiate

# Share of what tells a coordinate from which an answer to noise leaves it untold. On a shaken rotor whose gain was up
# to nine standard errors off it is a fifth to a half; where estimates are right, next to nothing.
MUCH = 0.3


def told_by_noise(problem: Problem, fit: Fit) -> bool:
    """Whether noise in a drive tells one of the coordinates to a share MUCH: then the others follow it."""
    if not any(_corrected(part) for part in problem.parts):
        return False
    plain = replace(problem, parts=tuple(map(_uncorrected, problem.parts)))
    (predicted,) = plain.simulate([fit.hypothesis.point(fit.u)])
    noisy = Fit(fit.hypothesis, fit.u, problem.data - predicted, fit.cost)
    differentiate([noisy], problem.data, plain.simulate, True)
    with_noise, without = (np.diag(f.covariance())[: len(fit.hypothesis.coordinates)] for f in (noisy, fit))
    return bool((with_noise < (1 - MUCH) * without).any())


def _corrected(part: Part) -> bool:
    replay = part.predictor.replay
    return replay is not None and replay.response is not None


def _uncorrected(part: Part) -> Part:
    if not _corrected(part):
        return part
    assert part.predictor.replay is not None
    return replace(part, predictor=replace(part.predictor, replay=replace(part.predictor.replay, response=None)))
