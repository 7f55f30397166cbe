"""The `maglev` command as a user types it, and what every run of it must keep to."""

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from maglev_workbench.cli import app

# A campaign.toml that every command accepts as far as its rules go, for the file a.csv with a column y.
CAMPAIGN = """
schema = "maglev-campaign/1"
rig = "hmb_free"
[[recording]]
file = "a.csv"
sample_rate = 20000.0
excitation = { kind = "none" }
[recording.channels]
displacement = { from = "y" }
"""


def maglev(*arguments: object, code: int = 0) -> str:
    """Run a command in this process.

    Args:
        arguments: what stands behind `maglev`.
        code: the exit code that it must end with.

    Returns:
        All that it printed, with every run of white space as one space.

    What --json wrote is checked to be strict JSON that states its schema and what made it.
    """
    words = [str(a) for a in arguments]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == code, result.output + repr(result.exception)
    assert "Traceback" not in result.output
    if code == 0 and "--json" in words:
        check_json(Path(words[words.index("--json") + 1]))
    return " ".join(result.output.split())


def check_json(path: Path) -> Any:
    """The content of a JSON file, after a check that it has no NaN, a schema, and a version of what made it."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{path} holds {constant}, which is no JSON")

    data = json.loads(path.read_text(), parse_constant=refuse)
    assert data["schema"].startswith("maglev-") and data["schema"].rpartition("/")[2].isdigit()
    made_by = data.get("made_by", {})
    assert data.get("version") or data.get("versions") or made_by.get("version"), f"{path} does not say what made it"
    return data
