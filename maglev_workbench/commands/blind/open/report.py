"""A blind check as a page, as markdown and as JSON."""

from collections.abc import Mapping, Sequence
from typing import Any

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.blind.open.figures import reliability_figure
from maglev_workbench.commands.blind.open.tables import DEFINITIONS, HEAD, cells, missed, tables
from maglev_workbench.page import markdown_table, note, page, table
from sim2real.blind.judging.judging import Judgement
from sim2real.blind.judging.opening import Opened
from sim2real.blind.judging.scoring import Row

TITLE = "The blind check of diagnoses"


def blind_page(opened: Opened, made: Mapping[str, Any]) -> str:
    """HTML of the check; made: how the set was made, the content of set.json."""
    targets = table(HEAD, map(cells, opened.rows))
    sections = [
        ("Targets", targets + "".join(note(line) for line in missed(opened))),
        ("Stated and kept probability", reliability_figure(opened.reliability)),
        *((t.heading, table(t.head, t.rows) if t.rows else note("None.")) for t in tables(opened)),
        ("What the figures mean", "".join(map(note, DEFINITIONS))),
    ]
    return page(TITLE, summary(opened), sections, _made_by(opened, made))


def blind_markdown(opened: Opened, made: Mapping[str, Any], picture: str) -> str:
    """The same as markdown; picture: file name of the reliability plot in the same folder."""
    parts = [f"# {TITLE}", summary(opened), markdown_table(HEAD, map(cells, opened.rows))]
    if lines := missed(opened):
        parts += ["Not reached, or not settled by so many campaigns:", "\n".join(f"- {line}" for line in lines)]
    parts += [f"![Share right against stated probability]({picture})"]
    for t in tables(opened):
        parts += [f"## {t.heading}", markdown_table(t.head, t.rows) if t.rows else "None."]
    parts += ["## What the figures mean", *DEFINITIONS, "## What made this page"]
    parts.append("\n".join(f"- {name}: {value}" for name, value in _made_by(opened, made).items()))
    return "\n\n".join(parts) + "\n"


def blind_json(opened: Opened, made: Mapping[str, Any]) -> dict[str, Any]:
    """Everything as JSON data, schema maglev-blind/1."""
    grouped = {"size": opened.by_size, "channels": opened.by_channels, "rig": opened.by_rig}
    return plain(
        {
            "schema": "maglev-blind/1",
            "set": made,
            "labels_sha256": opened.labels_sha256,
            "answers_sha256": opened.answers_sha256,
            "version": opened.version,
            "campaigns": len(opened.judged),
            "failed": opened.failed,
            "answered_again": opened.again,
            "targets": _rows(opened.rows),
            "by": {name: {part: _rows(rows) for part, rows in of.items()} for name, of in grouped.items()},
            "reliability": opened.reliability,
            "regret": opened.regrets,
            "cases": [_case(j) for j in opened.judged],
        }
    )


def summary(opened: Opened) -> str:
    """One sentence with the number of targets that were reached."""
    aimed = [r for r in opened.rows if r.target and r.n]
    counts = [sum(r.verdict == verdict for r in aimed) for verdict in ("ambitious", "floor", "missed")]
    return (
        f"{len(opened.judged)} sealed campaigns, {opened.failed} without an answer: of {len(aimed)} targets "
        f"{counts[0]} reached with ambition, {counts[1]} at the floor, {counts[2]} missed."
    )


def _made_by(opened: Opened, made: Mapping[str, Any]) -> dict[str, object]:
    again = {"Answers that replace one by another version": opened.again} if opened.again else {}
    return {
        "Campaigns": made["count"],
        "Seed": made["seed"],
        "SHA-256 of the labels": opened.labels_sha256,
        "SHA-256 of the answers": opened.answers_sha256,
        "Version of the code that answered": opened.version,
        **again,
    }


def _rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    keys = ("name", "value", "low", "high", "n", "unit", "verdict", "decided")
    found = [{key: getattr(r, key) for key in keys} for r in rows]
    for data, r in zip(found, rows, strict=True):
        data |= {"floor": r.target.floor, "ambitious": list(r.target.ambitious)} if r.target else {}
    return found


def _case(j: Judgement) -> dict[str, Any]:
    case, answer = j.case, j.answer
    judged = {k: v for k, v in vars(j).items() if k not in ("case", "answer")}
    return {
        "id": case.id,
        "kind": case.kind,
        "rig": case.rig,
        "channels": case.channels,
        "effects": sorted(case.effects),
        "size": case.size,
        "verdict": answer.verdict,
        "cause": [sorted(member) for member in answer.cause],
        "error": answer.error,
        "seconds": answer.seconds,
        **judged,
    }
