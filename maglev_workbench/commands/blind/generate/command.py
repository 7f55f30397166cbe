"""`maglev blind generate`: writes campaigns of an independent twin and seals their labels."""

import typer

from maglev_workbench.commands.blind.options import (
    COUNT,
    BenchmarkOption,
    CountOption,
    FolderOption,
    ProcessesOption,
    SetSeedOption,
)
from maglev_workbench.options import JsonOption, friendly

app = typer.Typer()


@app.command(epilog="Example: maglev blind generate --count 480 --seed 7 --out sealed")
@friendly
def generate(
    out: FolderOption,
    seed: SetSeedOption,
    count: CountOption = COUNT,
    benchmark: BenchmarkOption = False,
    processes: ProcessesOption = None,
    json_file: JsonOption = None,
) -> None:
    """Write campaigns of an independent twin and seal their labels: prints the SHA-256 of the labels.

    An interrupted run resumes.
    """
    from maglev_workbench.commands.blind import sealed_set
    from maglev_workbench.console import write_json

    write_json(json_file, sealed_set.generate(out, count, seed, processes, benchmark))
