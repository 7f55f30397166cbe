"""The page of what deliberate faults survived: docs/mutants.md."""

from collections.abc import Collection, Mapping
from typing import Any

from mutants_list import MUTANTS
from mutants_targets import EQUIVALENT, TARGETS

HEAD = """# Do the tests see faults?

`tests/tools/mutants.py` breaks the product one small way at a time and runs the tests of what it broke. Sampled faults
change one operator, number or function of a formula, wherever a seeded draw falls; the list is of faults that a person
thought of. The tests of a row are those of the file, not the whole suite: a fault that survives here may be seen
elsewhere.

Remade by

```sh
python tests/tools/mutants.py . --first --out mutants.json
python tests/tools/mutants.py . --out mutants.json --docs docs/mutants.md
```
"""


def survival_table(results: Mapping[str, Mapping[str, Any]], drawn: Collection[str]) -> str:
    """The page, of the results by the mutants' names, as far as they are still drawn; what was not tried is said."""
    listed = {m.name for m in MUTANTS}
    results = {name: found for name, found in results.items() if name in listed or name in drawn}
    untried = sum(name not in results for name in drawn)
    counts = {t.file: _of_file(results, t.file, listed) for t in TARGETS}
    own = [found for name, found in results.items() if name in listed]
    rows = [(f"`{file}`", *numbers) for file, numbers in counts.items()]
    rows.append(("the list", sum(f["state"] == "killed" for f in own), sum(f["state"] == "survived" for f in own)))
    killed, survived = sum(r[1] for r in rows[:-1]), sum(r[2] for r in rows[:-1])
    share = 100 * survived / max(killed + survived, 1)
    lines = [HEAD]
    lines.append(
        f"Of {killed + survived} sampled faults {survived} survive, {share:.1f} %; {untried} more are drawn and were "
        f"not tried; of {len(listed)} faults of the list {len(own)} were tried. {len(EQUIVALENT)} further draws "
        "change nothing that a result rests on, and are left out with their reasons (below).\n"
    )
    lines += ["| file | killed | survived |", "|---|---|---|"]
    lines += [f"| {name} | {dead} | {alive} |" for name, dead, alive in rows if dead + alive]
    alive = [(name, found["breaks"]) for name, found in results.items() if found["state"] == "survived"]
    if alive:
        lines += ["\n## What survives\n", *(f"- {_code(breaks)}" for _, breaks in sorted(alive))]
    lines += ["\n## Draws that change nothing\n"]
    lines += [f"- `{name.replace('|', '&#124;')}`: {why}." for name, why in EQUIVALENT.items()]
    return "\n".join(lines) + "\n"


def _of_file(results: Mapping[str, Mapping[str, Any]], file: str, listed: set[str]) -> tuple[int, int]:
    begins = f"In {file}: "
    own = [f["state"] for name, f in results.items() if name not in listed and f["breaks"].startswith(begins)]
    return own.count("killed"), own.count("survived")


def _code(text: str) -> str:
    where, _, what = text.removeprefix("In ").partition(": ")
    return f"`{where}`: `{what.removesuffix('.')}`"
