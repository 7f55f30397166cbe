"""Does what a diagnosis asks for decide? Recordings that answers propose, made on the true rigs and diagnosed again."""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
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
Advice = Mapping[str, Any]  # next_experiments of a diagnosis, as JSON data


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

    As on a bench, the second recording is the one that the diagnosis with the first one asks for.

    Args:
        case: Of an open set.
        diagnosis: Its answer's, as JSON data.
        seed: Of the set.
        count: Of the set.
        diagnose: Diagnoses a campaign folder, as JSON data.
    """
    made = make(plan(count, seed)[int(case.id[1:]) - 1], seed)
    rng = random.Random(f"{seed} {case.id}")

    def drawn(advice: Advice) -> Advice:
        of = next((p["of"] for p in advice["proposals"]), "")
        return {**advice, "proposals": [{**one, "of": of} for one in rng.sample(advice["menu"], len(advice["menu"]))]}

    advice = diagnosis.get("next_experiments")
    return {
        "proposed": _tried(case, made, advice, lambda own: own, seed, diagnose),
        "random": _tried(case, made, advice, drawn, seed, diagnose),
    }


def _tried(
    case: Case, made: Made, advice: Advice | None, by: Callable[[Advice], Advice], seed: int, diagnose: Diagnose
) -> Tried:
    rows, what, verdicts = recorded(made, seed), [], []
    asked_for = list(by(advice)["proposals"]) if advice else []
    while asked_for and len(what) < MOST:
        choice = asked_for.pop(0)
        what.append(choice["what"])
        try:
            rows.append(again(made, choice.get("of", ""), choice["change"], len(what), seed))
        except LoopFailed:
            verdicts.append("touchdown")
            continue
        made = replace(made, recordings=[*made.recordings, rows[-1].recording])
        with TemporaryDirectory(prefix="maglev-") as folder:
            campaign = Path(folder) / case.id
            write_campaign(campaign, made.truth.rig, case.channels, rows)
            found = diagnose(campaign)
        answer = parse_diagnosis(found, 0.0, "")
        verdicts.append(answer.verdict)
        if told(judged_with_rivals(case, answer)):
            return Tried(tuple(what), tuple(verdicts), len(what))
        if (new := found.get("next_experiments")) and new["proposals"]:
            asked_for = [one for one in by(new)["proposals"] if one["what"] not in what]
    return Tried(tuple(what), tuple(verdicts), None)


def share_decided(tried: Sequence[Tried], count: int) -> float:
    """Share of campaigns that at most `count` recordings decide."""
    return sum(t.decided is not None and t.decided <= count for t in tried) / max(1, len(tried))


def recordings_made(tried: Tried) -> int:
    """Recordings until the cause was named, or all."""
    return tried.decided or MOST
