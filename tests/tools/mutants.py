"""Does the test-suite still have its teeth? Break the product one small way at a time and count the tests that see it.

    python tests/tools/mutants.py TREE --out result.json [--only NAME ...] [--list] [--docs docs/mutants.md]

TREE is copied to a temporary folder once and never touched itself. Mutants are those that a person thought of
(`mutants_list.py`) and sampled ones (`mutants_sampled.py`). A mutant is found by the exact text that it replaces,
wherever that stands, so it outlives files that move; where code was rewritten it gets another text. Its tests run on
the copy, then the copy is restored. The result is written after every mutant; one that is there for the same mutant,
the same product code and the same tests is not made again. Exit status 0: all were killed.
"""

import argparse
import ast
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from mutants_list import MUTANTS, RENAMED_TESTS, Mutant
from mutants_sampled import sampled
from mutants_table import survival_table

TIMEOUT = 600.0  # s: tests that hang have seen the mutant
COMPILES, SLOWER = 120.0, 3.0  # a mutant's tests hang after so many s, and so many times what the sound code takes
COMPILED = ("*.nbi", "*.nbc")  # numba's disk cache, in the __pycache__ beside the source


@dataclass(frozen=True)
class Outcome:
    """What a run of tests gave: state "ran", "hung", "crashed" or "no tests"; how many tests, and which failed."""

    state: str
    tests: int
    failed: tuple[str, ...]
    seconds: float


@dataclass(frozen=True)
class Place:
    """Where a mutant applies: which of its snippets, and the files with the text in them."""

    snippet: int
    files: tuple[Path, ...]


def product_files(tree: Path) -> list[Path]:
    """All .py files that are no tests, nothing hidden, no copies of an installation, and not this machinery."""
    inside = [p.relative_to(tree) for p in tree.rglob("*.py")]
    elsewhere = {"tests", "build"}
    kept = [p for p in inside if not elsewhere & set(p.parts) and not any(part.startswith(".") for part in p.parts)]
    return [tree / p for p in sorted(kept)]


def locate(mutant: Mutant, files: Iterable[Path]) -> Place | str:
    """The first snippet that is there exactly as often as stated, or what is wrong, in words."""
    texts = {path: path.read_text() for path in files if str(path).endswith(mutant.file)}
    seen = []
    for i, (old, _) in enumerate(mutant.snippets):
        hits = {path: n for path, text in texts.items() if (n := text.count(old))}
        if sum(hits.values()) == mutant.count:
            return Place(i, tuple(hits))
        seen.append(sum(hits.values()))
    if not any(seen):
        return "not found: no snippet matches; add the (old, new) text of the rewritten code"
    return f"found {', '.join(map(str, seen))} times instead of {mutant.count}: make the snippet longer"


def copy_tree(tree: Path, to: Path) -> None:
    """What git tracks or would, with the times of the files, and numba's cache, which these times keep valid."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=tree, check=True, capture_output=True, text=True
    ).stdout.split("\0")
    for name in filter(None, listed):
        source = tree / name
        if source.is_file():
            (to / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, to / name)
    copy_compiled(tree, to)


def compiled_files(tree: Path) -> list[Path]:
    return [p for pattern in COMPILED for p in tree.rglob(f"__pycache__/{pattern}")]


def copy_compiled(tree: Path, to: Path) -> None:
    for source in compiled_files(tree):
        target = to / source.relative_to(tree)
        if target.parent.parent.is_dir():
            target.parent.mkdir(exist_ok=True)
            shutil.copy2(source, target)


def importers(tree: Path, changed: Iterable[Path]) -> set[Path]:
    """The changed files and every product file that imports one of them, directly or through others."""
    files = product_files(tree)
    modules = {module_name(tree, path): path for path in files}
    users: dict[Path, set[Path]] = {}
    for path in files:
        for name in imported(path, module_name(tree, path)):
            if name in modules:
                users.setdefault(modules[name], set()).add(path)
    found, waiting = set(changed), list(changed)
    while waiting:
        for user in users.get(waiting.pop(), set()) - found:
            found.add(user)
            waiting.append(user)
    return found


def module_name(tree: Path, path: Path) -> str:
    parts = path.relative_to(tree).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path, own: str) -> set[str]:
    """Names of the modules that a file may import, anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                up = own.split(".")[: -node.level or None]
                base = ".".join([*up, *filter(None, [node.module])])
            found.add(base)
            found.update(f"{base}.{alias.name}" for alias in node.names)
    return found


def drop_compiled(files: Iterable[Path]) -> bool:
    """Remove what numba compiled of these files; whether there was any."""
    dropped = False
    for path in files:
        for pattern in COMPILED:
            for one in (path.parent / "__pycache__").glob(f"{path.stem}.{pattern}"):
                one.unlink()
                dropped = True
    return dropped


def test_files(copy: Path, mutant: Mutant) -> list[Path] | str:
    """The test files of a mutant, wherever they lie, or which is missing."""
    found: list[Path] = []
    for name in mutant.tests:
        for now in RENAMED_TESTS.get(name, (name,)):
            hits = sorted((copy / "tests").rglob(now))
            if len(hits) != 1:
                return f"no tests: {now} is there {len(hits)} times"
            found += hits
    return list(dict.fromkeys(found))


def selection(mutant: Mutant) -> list[str]:
    """Arguments by which pytest chooses among the tests of the files."""
    return [*([] if mutant.slow else ["-m", "not slow"]), *(["-k", mutant.select] if mutant.select else [])]


def run_tests(
    copy: Path, files: Sequence[Path], select: Sequence[str], scratch: Path, limit: float = TIMEOUT
) -> Outcome:
    """Run test files in a copy of the tree; `select` has further arguments of pytest."""
    report = scratch / "report.xml"
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no", f"--junitxml={report}"]
    command += [f"--basetemp={scratch / 'pytest'}", *select, *map(str, files)]
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "PYTEST_ADDOPTS")}
    env = kept | {"PYTHONPATH": str(copy), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    begun = time.monotonic()
    process = subprocess.Popen(
        command, cwd=copy, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        status = process.wait(limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return Outcome("hung", 0, (), limit)
    seconds = round(time.monotonic() - begun, 1)
    if status == 5:
        return Outcome("no tests", 0, (), seconds)
    if not report.exists():
        return Outcome("crashed", 0, (), seconds)
    cases = list(ElementTree.parse(report).iter("testcase"))
    bad = [c for c in cases if c.find("failure") is not None or c.find("error") is not None]
    return Outcome("ran", len(cases), tuple(f"{c.get('classname')}::{c.get('name')}" for c in bad), seconds)


class Bench:
    """A copy of a tree on which mutants are tried one after the other, and the results as they stand."""

    def __init__(self, tree: Path, folder: Path, out: Path, first: bool) -> None:
        self.copy, self.scratch, self.out = folder / "tree", folder / "scratch", out
        self.stop = ["-x"] if first else []
        self.copy.mkdir()
        self.scratch.mkdir()
        copy_tree(tree, self.copy)
        self.files = product_files(self.copy)
        self.code = digest(p.read_bytes() for p in self.files)
        self.results: dict[str, Any] = {"tree": str(tree), "pristine": {}, "mutants": {}}
        if out.exists():
            self.results |= json.loads(out.read_text()) | {"tree": str(tree)}

    def save(self) -> None:
        """Write all results at once, or nothing."""
        partial = self.out.with_name(self.out.name + ".part")
        partial.write_text(json.dumps(self.results, indent=1))
        partial.replace(self.out)

    def try_one(self, mutant: Mutant) -> dict[str, Any]:
        """Break, test, restore; what came of it, from the results where it is known already."""
        place, tests = locate(mutant, self.files), test_files(self.copy, mutant)
        if isinstance(place, str) or isinstance(tests, str):
            return self._keep(mutant, {"state": place if isinstance(place, str) else tests})
        version = digest([self.code.encode(), repr(mutant).encode(), *(p.read_bytes() for p in tests)])
        known = self.results["mutants"].get(mutant.name, {})
        if known.get("version") == version:
            return known
        whole = self._pristine(mutant, tests)
        old, new = mutant.snippets[place.snippet]
        before = {path: (path.read_text(), path.stat()) for path in place.files}
        saved = self.scratch / "compiled"
        affected = importers(self.copy, place.files)
        self._set_aside(saved)
        compiled = drop_compiled(affected)
        try:
            for path, (text, _) in before.items():
                broken = text.replace(old, new)
                compile(broken, str(path), "exec")  # a mutant that is no Python proves nothing
                path.write_text(broken)
            limit = min(COMPILES + SLOWER * whole["seconds"], TIMEOUT)
            outcome = run_tests(self.copy, tests, [*self.stop, *selection(mutant)], self.scratch, limit)
        finally:
            for path, (text, stat) in before.items():
                path.write_text(text)
                os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # numba and python go by the time
            drop_compiled(affected)
            copy_compiled(saved, self.copy)
        return self._keep(mutant, self._judged(whole, outcome, place) | {"recompiled": compiled, "version": version})

    def _set_aside(self, saved: Path) -> None:
        """Keep a copy of all that numba compiled of the sound code."""
        shutil.rmtree(saved, ignore_errors=True)
        for source in compiled_files(self.copy):
            target = saved / source.relative_to(self.copy)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)

    def _pristine(self, mutant: Mutant, tests: Sequence[Path]) -> dict[str, Any]:
        """The same tests on the sound code: what fails there proves nothing. It also warms numba's cache."""
        names = [str(p.relative_to(self.copy)) for p in tests]
        key = digest([self.code.encode(), repr(selection(mutant)).encode(), *(p.read_bytes() for p in tests)])
        if key not in self.results["pristine"]:
            outcome = run_tests(self.copy, tests, selection(mutant), self.scratch)
            self.results["pristine"][key] = asdict(outcome) | {"files": names, "select": selection(mutant)}
            self.save()
        return self.results["pristine"][key]

    def _judged(self, whole: dict[str, Any], outcome: Outcome, place: Place) -> dict[str, Any]:
        failed = sorted(set(outcome.failed) - set(whole["failed"]))
        if whole["state"] != "ran" or outcome.state == "no tests":
            state = f"no tests: on the sound code they are {whole['state']}"
        elif failed or outcome.state in ("hung", "crashed"):
            state = "killed"
        else:
            state = "survived"
        return {
            "state": state,
            "killed_by": max(len(failed), int(outcome.state in ("hung", "crashed"))),
            "tests": whole["tests"],
            "run": outcome.state,
            "failed": failed,
            "failed_before": whole["failed"],
            "seconds": outcome.seconds,
            "snippet": place.snippet,
            "files": [str(p.relative_to(self.copy)) for p in place.files],
        }

    def _keep(self, mutant: Mutant, found: dict[str, Any]) -> dict[str, Any]:
        self.results["mutants"][mutant.name] = {"breaks": mutant.breaks} | found
        self.save()
        return self.results["mutants"][mutant.name]


def digest(parts: Iterable[bytes]) -> str:
    found = hashlib.sha256()
    for part in parts:
        found.update(hashlib.sha256(part).digest())
    return found.hexdigest()[:16]


def row(name: str, found: dict[str, Any]) -> str:
    state = found["state"]
    if state not in ("killed", "survived"):
        return f"{name:34} {state}"
    how = f" ({found['run']})" if found["run"] != "ran" else ""
    where = ", ".join(found["files"])
    return f"{name:34} {state:9} {found['killed_by']:3} of {found['tests']:3}{how} {found['seconds']:6.1f} s  {where}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", type=Path, help="root of the code to break; it is copied, not touched")
    parser.add_argument("--out", type=Path, help="JSON of results, continued where it exists")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these mutants")
    parser.add_argument("--first", action="store_true", help="stop at the first test that fails: faster, not counted")
    parser.add_argument("--sampled", action="store_true", help="only those that are sampled")
    parser.add_argument("--docs", type=Path, help="write the table of the results of --out to this file, and end")
    parser.add_argument("--list", action="store_true", help="say where each mutant applies in the tree, and end")
    given = parser.parse_args()
    tree = given.tree.resolve()
    everything = (*(() if given.sampled else MUTANTS), *sampled(tree))
    unknown = set(given.only or ()) - {m.name for m in everything}
    if unknown:
        parser.error(f"no mutant named {', '.join(sorted(unknown))}; see --list")
    chosen = [m for m in everything if not given.only or m.name in given.only]
    if given.list:
        places = {m.name: locate(m, product_files(tree)) for m in chosen}
        for m in chosen:
            p = places[m.name]
            tests = test_files(tree, m)
            where = p if isinstance(p, str) else ", ".join(str(path.relative_to(tree)) for path in p.files)
            print(f"{m.name:34} {where}{'  ' + tests if isinstance(tests, str) else ''}\n{'':34}   {m.breaks}")
        return int(any(isinstance(p, str) for p in places.values()))
    if given.out is None:
        parser.error("--out is missing: where the results go")
    if given.docs:
        given.docs.write_text(
            survival_table(json.loads(given.out.read_text())["mutants"], {m.name for m in sampled(tree)})
        )
        return 0
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        bench = Bench(tree, Path(folder), given.out.resolve(), given.first)
        states = []
        for mutant in chosen:
            found = bench.try_one(mutant)
            print(row(mutant.name, found), flush=True)
            states.append(found["state"])
    killed = states.count("killed")
    print(f"{killed} of {len(states)} killed")
    return int(killed < len(states))


if __name__ == "__main__":
    sys.exit(main())
