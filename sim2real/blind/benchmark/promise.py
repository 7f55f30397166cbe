"""Does what a diagnosis asks for decide? Recordings that answers propose, made on the true rigs and diagnosed again."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sim2real.blind.answer import Diagnose
from sim2real.blind.benchmark.again import again
from sim2real.blind.benchmark.generate import Made, make, plan, recorded
from sim2real.blind.benchmark.scores import VISIBLE, judged_with_rivals, told
from sim2real.blind.benchmark.simulate import LoopFailed
from sim2real.blind.benchmark.write import write_campaign
from sim2real.blind.cases import Answer, Case, parse_diagnosis
from sim2real.blind.judging.judging import size_range

MOST = 2  # recordings that are made
OPEN = ("ambiguous", "unexplained")


@dataclass(frozen=True)
class Tried:
    """Recordings that were added to a campaign, one after another until its cause was named.

    Attributes:
        what: What each of them was.
        verdicts: The verdict with each of them and all before it.
        decided: After how many the truth and nothing else was named; None: after none.
    """

    what: tuple[str, ...]
    verdicts: tuple[str, ...]
    decided: int | None


def asked(case: Case, answer: Answer) -> bool:
    """Whether a known effect that can be seen was answered by a class, or as unknown."""
    return case.kind in ("single", "pair") and size_range(case) in VISIBLE and answer.verdict in OPEN


def try_both(case: Case, diagnosis: Mapping[str, Any], seed: int, count: int, diagnose: Diagnose) -> dict[str, Tried]:
    """Make what is proposed, and beside it what a random choice from the same menu asks for.

    Args:
        case: Of an open set.
        diagnosis: Its answer's, as JSON data.
        seed: Of the set.
        count: Of the set.
        diagnose: Diagnoses a campaign folder, as JSON data.
    """
    asked_for = diagnosis.get("next_experiments") or {"proposals": [], "menu": []}
    number = int(case.id[1:])
    made = make(plan(count, seed)[number - 1], seed)
    of = next((p["of"] for p in asked_for["proposals"]), "")
    drawn = list(asked_for["menu"])
    random.Random(f"{seed} {number}").shuffle(drawn)
    return {
        "proposed": _tried(case, made, asked_for["proposals"][:MOST], of, seed, diagnose),
        "random": _tried(case, made, drawn[:MOST], of, seed, diagnose),
    }


def _tried(
    case: Case, made: Made, choices: Sequence[Mapping[str, Any]], of: str, seed: int, diagnose: Diagnose
) -> Tried:
    rows, what, verdicts = recorded(made, seed), [], []
    for number, choice in enumerate(choices, 1):
        what.append(choice["what"])
        try:
            rows.append(again(made, of, choice["change"], number, seed))
        except LoopFailed:
            verdicts.append("touchdown")
            continue
        with TemporaryDirectory(prefix="maglev-") as folder:
            campaign = Path(folder) / case.id
            write_campaign(campaign, made.truth.rig, case.channels, rows)
            answer = parse_diagnosis(diagnose(campaign), 0.0, "")
        verdicts.append(answer.verdict)
        if told(judged_with_rivals(case, answer)):
            return Tried(tuple(what), tuple(verdicts), number)
    return Tried(tuple(what), tuple(verdicts), None)


def share_decided(tried: Sequence[Tried], count: int) -> float:
    """Share of campaigns that at most `count` recordings decide."""
    return sum(t.decided is not None and t.decided <= count for t in tried) / max(1, len(tried))


def recordings_made(tried: Tried) -> int:
    """Recordings until the cause was named, or all."""
    return tried.decided or MOST
