"""A command that fails on its input says so before the imports that take longer than half a second."""

import subprocess
import sys

WRONG = (
    ("sweep --goal nonsense", "neither a goal"),
    ("sweep --controller nonsense", "begin with"),
    ("sweep --scheduler x", "give tcp://"),
    ("tune --goal nonsense", "neither a goal"),
    ("tune --goal x<=", "is not understood"),
    ("tune --controller nonsense", "begin with"),
    ("tune --scheduler local:9999", "up to 256"),
    ("tune --tune x=2", "is not name or name=lo:hi"),
    ("tune --tune nonsense=1:2", "no gain 'nonsense'"),
    ("tune --protocol x", "full, quick"),
    ("tune --rig pump --goal nonsense", "neither a goal"),
    ("tune --rig pump --speeds x", "write lo:hi:step"),
    ("compare --scheduler x", "give tcp://"),
    ("train --scheduler x", "give tcp://"),
    ("explore --goal nonsense", "neither a goal"),
    ("explore --sweep nothing", "make it with maglev sweep"),
    ("explore --sweep .", "make it with maglev sweep"),
    ("explore --sweep wrong.nc", "is not the sweep.nc"),
)
LONG = ("numba", "scipy.stats", "scipy.signal", "xarray", "pandas", "plotly", "dask", "matplotlib")
RUN = f"""
import sys
from maglev_workbench.cli import app
for command in sys.argv[1:]:
    try:
        app(command.split())
    except SystemExit as end:
        found = [name for name in {LONG} if name in sys.modules]
        print(f"{{end.code}} {{command}}: {{found}}", file=sys.stderr)
"""


def test_what_is_wrong_is_told_before_the_imports_that_take_long(tmp_path):
    (tmp_path / "wrong.nc").write_text("junk")
    commands = [command for command, _ in WRONG]
    done = subprocess.run([sys.executable, "-c", RUN, *commands], cwd=tmp_path, capture_output=True, text=True)
    lines = done.stderr.splitlines()
    assert len(lines) == 2 * len(WRONG)
    for (command, words), said, told in zip(WRONG, lines[::2], lines[1::2], strict=True):
        assert words in said, command
        assert told == f"2 {command}: []"
