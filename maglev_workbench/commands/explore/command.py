"""`maglev explore`: a local page with sliders for gains and effects."""

from contextlib import suppress
from pathlib import Path
from signal import SIGTERM, default_int_handler, signal
from typing import Annotated

import typer

from maglev_workbench.options import GoalOption, friendly, require_campaign

app = typer.Typer()


@app.command(epilog="Examples: maglev explore hmb_free --goal engineer; maglev explore --sweep sweep-hmb_free")
@friendly
def explore(
    source: Annotated[
        str, typer.Argument(metavar="[RIG | CAMPAIGN]", help="Preset or rig TOML; or a campaign, to compare with it.")
    ] = "hmb_free",
    goal: GoalOption = None,
    sweep: Annotated[
        Path | None,
        typer.Option(help="Folder of a sweep of this rig: begins with its best gains, and shows its map."),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the local address (0: a free one).")] = 0,
) -> None:
    """Move gains and effects on a local page and see the loop's answer at once. Ctrl-C closes it."""
    if Path(source).is_dir():
        require_campaign(Path(source))
    from maglev_workbench.commands.explore.asked import asked
    from maglev_workbench.explore.sweep_map import sweep_file

    wanted = asked(source)
    if sweep:
        sweep_file(sweep)
    from maglev_workbench.commands.explore.measured import explored  # here because it takes long to import
    from maglev_workbench.console import console
    from maglev_workbench.explore.server import serve
    from maglev_workbench.heartbeat import stages

    shown = explored(wanted, goal, sweep)

    def say(address: str) -> None:
        console.print(f"{shown.rig.name}: open this address in a browser of this machine; Ctrl-C closes it.")
        console.print(address, soft_wrap=True, highlight=False)

    signal(SIGTERM, default_int_handler)  # closes the page as Ctrl-C does
    stages.append(lambda: "the page is open, Ctrl-C closes it")
    try:
        with suppress(KeyboardInterrupt):
            serve(shown, port, say)
    finally:
        stages.pop()
    console.print("closed")
