"""A command that takes long says so where no terminal shows its progress bar."""

import time

from maglev_workbench import heartbeat
from maglev_workbench.console import progress_bar


def test_a_long_command_says_what_it_does_and_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(heartbeat, "EVERY", 0.05)
    with heartbeat.heartbeat("sweep"):
        time.sleep(0.12)
        with progress_bar() as bar:
            bar.advance(bar.add_task("sweep hmb_free", total=8), 3)
            time.sleep(0.12)
        with progress_bar():
            time.sleep(0.12)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "maglev sweep, 0 s" and "maglev sweep: sweep hmb_free 3/8, 0 s" in said
    assert not any(line.startswith("maglev sweep: ,") for line in said)
    time.sleep(0.12)
    assert not capsys.readouterr().err and not heartbeat.stages
