"""The search for gains on the rig that the recordings show: its best point, and the calmest one nearby."""

import numpy as np

from tuning.campaign.candidates import FEW, search_scores
from tuning.campaign.carried import louder
from tuning.campaign.model import Model
from tuning.search.evolution import DifferentialEvolution
from tuning.search.space_filling import Sobol
from tuning.tuner import Trials

SEARCH, GENERATIONS = 8, 12  # population per gain, and number of generations
NEARBY, TRIED = 256, 24  # points looked at around recorded gains, and those of them that are simulated
REACH = 0.6  # of the box's half width: half the edge of the cube in which these points lie


def optimum(model: Model, start: np.ndarray, limit: float, rng: np.random.Generator, draws: int = FEW) -> np.ndarray:
    """Best point (k,) within the rig's bounds, whose margins are surely kept.

    Args:
        model: The rig.
        start: Point from which the search also begins.
        limit: Largest peak sensitivity.
        rng: Source of all random numbers.
        draws: Of each point; of 1, the best estimate counts as if it were sure.
    """
    low, high = model.corners
    inside = np.clip(2 * (start - low) / (high - low) - 1, -1.0, 1.0)
    search = DifferentialEvolution(low.size, int(rng.integers(2**31)), SEARCH, inside)
    best, score = np.clip(start, low, high), -1.0
    for _ in range(GENERATIONS):
        asked = search.ask(10**6)
        points = low + (high - low) * (asked + 1) / 2
        scores = search_scores(model, points, limit, draws)
        search.tell(Trials(asked, scores, np.zeros((len(asked), 0)), ({},) * len(asked), np.zeros(len(asked), bool)))
        if scores.max() > score:
            best, score = points[scores.argmax()], float(scores.max())
    search.close()
    return best


def nearby(model: Model, anchor: np.ndarray, most: float, seed: int) -> np.ndarray:
    """Points (n, k) around recorded gains whose controller is nowhere more than e^most times louder or quieter."""
    cube = anchor + REACH * Sobol(anchor.size, seed).ask(NEARBY)
    points = np.clip(cube, *model.corners)
    own, rate = model.gains(anchor), model.task.rig.control_rate
    return points[[louder(own, model.gains(p), rate) <= most for p in points]]


def peak_bounds(model: Model, points: np.ndarray) -> np.ndarray:
    """Largest |S| (n,) of a few draws at points (n, k), by the responses."""
    found = []
    for point in points:
        gains = model.gains(point)
        found.append(np.abs(model.responses.sensitivity(gains, model.apart(gains), FEW)).max())
    return np.array(found)
