"""Start and end of every `maglev selfsense` command: the path of its page; writing page, JSON and console."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_workbench.console import console, write_json
from maglev_workbench.options import require_file
from maglev_workbench.page import write_page

if TYPE_CHECKING:
    from rich.table import Table


def page_file(out: Path | None, command: str) -> Path:
    """The page's file: out, or selfsense-<command>.html in the current folder.

    Raises:
        ValueError: It cannot be written.
    """
    page = out or Path(f"selfsense-{command}.html")
    require_file(page, "--out")
    return page


def publish(
    page: Path, html: str, json_file: Path | None, data: Mapping[str, Any], shown: "Table", summary: str
) -> None:
    """Write page and JSON, then print table, summary and the path of the page."""
    write_page(page, html, [json_file])
    write_json(json_file, dict(data))
    console.print(shown)
    console.print(summary)
    console.print(f"page  {page}")
