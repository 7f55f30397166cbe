"""What commands print: nothing where it is unwanted, no colour where it is unwanted, and every bracket."""

import json
import os
import subprocess
import sys
from io import StringIO

import pytest
from command_line import CAMPAIGN, maglev
from rich.control import Control
from rich.table import Table
from rich.text import Text
from typer.testing import CliRunner

from maglev_env.loop.effect import EFFECTS
from maglev_workbench import console as of_commands
from maglev_workbench.cli import app


def run(*words, **environment):
    return subprocess.run(
        [sys.executable, "-m", "maglev_workbench", *words], capture_output=True, text=True, env=os.environ | environment
    )


def test_quiet_prints_nothing_but_errors(tmp_path):
    assert maglev("effects", "--quiet", "--json", tmp_path / "e.json") == "" and (tmp_path / "e.json").exists()
    assert maglev("estimate", "nowhere", "-q", code=2).startswith("maglev: nowhere does not exist")
    assert "sensor_lag" in maglev("effects")  # the next command of the same process prints again


def test_quiet_goes_with_options_that_exclude_others(tmp_path):
    """Those of a campaign exclude all that have no meaning for a real rig."""
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    assert "--quiet" not in maglev("tune", "--campaign", tmp_path, "-q", code=2)


def test_verbose_says_how_long_it_took_and_where_an_error_was_raised():
    assert " s, version " in maglev("effects", "-v")
    said = CliRunner().invoke(app, ["estimate", "nowhere", "-v"])
    assert said.exit_code == 2 and "Traceback" in said.output and "maglev: nowhere" in said.output


@pytest.mark.parametrize("wanted", [True, False])
def test_no_color_is_respected_by_messages(wanted, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "" if wanted else "1")
    said = CliRunner().invoke(app, ["estimate", "nowhere"], color=True).output
    assert ("\x1b[" in said) == wanted and "nowhere does not exist" in said


def test_no_color_is_respected_by_tables():
    assert "\x1b[3" not in run("effects", NO_COLOR="1", FORCE_COLOR="1").stdout


def test_brackets_and_colons_are_printed_as_they_are(capsys):
    text = "pip install 'maglev-workbench[bench]', --lines 1:100:2 [/] [red]"
    of_commands.console.print(text, soft_wrap=True)
    of_commands.console.print(of_commands.marked("  !", text), soft_wrap=True)
    assert capsys.readouterr().out == f"{text}\n  ! {text}\n"


def test_a_terminal_obeys_nothing_that_stands_in_a_file(tmp_path, capsys):
    evil = "run\x1b]0;OWNED\x07\x1b[2J\x9b2J\r.npz"
    table = Table(evil)
    table.add_row(evil)
    for part in (evil, of_commands.marked("  !", evil), table):
        of_commands.console.print(part)
    shown = capsys.readouterr().out
    toml = CAMPAIGN.replace('"a.csv"', json.dumps(evil))
    (tmp_path / "campaign.toml").write_text(toml)
    said = CliRunner().invoke(app, ["check", str(tmp_path), "-v"])
    assert said.exit_code == 2
    for text in (shown, said.output):
        assert "OWNED" in text and not set("\x1b\x07\x9b\r") & set(text)


def test_what_rich_draws_itself_still_reaches_a_terminal():
    drawn = StringIO()
    own = type(of_commands.console)(file=drawn, force_terminal=True, color_system="standard", markup=False)
    own.print(Text("red\ttab\nline", "red"))
    own.control(Control.clear())
    assert drawn.getvalue().startswith("\x1b[31mred") and drawn.getvalue().endswith("\x1b[2J")


def test_effects_fit_80_columns_and_are_data_too(tmp_path):
    printed = run("effects", COLUMNS="80").stdout
    assert max(map(len, printed.splitlines())) <= 80 and "…" not in printed
    words = " ".join(printed.split())
    assert all(name in words and " ".join(card.source.split())[:40] in words for name, card in EFFECTS.items())
    maglev("effects", "--json", tmp_path / "e.json")
    data = json.loads((tmp_path / "e.json").read_text())
    assert data["schema"] == "maglev-effects/1" and data["effects"].keys() == EFFECTS.keys()
    delay = data["effects"]["delay"]
    assert delay["block"] == "controller" and delay["parameters"]["time"]["unit"] == "s"


def test_shells_complete_commands_and_presets():
    environment = {"_MAGLEV_COMPLETE": "complete_bash"}
    typed = run(**environment, COMP_WORDS="maglev sweep --rig hmb", COMP_CWORD="3").stdout.split()
    assert typed == ["hmb_axial", "hmb_free", "hmb_radial"]
    assert "export" in run(**environment, COMP_WORDS="maglev ex", COMP_CWORD="1").stdout.split()


@pytest.mark.parametrize("name", ["", "selfsense", "blind"])
def test_help_has_whole_sentences(name):
    text = CliRunner().invoke(app, [*name.split(), "--help"]).output
    assert "..." not in text.partition("Commands:")[2] and "Commands:" in text


def test_a_name_that_does_not_exist_is_told_before_numpy_is_loaded():
    program = """
import sys
from typer.testing import CliRunner
from maglev_workbench.cli import app
for call in ("estimate nowhere", "sweep --rig nowhere", "runup --rotor nowhere.toml", "diagnose nowhere",
             "tune --method nothing", "sweep --kp 1:2", "compare nothing"):
    code = CliRunner().invoke(app, call.split()).exit_code
    assert code == 2 and "numpy" not in sys.modules, (call, code)
"""
    made = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
