"""`maglev effects`: lists the effects that can be added to a simulated rig."""

import typer

from maglev_workbench.options import friendly

app = typer.Typer()


@app.command(epilog="Example: maglev effects")
@friendly
def effects() -> None:
    """List the effects a simulated rig can have, with units, bounds and sources."""
    from rich.table import Table

    from maglev_env.loop.effect import EFFECTS
    from maglev_env.loop.free.places import NAMES as FREE
    from maglev_workbench.console import console

    table = Table("effect", "block", "parameters", "identified by", "source")
    for name, kind in EFFECTS.items():
        own = [f"{k} {p.bounds}" for k, p in kind.parameters.items()]
        parameters = ", ".join(own)
        if name in FREE:
            parameters = f"{own[0]}, and {len(own) - 1} coefficients (docs/formats.md)"
        table.add_row(name, kind.block, parameters, kind.identified_by, kind.source)
    console.print(table)
