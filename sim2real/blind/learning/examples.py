"""Examples to learn from: the evidence of answers to opened sets of the benchmark, and the truth."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.blind.cases import ANSWERS, CAMPAIGNS, Case, named, open_labels
from sim2real.judgement.belief import Judge
from sim2real.judgement.evidence import Evidence
from sim2real.judgement.evidence_json import evidence_from_json
from sim2real.judgement.judge import Entry, entries
from sim2real.judgement.mechanisms import by_mechanism


@dataclass(frozen=True)
class Example:
    """A campaign to learn from.

    Attributes:
        family: What its truth is a form of: names of mechanisms, or the name of an unknown cause. Without an effect,
            each campaign is a family.
        truth: The right hypothesis, by the names of mechanisms.
        evidence: What was found.
        rig: The nominal rig.
        version: Of the code that answered.
    """

    family: str
    truth: frozenset[str]
    evidence: Evidence
    rig: Rig
    version: str = ""

    def found(self, judge: Judge) -> list[Entry]:
        """Its hypotheses by a judge. "calibration" is "none", because a real rig is never exactly nominal."""
        return by_mechanism(entries(self.evidence, judge), self.rig)

    def probability(self, judge: Judge) -> float:
        """Probability that a judge gives the truth."""
        return sum(e.probability for e in self.found(judge) if named(e.effects) == self.truth)


def examples_of(folders: Sequence[Path]) -> list[Example]:
    """Examples of answered sets of the benchmark, in order.

    Failed answers are left out. Effects too small to show, and what no method could tell, teach how often there is
    something that is not seen: without them a judge is too sure on campaigns as they come.

    Raises:
        ValueError: An answer holds no evidence, or none that can be read.
    """
    found = []
    for folder in folders:
        for case in open_labels(folder):
            data = json.loads((folder / ANSWERS / f"{case.id}.json").read_text())
            if "error" in data:
                continue
            evidence = data["diagnosis"].get("evidence")
            if evidence is None:
                raise ValueError(f"{folder / ANSWERS}/{case.id}.json holds no evidence: answer the set again")
            rig = load_rig(folder / CAMPAIGNS / case.id / "rig.toml")
            try:
                read = evidence_from_json(evidence)
            except ValueError as error:
                raise ValueError(f"{folder / ANSWERS}/{case.id}.json: {error}") from None
            found.append(Example(family_of(case, rig), truth_of(case, rig), read, rig, data["version"]))
    return found


def family_of(case: Case, rig: Rig) -> str:
    """What the truth is a form of, by the names of mechanisms: one truth has one family."""
    return "+".join(sorted(_mechanism(case.effects, rig))) or f"none, {case.id}"


def truth_of(case: Case, rig: Rig) -> frozenset[str]:
    """The right hypothesis, by the names of mechanisms."""
    return frozenset(_mechanism(case.truth, rig))


def _mechanism(effects: frozenset[str], rig: Rig) -> tuple[str, ...]:
    (entry,) = by_mechanism([Entry(tuple(sorted(effects)), 1.0, 0.0, None, None)], rig)
    return entry.effects
