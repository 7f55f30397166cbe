"""Opening a sealed set: labels are checked against their seal, every answer is judged, figures are collected."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig import Rig
from sim2real.blind.cases import ANSWERS, CAMPAIGNS, answers_digest, open_labels, read_answer, seal_of
from sim2real.blind.judging import scoring
from sim2real.blind.judging.calibration import Reliability, reliability
from sim2real.blind.judging.judging import Judgement, judge
from sim2real.blind.judging.regret import CaseRegret, regret_row, regrets
from sim2real.blind.twin import Truth


@dataclass(frozen=True)
class Opened:
    """A scored set; for the figures see `scoring`.

    Attributes:
        labels_sha256: Seal of the labels.
        answers_sha256: Hash over the answers.
        version: Version of the code that gave the answers.
        judged: All judgements.
        failed: Number of campaigns without a diagnosis.
        again: Number of answers that replace one by another version of the code.
        rows: Figures of every target.
        by_size: Figures for each range of sizes.
        by_channels: Figures for each channel set.
        by_rig: Figures for each rig.
        reliability: Reliability of the stated probabilities.
        regrets: Regret of the sampled cases.
    """

    labels_sha256: str
    answers_sha256: str
    version: str
    judged: tuple[Judgement, ...]
    failed: int
    again: int
    rows: list[scoring.Row]
    by_size: Mapping[str, list[scoring.Row]]
    by_channels: Mapping[str, list[scoring.Row]]
    by_rig: Mapping[str, list[scoring.Row]]
    reliability: Reliability
    regrets: list[CaseRegret]


def open_set(folder: Path, progress: Callable[[int], None] | None = None) -> Opened:
    """Check the seal of the set in `folder` and score its answers.

    Args:
        folder: The sealed set, answered.
        progress: Called with the number of campaigns whose gains were tried on the twin.

    Raises:
        ValueError: Labels were changed, or an answer is missing, belongs to another set, or was given by other code
            than the rest.
    """
    seal, cases = seal_of(folder), open_labels(folder)
    paths = [folder / ANSWERS / f"{case.id}.json" for case in cases]
    judged = tuple(judge(case, read_answer(path, seal)) for case, path in zip(cases, paths, strict=True))
    versions = sorted({j.answer.version for j in judged})
    if len(versions) != 1:
        raise ValueError(f"{folder / ANSWERS}: answers of {' and '.join(versions)}; answer them all with one version")
    tried = regrets(judged, lambda j: _rig_and_truth(folder, j), progress)
    top = np.array([(j.top_probability, j.top_right) for j in judged], dtype=float)
    return Opened(
        seal,
        answers_digest(folder, cases),
        versions[0],
        judged,
        sum(j.answer.error is not None for j in judged),
        sum(bool(j.answer.replaces) for j in judged),
        [*scoring.rows(judged), regret_row(tried)],
        scoring.by_size(judged),
        scoring.by(judged, lambda j: j.case.channels),
        scoring.by(judged, lambda j: j.case.rig),
        reliability(top),
        tried,
    )


def _rig_and_truth(folder: Path, j: Judgement) -> tuple[Rig, Truth]:
    """The nominal rig as the campaign states it, and the truth of the twin."""
    label = j.case.label
    truth = Truth(label["rig"], label["deviations"], label["effects"], label["forms"], label["speed_rpm"])
    return load_campaign(folder / CAMPAIGNS / j.case.id).rig, truth
