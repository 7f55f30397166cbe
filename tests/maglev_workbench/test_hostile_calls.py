"""Twenty hostile calls of all commands end in answers or sentences; nightly, tests/tools/fuzz.py makes 20,000."""

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_hostile_calls_end_in_an_answer_or_in_a_sentence():
    tool = Path(__file__).parents[1] / "tools" / "fuzz.py"
    made = subprocess.run([sys.executable, tool, "20", "--limit", "20"], capture_output=True, text=True, timeout=900)
    assert made.returncode == 0 and "0 wrong" in made.stdout, made.stdout + made.stderr
