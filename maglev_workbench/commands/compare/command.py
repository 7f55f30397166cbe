"""`maglev compare`: every tuner with the same budgets on the same rigs, as table, page, markdown and JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_env.loop.effect import parse_effects
from maglev_env.recordings.files import write_text_atomic
from maglev_env.rig.rig import load_rig
from maglev_env.task.task import Task, make_task
from maglev_lanes.schedule import workers
from maglev_workbench.commands.compare.numbers import figures
from maglev_workbench.commands.compare.report import (
    compare_json,
    compare_markdown,
    compare_page,
    compare_table,
    summary,
)
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page
from tuning.comparison.compare import SEARCH, budget_of, check_comparison, check_policy, compare
from tuning.methods import LEARNED, METHODS, policy_of

if TYPE_CHECKING:
    from tuning.learned.policy import HistoryPolicy


def run(
    methods: Sequence[str],
    rig: str,
    n_rigs: int,
    budgets: str,
    repeats: int,
    protocol: str,
    effects: Sequence[str],
    seed: int,
    policy: Path | None,
    scheduler: str | None,
    out: Path | None,
    docs: Path | None,
    json_file: Path | None,
) -> None:
    """See `maglev_workbench.cli_tuning.compare`."""
    require_folder(json_file, "--json")
    require_folder(docs, "--docs")
    own = policy_of(policy)
    steps = _budgets(budgets)
    check_comparison(methods or METHODS, n_rigs, steps, repeats)
    loaded = load_rig(rig)
    task = make_task(loaded, effects=parse_effects(effects), protocol=protocol, randomization="wide", budget=steps[-1])
    chosen = list(methods) or _default(task, own)
    check_policy(task, chosen, own)
    folder, runs = out or Path(f"compare-{loaded.name}"), n_rigs * repeats
    with workers(scheduler) as spread, progress_bar() as bar:
        line = bar.add_task("", total=SEARCH * n_rigs + sum(runs * budget_of(m, steps) for m in set(chosen)))

        def advance(name: str, count: int) -> None:
            bar.update(line, advance=count, description=name)

        try:
            found = compare(task, chosen, n_rigs, steps, repeats, seed, folder, advance, own, spread)
        except KeyboardInterrupt:
            console.print(f"stopped; what is finished is in {folder}: run the same command again to go on")
            raise
    of = figures(found)
    page, data = folder / "compare.html", compare_json(found, of)
    write_page(page, compare_page(found, of))
    write_json(folder / "compare.json", data)
    write_json(json_file, data)
    if docs is not None:
        asked = "".join(f" --effect {e}" for e in effects)
        options = f"--rigs {n_rigs} --budgets {budgets} --repeats {repeats} --protocol {protocol}{asked} --seed {seed}"
        command = " ".join(["maglev compare", *found.results, f"--rig {rig}", options])
        write_text_atomic(docs, compare_markdown(found, of, command))
    console.print(compare_table(found, of))
    reused = [m for m, r in found.results.items() if r.reused]
    if reused:
        console.print(f"reused from {folder}: {', '.join(reused)}")
    console.print(f"{summary(found, of)}\npage  {page}")


def _default(task: Task, policy: "HistoryPolicy | None") -> list[str]:
    """All that take any budget; the learned one where a policy serves."""
    methods = [name for name, method in METHODS.items() if method.longest is None]
    try:
        check_policy(task, methods, policy)
    except ValueError as error:
        if policy is not None:
            raise
        console.print(f"without {LEARNED}: {error}", markup=False)
        methods.remove(LEARNED)
    return methods


def _budgets(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--budgets {text!r}: give whole numbers of experiments, as 10,30") from None
