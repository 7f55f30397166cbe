"""Make the campaigns of a sealed set on processes, and seal their labels."""

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any


def sealed(produce: Callable[[Any], Any], cases: Sequence[Any], processes: int, labels: Path) -> str:
    """SHA-256 of the file of labels, which holds as JSON what `produce` returns of each case, in their order."""
    if processes == 1:
        found = [produce(case) for case in cases]
    else:
        # An executor reports the death of one of its processes; a pool would wait for ever.
        with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
            found = list(pool.map(produce, cases))
    text = json.dumps(found, indent=1) + "\n"
    labels.write_text(text, encoding="utf-8")
    return hashlib.sha256(text.encode()).hexdigest()
