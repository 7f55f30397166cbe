"""Learning from a set: the judge's file, and a table of what it is worth."""

import json
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from rich.table import Table

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.formats.json_data import plain
from maglev_env.recordings.result_folder import locked
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_workbench.commands.blind.sealed_set import made_of
from maglev_workbench.console import console, progress_bar, write_json
from sim2real.blind.answer import OPENED
from sim2real.blind.cases import ANSWERS, seal_of
from sim2real.blind.learning.examples import Example, examples_of
from sim2real.blind.learning.learn import Learned, learn
from sim2real.judgement.belief import Judge
from sim2real.judgement.evidence_json import evidence_to_json


def learn_folder(folder: Path, out: Path, json_file: Path | None) -> None:
    """Learn from the answers to a set, write the judge, and print what it is worth.

    Raises:
        ValueError: The set has too few families of causes, or its answers hold no evidence.
    """
    made = made_of(folder)
    with locked(folder):
        examples = examples_of([folder])
        versions = {example.version for example in examples}
        if len(versions) != 1:
            raise ValueError(f"{folder / ANSWERS}: answers of {len(versions)} versions; learn from a set of one")
        if not (folder / OPENED).exists():  # its truth is known from here on
            write_json(folder / OPENED, {"schema": "maglev-learned/1", "set": made})
    with progress_bar() as bar:
        task = bar.add_task("learning", total=None)
        found = learn(examples, Judge(), lambda step: bar.update(task, description=f"learning: {step}"))
    digest = sha256(json.dumps([plain(evidence_to_json(e.evidence)) for e in examples]).encode()).hexdigest()
    worth = _worth(found, examples)
    made_by = {
        "command": f"maglev blind learn --count {made['count']} --seed {made['seed']}",
        "version": versions.pop(),
        "learned_by": code_version(DIAGNOSING, blind=True),
        "labels_sha256": seal_of(folder),
        "evidence_sha256": digest,
        **worth,
    }
    judge = replace(found.judge, made_by=made_by).to_json()
    write_text_atomic(out, json.dumps(judge, indent=1, allow_nan=False) + "\n")
    write_json(json_file, judge)
    grid = Table(title="maglev blind learn: families of causes that were left out in turn")
    for heading in ("figure", "learned", "unlearned"):
        grid.add_column(heading, justify="left" if heading == "figure" else "right")
    for name, pair in (("mean ln of the truth's probability", found.score), ("calibration error", found.error)):
        grid.add_row(name, *(f"{value:.3f}" for value in pair))
    grid.add_row("hypotheses in a 90 % set, median", f"{found.size:g}", "–")
    console.print(grid)
    console.print(f"{worth['examples']} campaigns, {worth['families']} families\njudge  {out}")


def _worth(found: Learned, examples: list[Example]) -> dict:
    names = ("score", "error")
    return {
        "examples": len(examples),
        "families": len({e.family for e in examples}),
        "left_out": {
            name: dict(zip(("learned", "unlearned"), pair, strict=True))
            for name, pair in zip(names, (found.score, found.error), strict=True)
        }
        | {"size": found.size},
    }
