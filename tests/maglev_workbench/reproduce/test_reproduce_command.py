"""`maglev reproduce` as a user runs it: names, page, markdown and JSON, and what is left when it is stopped."""

import json
import subprocess
import sys
from functools import partial
from math import nan

import pytest
from command_line import maglev

from maglev_workbench.commands.reproduce import registry
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.commands.reproduce.registry import HOME, chosen
from maglev_workbench.commands.reproduce.report import cells, reproduce_markdown

run = partial(maglev, "reproduce")


def test_items_are_run_and_written(tmp_path):
    out, docs, js = tmp_path / "out", tmp_path / "r.md", tmp_path / "r.json"
    text = run("sphs", "pedestal", "--out", out, "--docs", docs, "--json", js, "--seed", 3)
    assert "2 experiments" in text and "agrees" in text and "4 differ" in text
    data = json.loads(js.read_text())
    assert data["schema"] == "maglev-reproduce/1" and data["seed"] == 3
    assert [item["name"] for item in data["items"]] == ["pedestal", "sphs"]  # the order of the chapters
    first = data["items"][0]["rows"][0]
    assert first["published"] == 134.5 and first["agrees"] is True and first["unit"] == "kN/m"
    assert first["difference"] == pytest.approx(first["found"] / 134.5 - 1)
    page, markdown = (out / "reproduce.html").read_text(), docs.read_text()
    for item in data["items"]:
        assert item["title"] in page and f"## {item['title']}" in markdown
        for row in item["rows"]:
            assert row["name"] in markdown and row["reason"].replace("|", "\\|") in markdown
    assert page.count("plotly-graph-div") == 2
    widths = {line.count("|") for line in markdown.splitlines() if line.startswith("|")}
    assert widths == {6, 7}  # the overview and the figures


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


def test_rows_as_text():
    assert cells(Row("a", 2.0, 2.1, "N", 0.1)) == ("a", "2 N", "2.100 N", "+5 %", "agrees")
    assert cells(Row("a", 2.0, 3.0, "N", 0.1))[-1] == "differs"
    assert cells(Row("a", "rises", -0.5)) == ("a", "rises", "-0.5000", "–", "")
    assert cells(Row("a", None, nan, "N"))[1:4] == ("–", "– N", "–")
    odd = Item("x", "X", "Y", lambda seed: Outcome(()))
    text = reproduce_markdown([(odd, Outcome((Row("a|b", None, 1.0, reason="one\ntwo"),)))], 0)
    assert "| a\\|b | – | 1.000 | – |  | one two |" in text
