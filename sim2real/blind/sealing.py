"""Make the campaigns of a sealed set on processes, and seal their labels."""

import hashlib
import json
import multiprocessing
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

MADE_OF = "made_of.json"  # in the folder of what is finished: the cases, and what else they are made of


def unfinished(labels: Path) -> Path:
    """The folder that holds the labels of finished cases until all of a set are there."""
    return labels.with_name(f"{labels.name}.unfinished")


def sealed(
    produce: Callable[..., Any],
    cases: Sequence[Any],
    processes: int,
    labels: Path,
    advance: Callable[[], object] = lambda: None,
    **values: Any,
) -> str:
    """Write as JSON what `produce` returns of each case, in their order; what was interrupted goes on where it was.

    Args:
        produce: Makes the campaign of one case and returns its label; called again, it begins that campaign anew.
        cases: The cases.
        processes: Number of processes; results do not change.
        labels: File of the labels.
        advance: Called after each case.
        **values: Further arguments of produce, the same for all cases.

    Returns:
        SHA-256 of the file of labels.

    Raises:
        ValueError: A set of other cases was begun here.
    """
    done = unfinished(labels)
    asked = {name: value for name, value in values.items() if not isinstance(value, Path)}  # a set may be moved
    made_of = json.dumps([produce.__module__, repr(asked), repr(cases)])
    done.mkdir(parents=True, exist_ok=True)
    if not (done / MADE_OF).exists():
        _write(done / MADE_OF, made_of)
    elif (done / MADE_OF).read_text(encoding="utf-8") != made_of:
        raise ValueError(
            f"{labels.parent}: a set of another seed or count was begun here; delete the folder or name a new one"
        )
    found = []
    for label in _each(partial(_kept, partial(produce, **values), done), list(enumerate(cases)), processes):
        found.append(label)
        advance()
    text = json.dumps(found, indent=1) + "\n"
    _write(labels, text)
    shutil.rmtree(done)
    return hashlib.sha256(text.encode()).hexdigest()


def _each(make: Callable[[Any], Any], cases: Sequence[Any], processes: int) -> Iterator[Any]:
    if processes == 1:
        yield from map(make, cases)
        return
    # An executor reports the death of one of its processes; a pool would wait for ever.
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            yield from pool.map(make, cases)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # an interrupted set does not make the rest first
            raise


def _kept(produce: Callable[[Any], Any], done: Path, numbered: tuple[int, Any]) -> Any:
    number, case = numbered
    path = done / f"{number:06d}.json"
    if not path.exists():
        _write(path, json.dumps(produce(case)))
    return json.loads(path.read_text(encoding="utf-8"))


def _write(path: Path, text: str) -> None:
    """Write a whole file or none; here because the benchmark imports nothing of what it checks."""
    begun = path.with_name(f"{path.name}.begun")
    begun.write_text(text, encoding="utf-8")
    begun.replace(path)
