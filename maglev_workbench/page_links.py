"""Links among the pages of one folder: every page names the others, and the data that belong to it."""

import os
import re
from collections.abc import Iterator, Sequence
from html import escape, unescape
from pathlib import Path
from urllib.parse import quote

from maglev_env.recordings.files import write_text_atomic

GENERATOR = '<meta name="generator" content="maglev-workbench">'
_HEAD = 40_000  # characters from the beginning, which hold title and links
_START = '<nav><span class="pages">'
NO_LINKS = f'{_START}</span><span class="data"></span></nav>'
_TITLE = re.compile(r"<title>(.*?)</title>")


def with_data(html: str, page: Path, data: Sequence[Path]) -> str:
    """A page with links to its data, those of them that lie in its folder or below."""
    inside = [file for file in data if file.resolve().is_relative_to(page.resolve().parent)]
    links = " ".join(f'<a href="{_address(file, page)}">{escape(file.name)}</a>' for file in inside)
    return html.replace(
        '<span class="data"></span>', f'<span class="data">{"Data: " if links else ""}{links}</span>', 1
    )


def link_pages(page: Path) -> None:
    """Write the links to each other into a page and those that lie with it.

    The pages of a campaign lie in its folder and the folders in that; other pages lie together in one folder. One that
    is damaged, or that cannot be written, stays as it is.

    Raises:
        OSError: The page itself cannot be written.
    """
    titles = {one: title for one in _beside(page) if (title := _title(one))}
    if len(titles) < 2:
        return
    for own in titles:
        links = " ".join(
            f"<b>{name}</b>" if one == own else f'<a href="{_address(one, own)}">{name}</a>'
            for one, name in titles.items()
        )
        try:
            html = own.read_text(encoding="utf-8")
            before, rest = html.split(_START, 1)
            linked = f"{before}{_START}{links}{rest[rest.index('</span>') :]}"
            if linked != html:
                write_text_atomic(own, linked)
        except (OSError, ValueError):
            if own == page.resolve():
                raise


def _beside(page: Path) -> Iterator[Path]:
    own = page.resolve().parent
    campaign = next((folder for folder in (own, own.parent) if (folder / "campaign.toml").is_file()), None)
    yield from sorted((campaign or own).glob("*.html"))
    if campaign:
        yield from sorted(campaign.glob("*/*.html"))


def _title(page: Path) -> str:
    """What a page of these commands is called, as HTML; nothing for any other file."""
    try:
        with page.open(encoding="utf-8") as file:
            head = file.read(_HEAD)
    except (OSError, UnicodeDecodeError):
        return ""
    found = _TITLE.search(head)
    # Read as text and escaped again: whoever wrote the file may not have done so.
    return escape(unescape(found.group(1))) if found and GENERATOR in head and _START in head else ""


def _address(file: Path, page: Path) -> str:
    return quote(Path(os.path.relpath(file.resolve(), page.resolve().parent)).as_posix())
