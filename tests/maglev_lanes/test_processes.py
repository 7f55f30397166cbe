"""Processes that work for this one end with it, also where it cannot end them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from maglev_lanes.processes import beside_others

PARENT = """
import os, signal, sys, time
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it is ignored, and that is inherited
from maglev_lanes.processes import fresh_pool
if __name__ == "__main__":
    with fresh_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 100 if sys.argv[1] == "busy" else 0)
        time.sleep(100)
"""


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has asked about does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes there are")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL, signal.SIGHUP])
@pytest.mark.parametrize("at", ["busy", "idle"])
def test_a_process_ends_with_its_parent_however_that_ends(tmp_path, how, at):
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen([sys.executable, str(tmp_path / "parent.py"), at], stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    assert alive(worker)
    parent.send_signal(how)
    parent.wait(10)
    end = time.monotonic() + 10
    while alive(worker) and time.monotonic() < end:
        time.sleep(0.05)
    left = alive(worker)
    if left:
        os.kill(worker, signal.SIGKILL)
    assert not left


def slowly(number: int) -> tuple[int, int]:
    if number < 0:
        raise ValueError("no such number")
    time.sleep(0.1)
    return number, os.getpid()


def test_this_process_works_while_others_start_and_then_beside_them():
    numbers = list(range(40))
    found = dict(beside_others(slowly, numbers, 2, os.getpid))
    assert [found[i][0] for i in numbers] == numbers
    by = [found[i][1] for i in numbers]
    assert by[0] == os.getpid() and len(set(by)) == 2


def test_what_fails_is_told_and_the_rest_is_dropped():
    started = time.monotonic()
    with pytest.raises(ValueError, match="no such number"):
        list(beside_others(slowly, [1, -1, *range(200)], 2, os.getpid))
    assert time.monotonic() - started < 15
