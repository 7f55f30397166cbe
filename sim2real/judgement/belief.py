"""The judge: constants by which evidence becomes probability, as learned from campaigns whose truth is known.

`maglev blind learn` makes `judge.json`, which is shipped and says what made it.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from sim2real.judgement.evidence import Evidence

SCHEMA = "maglev-judge/1"
FILE = "judge.json"
LEVEL = 0.9  # share of campaigns of which a set of hypotheses is to hold the truth
NO_SET = 1.0  # in `Judge.reached`: no set does, not even that of all hypotheses, which may lack the truth


@dataclass(frozen=True)
class Belief:
    """How evidence becomes probability.

    Costs differ by a few units where noise decides, and by shares of the whole gap where the form of an effect does. A
    cost that exceeds the best by d therefore counts as freedom ln(1 + d / (freedom + form)): about d when d is small,
    and growing slowly beyond what another form of the same effects leaves unexplained.

    Attributes:
        freedom: Cost difference above which the logarithm bends.
        form_share: Share of the gap that another form may leave; the form_share of each effect's card adds its share
            of what that effect saves.
        prior_singles: Prior odds of all single effects together, against calibration.
        prior_pairs: Prior odds of all pairs together.
        prior_none: Prior odds of the untouched nominal rig.
        leftover: Multiple of its form share that an effect may leave of a single group's gap.
        group_sd: Standard deviations beyond the noise that a free correction of a group must explain.
        group_cost: Cost of such a correction.
        unknown_cost: Log odds against an unknown cause where no group is left unexplained.
        unknown_alike: The same where what explains describes a law of force (`EffectCard.describes`), which unknown
            causes have, too: a seal is a spring, and a film of fluid a damper. Of 88 that were named in two sealed
            sets, 25 were unknown causes, and of 108 others one.
        parameter_cost: Cost of each parameter of an effect beyond its first, which noise alone lets it save.
        search_cost: The same for searching a frequency.
        form_cost: Penalty on a form that may leave more than WIDE_FORM of the gap, per factor e, because it predicts
            every cost less sharply.
    """

    freedom: float = 30.0
    form_share: float = 0.0005
    prior_singles: float = 0.4
    prior_pairs: float = 0.02
    prior_none: float = 0.3
    leftover: float = 3.0
    group_sd: float = 4.5
    group_cost: float = 30.0
    unknown_cost: float = 2.6
    unknown_alike: float = 1.0
    parameter_cost: float = 4.0
    search_cost: float = 10.0
    form_cost: float = 1.0


@dataclass(frozen=True)
class Judge:
    """A belief, and what campaigns with a known truth say of it on each set of channels (see `channels_of`).

    Attributes:
        belief: Its constants.
        trust: Exponent of probabilities: below 1 where they were too sure.
        reached: Probability that the most probable hypotheses must exceed together so that they hold the truth in LEVEL
            of all campaigns (conformal prediction: V. Vovk, A. Gammerman and G. Shafer, 2005); NO_SET where none does.
        left: What is left beyond noise and forms where the truth is a known cause, in ascending order.
        surest: Largest probability of an unknown cause: an effect may have a form that leaves as much.
        right: How often the most probable hypothesis is right, of those that something acts: (a, b) of the logit
            a + b logit(p) of that, where p is its probability (J. Platt, 1999).
        made_by: What made it.
    """

    belief: Belief = Belief()
    trust: Mapping[str, float] = field(default_factory=dict)
    reached: Mapping[str, float] = field(default_factory=dict)
    left: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    surest: float = 1.0
    right: tuple[float, float] = (0.0, 1.0)
    made_by: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The judge as schema maglev-judge/1."""
        return {"schema": SCHEMA, **asdict(self)}


def channels_of(evidence: Evidence) -> str:
    """The set of channels that evidence is of: "current", or "displacement" where no current was recorded."""
    return "current" if any(output == "amplifier" for output, *_ in evidence.groups) else "displacement"


def judge_from(data: Mapping[str, Any]) -> Judge:
    """A judge from its JSON data.

    Raises:
        ValueError: It has another schema.
    """
    if data.get("schema") != SCHEMA:
        raise ValueError(f"judge: schema {data.get('schema')!r} is not {SCHEMA}; make it by maglev blind learn")
    left = {name: tuple(values) for name, values in data["left"].items()}
    a, b = map(float, data["right"])
    return Judge(
        Belief(**data["belief"]), data["trust"], data["reached"], left, data["surest"], (a, b), data["made_by"]
    )


@cache
def shipped() -> Judge:
    """The judge of this version."""
    return judge_from(json.loads(files("sim2real.judgement").joinpath(FILE).read_text()))
