"""`maglev compare --twin`: tunes on nominal and corrected simulator and on the sealed twin, and scores on the twin."""

import json
from pathlib import Path
from shlex import quote

from maglev_env.recordings.files import write_text_atomic
from maglev_workbench.commands.blind.sealed_set import SET
from maglev_workbench.commands.compare.twin_report import (
    Compared,
    summary,
    twin_json,
    twin_markdown,
    twin_page,
    twin_tables,
)
from maglev_workbench.console import console, progress_bar, write_json
from maglev_workbench.options import require_apart, require_folder
from maglev_workbench.page import write_page
from sim2real.blind.cases import answers_digest, open_labels, seal_of
from sim2real.blind.judging.worth import CORRECTED, NOMINAL, TWIN, twin_cases
from tuning.comparison.twin import SPEC, compare_simulators


def run(
    folder: Path,
    budgets: tuple[int, int],
    cases: int,
    processes: int | None,
    seed: int,
    out: Path | None,
    docs: Path | None,
    json_file: Path | None,
) -> None:
    """Compare the simulators on the twin; the options are those of `maglev compare`.

    Args:
        budgets: experiments on each simulator, and on the twin.
    """
    experiments = dict(zip((NOMINAL, CORRECTED, TWIN), (budgets[0], *budgets), strict=True))
    chosen, seal = twin_cases(folder, cases), seal_of(folder)
    results = out or folder / "worth"
    require_folder(results)
    require_apart(json_file, results, (SPEC,))
    with progress_bar() as bar:
        line = bar.add_task("tune and score on the twin", total=len(chosen))
        try:
            found, reused = compare_simulators(
                chosen,
                results,
                experiments,
                seed,
                {"labels_sha256": seal, "answers_sha256": answers_digest(folder, open_labels(folder))},
                processes,
                lambda n: bar.advance(line, n),
            )
        except KeyboardInterrupt:
            console.print(f"stopped; finished cases are in {results}: run the same command again to continue")
            raise
    path = folder / SET
    compared = Compared(found, experiments, seed, json.loads(path.read_text()) if path.is_file() else {}, seal)
    html, data = results / "twin.html", twin_json(compared)
    write_page(html, twin_page(compared), [results / "twin.json"])
    write_json(results / "twin.json", data)
    write_json(json_file, data)
    if docs is not None:
        write_text_atomic(docs, twin_markdown(compared, _command(folder, experiments, cases, seed)))
    console.print(*twin_tables(compared))
    if reused:
        console.print(f"{reused} of {len(chosen)} cases reused from {results}")
    console.print(f"{summary(compared)}\npage  {html}")


def _command(folder: Path, budgets: dict[str, int], cases: int, seed: int) -> str:
    numbers = sorted(set(budgets.values()))
    shown = str(numbers[0]) if len(numbers) == 1 else f"{budgets[NOMINAL]},{budgets[TWIN]}"
    return f"maglev compare --twin {quote(str(folder))} --budgets {shown} --cases {cases} --seed {seed}"
