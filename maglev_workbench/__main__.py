"""`python -m maglev_workbench`: the `maglev` command where its script is not on the path."""

from maglev_workbench.cli import app

app(prog_name="maglev")
