"""`python -m maglev_workbench`: the `maglev` command where its script is not on the path."""

from maglev_workbench.cli import app

if __name__ == "__main__":  # not in the processes that a command starts
    app(prog_name="maglev")
