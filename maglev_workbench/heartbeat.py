"""A line every half minute from a command whose progress no terminal shows, so that none seems to hang."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic

from maglev_workbench.printable import printable

EVERY = 30.0  # s
stages: list[Callable[[], str]] = []  # what is being done, and how far; that of the latest progress bar is said


@contextmanager
def heartbeat(command: str) -> Iterator[None]:
    """While the context lasts, say on standard error every EVERY seconds that the command is still at work."""
    done, started = Event(), monotonic()

    def beat() -> None:
        while not done.wait(EVERY):
            if not (stages and sys.stderr.isatty()):  # there the progress bar is seen
                stage = stages[-1]() if stages else ""  # none while a bar has nothing under way
                doing = f": {stage}" if stage else ""
                said = printable(f"maglev {command}{doing}, {monotonic() - started:.0f} s")
                print(said, file=sys.stderr, flush=True)

    thread = Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
