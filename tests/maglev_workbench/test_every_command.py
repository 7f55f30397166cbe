"""What every command must do, walked over the table of commands: help, bad input, and files that cannot be written.

Bad input ends with exit code 2 and one message that names what is wrong and where, before any work and without a file
written. A new command is in here as soon as it is in the table.
"""

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import typer
from command_line import CAMPAIGN, maglev
from typer.testing import CliRunner

from maglev_workbench import console
from maglev_workbench.cli import app

# Arguments that a command needs before anything else of it can be wrong.
NEEDED = {
    "estimate": ["good"],
    "check": ["good"],
    "new": ["good"],
    "diagnose": ["good"],
    "selfsense estimate": ["good"],
    "export": ["hmb_free"],
    "blind generate": ["--seed", "1", "--out", "set"],
    "blind run": ["--seed", "1", "--out", "set"],
    "blind answer": ["good"],
    "blind open": ["good"],
    "blind score": ["good"],
    "blind next": ["good"],
    "blind learn": ["lessons", "--seed", "1", "--out", "judge.json"],
}
BESIDE = {  # arguments without which a bad one means nothing
    ("train", "init"): ["--by", "ppo"],
    ("compare", "policy"): ["learned"],
    ("tune", "policy"): ["--method", "learned"],
    ("simulate", "kind"): ["--excite", "force=1:9@1"],
}
WRITTEN = ("json_file", "docs", "picture")  # files, beside `out`
READ = ("source", "campaign", "folder", "twin", "compare", "init", "policy")  # files and folders that must be there
RIGS = ("rig", "rotor")
CHOICES = ("protocol", "method", "methods", "sensor", "data_format", "by", "effect", "scheduler", "item", "tuned")
CHOICES += ("kind", "magnet")


def walk(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Every command below this one with what is typed for it."""
    if hasattr(command, "commands"):
        for name, part in command.commands.items():
            yield from walk(part, (*path, name))
    else:
        yield " ".join(path), command


COMMANDS = dict(walk(typer.main.get_command(app)))


def numeric(command: Any) -> list[str]:
    """Names of the parameters that are numbers."""
    hints = get_type_hints(inspect.unwrap(command.callback))
    return [name for name, hint in hints.items() if {int, float} & {hint, *get_args(hint)}]


def bad_inputs() -> Iterator[Any]:
    """Parameters of the test below: command, the bad arguments, and the words that the message must have."""
    for name, command in COMMANDS.items():
        numbers = numeric(command)
        for p in command.params:
            option = [p.opts[0]] if p.param_type_name == "option" else []
            found: list[tuple[str, tuple[str, ...]]] = []
            if p.name in numbers:
                found = [("ten", ("Invalid value", p.opts[0]))]
            elif p.name in WRITTEN or (p.name == "out" and not folder(p)):
                found = [("no/file.png", (p.opts[0], "no/file.png", "does not exist"))]
                found += [("good", (p.opts[0], "is a folder"))]
                found += [("file.txt/x.png", (p.opts[0], "file.txt"))]
            elif p.name == "out":
                found = [("file.txt", ("--out", "is a file")), ("file.txt/x", ("--out", "is a file"))]
            elif p.name in RIGS:
                found = [(bad, (bad,)) for bad in ("nowhere", "missing.toml", "broken.toml", "good", "binary.toml")]
            elif p.name in READ:
                found = [(bad, (bad,)) for bad in ("nowhere", "broken", "binary.toml")]
            elif p.name in CHOICES:
                found = [("gremlins=1", ("gremlins",))]
            for bad, words in found:
                needed = NEEDED.get(name, []) if option or p.name not in READ else []
                arguments = [*needed, *BESIDE.get((name, p.name), []), *option, bad]
                yield pytest.param(name, arguments, words, id=f"{name} {p.opts[0]} {bad}")


def folder(out: Any) -> bool:
    return out.help.startswith("Folder")


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A working directory with a campaign, a file, and files and folders that are broken; no command may begin work."""
    for name in ("good", "broken"):
        (tmp_path / name).mkdir()
    (tmp_path / "good" / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "good" / "a.csv").write_text("y\n0\n")
    for path in ("broken/campaign.toml", "broken.toml"):
        (tmp_path / path).write_text('name = "half\n[')
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    (tmp_path / "file.txt").write_text("")
    monkeypatch.chdir(tmp_path)
    # What every work begins with; commands look it up when they call, however early they were loaded.
    monkeypatch.setattr(console, "Progress", lambda *columns, **options: pytest.fail("work has begun"))
    return tmp_path


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example_of_the_command_itself(name):
    text = maglev(*name.split(), "--help")
    assert "Example" in text and f"maglev {name}" in text.partition("Example")[2]
    assert all(p.help for p in COMMANDS[name].params)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_can_be_quiet_and_verbose(name):
    assert {"quiet", "verbose"} <= {p.name for p in COMMANDS[name].params}


@pytest.mark.parametrize(("name", "arguments", "words"), list(bad_inputs()))
def test_bad_input_ends_with_one_message_and_code_2(here, name, arguments, words):
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, [*name.split(), *arguments])
    text = " ".join(result.output.split())
    assert result.exit_code == 2, text + repr(result.exception)
    assert "Traceback" not in text and all(word in text for word in words), text
    assert text.startswith("Usage:") or (text.startswith("maglev: ") and text.count("maglev: ") == 1), text
    assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before


@pytest.mark.parametrize("arguments", [["simulate", "--out", "good"], ["selfsense", "record", "--out", "good"]])
def test_a_campaign_is_not_written_over_another(here, arguments):
    text = maglev(*arguments, code=2)
    assert "campaign.toml exists; choose another --out" in text


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (["simulate", "--kp", "8000"], "run1.npz"),
        (["simulate"], "recordings.html"),
        (["selfsense", "record", "--format", "csv"], "coil.csv"),
    ],
)
def test_no_recording_is_written_over_a_file_of_its_name(here, arguments, file):
    Path("measured").mkdir()
    Path("measured", file).write_text("mine")
    assert f"{file} exists" in maglev(*arguments, "--out", "measured", code=2)
    assert Path("measured", file).read_text() == "mine" and len(list(Path("measured").iterdir())) == 1


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (["sweep"], "sweep.json"),
        (["sweep"], "sweep.nc"),
        (["tune"], "study.json"),
        (["tune", "--rig", "pump"], "journal.jsonl"),
        (["compare", "rule"], "comparison.json"),
        (["train"], "training.json"),
    ],
)
def test_json_is_not_written_over_what_results_go_on_from(here, arguments, file):
    Path("kept").mkdir()
    Path("kept", file).write_text("{}")
    text = maglev(*arguments, "--out", "kept", "--json", f"kept/../kept/{file}", code=2)
    assert f"{file} is a file of the results in kept" in text and Path("kept", file).read_text() == "{}"


@pytest.mark.parametrize("command", ["generate", "run"])
def test_a_sealed_set_wants_an_empty_folder(here, command):
    text = maglev("blind", command, "--seed", 1, "--out", "good", code=2)
    assert "not empty" in text


@pytest.mark.parametrize("name", [n for n in COMMANDS if n.startswith("selfsense") and n != "selfsense estimate"])
@pytest.mark.parametrize("rig", ["pedestal", "hmb_axial"])
def test_a_rig_whose_coils_cannot_sense_is_refused(here, name, rig):
    assert "no coil whose inductance follows the gap" in maglev(*name.split(), "--rig", rig, code=2)
