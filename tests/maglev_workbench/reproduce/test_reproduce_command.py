"""`maglev reproduce` as a user runs it: names, page, markdown and JSON, and what is left when it is stopped."""

import json
import re
import subprocess
import sys
from functools import partial
from math import inf, nan
from pathlib import Path

import pytest
from command_line import maglev

from maglev_workbench.commands.reproduce import registry
from maglev_workbench.commands.reproduce.contents import CONTENTS
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.commands.reproduce.registry import HOME, chosen
from maglev_workbench.commands.reproduce.report import cells, reproduce_markdown, summary

DOCS = Path(__file__).parents[3] / "docs" / "reproduce.md"
# Rows on a figure that is counted in another unit, or as a part of another figure.
OTHER_UNITS = {
    "Rotation", "Outlet pressure", "Optimised rotation", "Optimised pressure",  # rad/s and Pa
    "radial displacement at 14,000 rpm",  # over that at 10,000 rpm
    "supply current, linear amplifiers, one for each coil",  # the power over 23.5 V
    "the same, control currents alone, one for each axis",
    "delay of that lag", "with noise: delay",  # a lag in degrees
}  # fmt: skip
QUICK = ("hydraulics", "bearing-coefficients", "stability-conditions", "pedestal", "static-calibration", "sphs")

run = partial(maglev, "reproduce")


def test_items_are_run_and_written(tmp_path):
    out, docs, js = tmp_path / "out", tmp_path / "r.md", tmp_path / "r.json"
    text = run("sphs", "pedestal", "--out", out, "--docs", docs, "--json", js, "--seed", 3)
    assert "2 experiments" in text and "Of 5 predictions of a published figure 0 agree and 5 differ" in text
    data = json.loads(js.read_text())
    assert data["schema"] == "maglev-reproduce/2" and data["seed"] == 3
    assert [item["name"] for item in data["items"]] == ["pedestal", "sphs"]  # the order of the chapters
    first = data["items"][0]["rows"][0]
    assert first["published"] == 134.5 and first["agrees"] is True and first["unit"] == "kN/m"
    assert first["kind"] == "consequence" and first["tolerance"] == "± 1 %"
    assert first["difference"] == pytest.approx(first["found"] / 134.5 - 1)
    page, markdown = (out / "reproduce.html").read_text(), docs.read_text()
    for item in data["items"]:
        assert item["title"] in page and f"## {item['title']}" in markdown
        for row in item["rows"]:
            assert row["name"] in markdown and row["reason"].replace("|", "\\|") in markdown
    assert page.count("plotly-graph-div") == 2
    widths = {line.count("|") for line in markdown.splitlines() if line.startswith("|")}
    assert widths == {9, 11}  # the overview and the figures


def test_equal_runs_give_equal_files(tmp_path):
    for name in ("a", "b"):
        run("pedestal", "--out", tmp_path / name, "--docs", tmp_path / f"{name}.md", "--json", tmp_path / f"{name}.js")
    for ending in ("/reproduce.html", ".md", ".js"):
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


def test_an_unknown_name_is_told_the_known_ones():
    text = run("sphs", "pedestral", code=2)
    assert "'pedestral' is unknown" in text and all(name in text for name in HOME)


def test_a_stopped_run_leaves_nothing(tmp_path, monkeypatch):
    def stopped(seed):
        raise KeyboardInterrupt

    items = [Item("fine", "Fine", "1", lambda seed: Outcome(())), Item("stopped", "Stopped", "2", stopped)]
    monkeypatch.setattr(registry, "chosen", lambda names: items)
    run("--out", tmp_path / "o", "--docs", tmp_path / "r.md", "--json", tmp_path / "r.json", code=130)
    assert not list(tmp_path.iterdir())


def test_every_name_leads_to_its_item():
    items = chosen()
    assert [item.name for item in items] == list(HOME)
    assert chosen(["sphs", "sphs", "axial"]) == [item for item in items if item.name in ("axial", "sphs")]


def test_the_registry_loads_no_item():
    code = (
        "import sys, maglev_workbench.cli, maglev_workbench.commands.reproduce.registry\n"
        "print(sorted(m.rpartition('.')[2] for m in sys.modules if '.chapters.' in m or m.startswith('numpy')))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.strip() == "[]"


def test_a_verdict_says_what_it_is_worth():
    with pytest.raises(ValueError, match="verdict and its kind"):
        Row("a", 2.0, 2.1, "N", 0.1)
    with pytest.raises(ValueError, match="verdict and its kind"):
        Row("a", 2.0, 2.1, "N", kind="prediction")


def test_the_headline_counts_predictions_and_each_figure_once():
    rows = (
        Row("a", 2.0, 2.1, "", 0.1, kind="prediction"),
        Row("b", 2.0, 9.0, "", 0.1, kind="prediction"),
        Row("the figure of a by another way", 2.0, 2.0, "", 0.1, kind="prediction", again="x"),
        Row("c", 1.0, 1.0, "", 0.1, kind="fit"),
        Row("d", 1.0, 3.0, "", 0.1, kind="consequence"),
        Row("e", None, 3.0),
    )
    text = summary([(Item("x", "X", "Y", lambda seed: Outcome(rows)), Outcome(rows))])
    assert "Of 2 predictions of a published figure 1 agree and 1 differ" in text
    assert "1 consequences of the text's own figures (0 agree, 1 differ) and 1 fits (1 agree, 0 differ)" in text
    assert "1 further rows are other ways to figures that are counted already." in text


def test_a_part_run_says_what_other_experiments_count():
    rows = (Row("a", 2.0, 2.1, "", 0.1, kind="fit"), Row("b", 3.0, 3.0, "", 0.1, kind="fit", again="y"))
    rows += (Row("c", 2.0, 2.0, "", 0.1, kind="fit", again="x"),)
    one, other = (Item(name, name, "", lambda seed: Outcome(())) for name in "xy")
    text = summary([(one, Outcome(rows))])
    assert text.endswith(
        "1 further rows are other ways to figures that are counted already, and 1 to figures that other experiments "
        "count, which were not run."
    )
    assert "2 further rows are other ways" in summary([(one, Outcome(rows)), (other, Outcome(()))])


def test_a_published_figure_counts_once_and_where_its_other_rows_say():
    """By docs/reproduce.md. A number without a unit is no figure of its own: ratios to 1, of many things."""
    item, rows = "", []
    for line in DOCS.read_text().splitlines():
        item = line.split("`")[1] if line.startswith("`") else item
        cell = [part.strip() for part in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cell) == 8 and cell[5] in ("agrees", "differs"):
            _, _, again = cell[6].partition(", again: ")
            rows.append((item, cell[0], cell[1].replace("N/V", "N/A"), again))  # of the same amplifier, 1 A/V
    counted = [(item, figure) for item, _, figure, again in rows if not again]
    figures = [figure for _, figure in counted if figure[:1] in "-0123456789" and " " in figure]
    assert len(figures) > 50 and len(set(figures)) == len(figures)
    lost = {name for _, name, figure, again in rows if again and (again, figure) not in counted}
    assert lost == OTHER_UNITS


def test_the_published_results_are_those_of_this_tree():
    """docs/reproduce.md has every experiment in order, and the sections of the quick ones byte for byte."""
    text = DOCS.read_text()
    assert [line.split("`")[1] for line in text.splitlines() if line.startswith("`")] == list(HOME)
    for item in chosen(QUICK):
        _, _, section = reproduce_markdown([(item, item.run(0))], 0).partition(f"## {item.title}")
        assert section.strip() in text, item.name


def test_the_contents_name_every_table_and_figure():
    """The dissertation's last number in each chapter; without a gap, each with an experiment or a reason."""
    last = {"Figure": {"1": 1, "2": 4, "3": 44, "4": 12, "5": 28, "6": 32, "B": 3, "E": 2}}
    last["Table"] = {"3": 5, "4": 1, "5": 4, "6": 1}
    wanted = {f"{kind} {c}.{i}" for kind, ends in last.items() for c, end in ends.items() for i in range(1, end + 1)}
    labels = [entry.label for entry in CONTENTS]
    assert len(set(labels)) == len(labels) and set(labels) == {*wanted, "Table of section 3.5"}
    for entry in CONTENTS:
        assert (entry.item in HOME) == (entry.state != "not reproducible"), entry
        assert entry.why or entry.state == "reproduced", entry
        assert f"| {entry.label} | {entry.shows} | {entry.state} |" in DOCS.read_text()


def test_rows_as_text():
    agrees = Row("a", 2.0, 2.1, "N", 0.1, kind="prediction")
    assert cells(agrees) == ("a", "2 N", "2.100 N", "+5 %", "± 10 %", "agrees", "prediction")
    differs = Row("a", 2.0, 3.0, "N", 0.1, kind="fit", again="b")
    assert cells(differs)[-2:] == ("differs", "fit, again: b")
    assert cells(Row("a", 2.0, 3.0))[-3:] == ("", "not compared", "")
    assert cells(Row("a", "rises", -0.5)) == ("a", "rises", "-0.5000", "–", "", "", "")
    words = Row("a", "rises", -0.5, means=(0, inf), kind="prediction")
    assert cells(words)[-3:] == ("above 0", "differs", "prediction")
    assert Row("a", "5 to 6", 5.5, means=(5, 6), kind="fit").tolerance == "5 to 6"
    assert cells(Row("a", None, nan, "N"))[1:4] == ("–", "– N", "–")
    odd = Item("x", "X", "Y", lambda seed: Outcome(()))
    text = reproduce_markdown([(odd, Outcome((Row("a|b", None, 1.0, reason="one\ntwo"),)))], 0)
    assert "| a\\|b | – | 1.000 | – |  |  |  | one two |" in text
