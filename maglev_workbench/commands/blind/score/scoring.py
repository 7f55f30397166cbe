"""Scoring a set of the benchmark: table, markdown and JSON."""

import json
from pathlib import Path

from rich.table import Table

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.formats.json_data import plain
from maglev_env.recordings.result_folder import locked
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_workbench.commands.blind.open.tables import alike, amount
from maglev_workbench.commands.blind.sealed_set import made_of
from maglev_workbench.console import console, write_json
from maglev_workbench.page import markdown_table, number
from sim2real.blind.answer import OPENED
from sim2real.blind.benchmark.scores import Benchmark, Method, by_family, misses, rivals_of, score_set, tellable
from sim2real.blind.cases import ANSWERS
from sim2real.blind.judging.judging import Judgement
from sim2real.blind.judging.scoring import Row, answer_words, truth_words

TITLE = "# The blind check of diagnoses"
INTRODUCTION = (
    "Sealed campaigns of the [benchmark](benchmark.md), whose generator shares no code with simulator and diagnosis. "
    "The labels were hashed before any answer, and opened once. The oracle knows the true forms: what it cannot tell, "
    "no method can, and our share of what it tells is the row that counts. `answers` are those of `maglev diagnose`, "
    "the others of two foils. What the rows mean, and what was missed and why: [benchmark](benchmark.md). Intervals: "
    "95 %, Wilson's for shares."
)
LISTED = 0.5  # share of the campaigns, at most, that a method may miss for the page to list them


def score_folder(folder: Path, answers: list[Path], docs: Path | None, json_file: Path | None) -> None:
    """Score folders of answers to a set, write the results and print the table.

    What this version of the code scored before in other folders stays in the set's own results.

    Raises:
        ValueError: It is no set of the benchmark, or nothing was answered.
    """
    made = made_of(folder)
    if not made.get("benchmark"):
        raise ValueError(f"{folder} is no set of the benchmark: open it with maglev blind open {folder}")
    answers = answers or sorted(path for path in folder.glob(f"{ANSWERS}*") if path.is_dir())
    if not answers:
        raise ValueError(f"{folder} holds no answers: answer it first (maglev blind answer {folder})")
    with locked(folder):
        found = score_set(folder, answers)
        data = {
            "schema": "maglev-benchmark/1",
            "version": code_version(DIAGNOSING, blind=True),
            "set": made,
            **_data(found),
        }
        write_json(folder / OPENED, data | {"methods": [*_kept(folder / OPENED, data), *data["methods"]]})
    write_json(json_file, data)
    if docs is not None:
        write_text_atomic(docs, _markdown(found, made))
    grid = Table(title=f"maglev blind score: {len(found.cases)} sealed campaigns")
    for heading in _head(found):
        grid.add_column(heading, justify="left" if heading == "figure" else "right")
    for cells in _table(found):
        grid.add_row(*cells)
    console.print(grid)
    console.print(f"labels {found.labels_sha256}: as sealed\ndata  {folder / OPENED}")


def _kept(path: Path, data: dict) -> list[dict]:
    """Methods of earlier results on the same labels that are not scored now."""
    if not path.is_file():
        return []
    before, names = json.loads(path.read_text()), {one["name"] for one in data["methods"]}
    same = all(before.get(key) == data[key] for key in ("schema", "version", "labels_sha256"))
    kept = [one for one in before.get("methods", ()) if one["name"] not in names]
    if kept and not same:
        console.print(f"scored by another version of the code, not kept: {', '.join(one['name'] for one in kept)}")
    return kept if same else []


def _head(found: Benchmark) -> tuple[str, ...]:
    return ("figure", "oracle", *(m.name for m in found.methods))


def _cell(row: Row) -> str:
    if not row.n:
        return "–"
    interval = "" if row.unit == "s" else f" [{amount(row.low, row.unit)}, {amount(row.high, row.unit)}]"
    return f"{amount(row.value, row.unit)}{interval} of {row.n}"


def _table(found: Benchmark) -> list[tuple[str, ...]]:
    rows = []
    for n, row in enumerate(found.methods[0].rows):
        oracle = amount(found.oracle[n].value, "share") if n < len(found.oracle) and found.oracle[n].n else "–"
        rows.append((row.name, oracle, *(_cell(m.rows[n]) for m in found.methods)))
    return rows


def _miss(j: Judgement) -> tuple[str, ...]:
    size = "–" if j.case.size is None else number(j.case.size)
    words = j.answer.error or answer_words(j)
    return (j.case.id, j.case.rig, j.case.channels, truth_words(j), size, words)


def _markdown(found: Benchmark, made: dict) -> str:
    untold = [c for c in found.cases if c.kind != "none" and (c.size or 0) >= 1 and not tellable(c)]
    parts = [TITLE, INTRODUCTION, markdown_table(_head(found), _table(found)), "## By rig", _families(found.methods)]
    parts += ["## What no method could have told"]
    rows = [(c.id, c.rig, c.channels, " + ".join(sorted(c.effects)), number(c.size), _or(rivals_of(c))) for c in untold]
    parts += [markdown_table(("campaign", "rig", "channels", "truth", "size", "rivals"), rows) if rows else "None."]
    head = ("campaign", "rig", "channels", "truth", "size", "answer")
    for method in found.methods:
        wrong = [_miss(j) for j in misses(method)]
        listed = markdown_table(head, wrong) if wrong else "None."
        if len(wrong) > LISTED * len(found.cases):
            listed = f"{len(wrong)} of {len(found.cases)} campaigns: too many to be listed."
        parts += [f"## Missed by {method.name}", listed]
    look_alike = alike()
    parts += [f"## {look_alike.heading}", markdown_table(look_alike.head, look_alike.rows), "## Made by"]
    command = f"maglev blind run --benchmark --count {made['count']} --seed {made['seed']} --out sealed --docs FILE"
    made_by = {
        "Command": f"`{command}`",
        "Campaigns": made["count"],
        "Seed": made["seed"],
        "SHA-256 of the labels": found.labels_sha256,
    }
    made_by |= {f"Version of the code, {m.name}": m.version for m in found.methods}
    parts.append("\n".join(f"- {name}: {value}" for name, value in made_by.items()))
    return "\n\n".join(parts) + "\n"


def _or(members: list[frozenset[str]]) -> str:
    return " or ".join(" + ".join(sorted(member)) for member in members)


def _families(methods: tuple[Method, ...]) -> str:
    shares = [by_family(m) for m in methods]
    rows = [(name, *(_cell(share[name]) for share in shares)) for name in shares[0]]
    return markdown_table(("told, of what can be told", *(m.name for m in methods)), rows)


def _data(found: Benchmark) -> dict:
    keys = ("name", "value", "low", "high", "n", "unit")
    return plain(
        {
            "labels_sha256": found.labels_sha256,
            "oracle": [{key: getattr(r, key) for key in keys} for r in found.oracle],
            "methods": [
                {
                    "name": m.name,
                    "version": m.version,
                    "failed": m.failed,
                    "answered_again": sum(bool(j.answer.replaces) for j in m.judged),
                    "rows": [{key: getattr(r, key) for key in keys} for r in m.rows],
                    "missed": [j.case.id for j in misses(m)],
                }
                for m in found.methods
            ],
            "cases": [
                {
                    "id": c.id,
                    "kind": c.kind,
                    "effects": sorted(c.effects),
                    "size": c.size,
                    "rivals": [sorted(r) for r in rivals_of(c)],
                }
                for c in found.cases
            ],
        }
    )
