"""Version and hash of the code that made a result, so that stored results of different code are not mixed."""

from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

DIAGNOSING = ("estimation", "maglev_lanes", "selfsense", "maglev_env", "sim2real")
ALL = (*DIAGNOSING, "tuning", "maglev_workbench")


@cache
def code_version(packages: Sequence[str] = ALL, blind: bool = False) -> str:
    """Version and the first digits of a hash over all code and data in the packages.

    Args:
        packages: The packages.
        blind: Whether `sim2real.blind` counts, which makes sealed sets and judges answers to them. It does not change
            what a diagnosis or a tuner finds, but what is found on its twins.
    """
    found = sha256()
    for package in packages:
        root = Path(find_spec(package).submodule_search_locations[0])
        for path in sorted(p for p in root.rglob("*") if p.is_file() and "__pycache__" not in p.parts):
            if blind or package != "sim2real" or "blind" not in path.relative_to(root).parts:
                found.update(f"{package}/{path.relative_to(root).as_posix()}\0".encode() + path.read_bytes())
    return f"{version('maglev-workbench')}+{found.hexdigest()[:12]}"
