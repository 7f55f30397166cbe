"""A slower rotation tells an unbalance from a runout: at which speed, and how well."""

from collections.abc import Sequence

import numpy as np

from sim2real.advice.proposal import Proposal
from sim2real.compared.point import Point
from sim2real.compared.problem import Part, Problem
from sim2real.judgement.tones.sightings import Sighting, seen_at
from sim2real.judgement.tones.unsynchronised import FORM, once_per_turn

SHARES = (1 / 2, 1 / 3, 1 / 4, 1 / 6, 1 / 8, 1 / 12, 1 / 16)  # of the speed that was recorded
NEARLY = 0.75  # of the best separation: what as much of it is reached by nearer to the recorded speed is preferred
BESIDE = (0.97, 0.985, 1.015, 1.03)  # of a frequency: where noise is looked for that would cover a tone there


def slower(problem: Problem, found: Sequence[Sighting], point: Point) -> Proposal | None:
    """The same recording at a lower speed of rotation, at which a runout and an unbalance differ.

    A runout keeps its size. An unbalance moves the rotor by its moment times the speed squared times the receptance:
    above the frequency of its bearing a rotor turns about its centre of mass, and that is as constant as a runout.

    Args:
        problem: the campaign.
        found: all sightings.
        point: the best known parameters.

    Returns:
        The proposal; None where no rotation was seen, or where lines and noise hide a tone at every lower speed.
    """
    seen = once_per_turn(found)
    if not seen:
        return None
    clearest = max(seen, key=lambda s: s.size / s.sd)
    part = problem.parts[clearest.record]
    told = {share: value for share in SHARES if (value := _separation(clearest, part, point, share)) is not None}
    if not told:
        return None
    share = max(s for s in told if told[s] >= NEARLY * max(told.values()))
    speed = share * part.record.experiment.speed_rpm
    return Proposal(
        f"the same recording at {speed:.4g} rpm, {share:.2g} of the speed of rotation",
        "at high speed both read the same; the force of an unbalance goes with the square of the speed, a runout stays",
        1.0,
        told[share],
        {"speed": share},
        part.record.name,
    )


def _separation(seen: Sighting, part: Part, point: Point, share: float) -> float | None:
    """Expected cost between both at a share of the speed; None where a line or the end of the band hides it."""
    frequency = share * seen.frequency
    at = seen_at(seen.record, part, point, frequency)
    around = [s.sd for factor in BESIDE for s in seen_at(seen.record, part, point, factor * frequency)]
    if not at or not around:
        return None
    unbalance = share**2 * at[0].receptance / seen.receptance
    sd = np.hypot(np.hypot(seen.sd, np.median(around)), FORM * seen.size)
    return float((seen.size * (1 - unbalance) / sd) ** 2)
