"""The file campaign.toml itself, without what it states: its errors are told before the imports that take long."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maglev_env.fields import toml_tables, toml_text

SCHEMA = "maglev-campaign/1"


def campaign_tables(folder_or_toml: str | Path) -> tuple[Path, dict[str, Any]]:
    """Path and tables of a campaign.toml.

    Raises:
        ValueError: It is not TOML of this schema.
        OSError: It does not exist, or cannot be read.
    """
    path = Path(folder_or_toml)
    path = path / "campaign.toml" if path.is_dir() else path
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist; name a campaign folder or its campaign.toml")
    if path.suffix != ".toml":
        raise ValueError(
            f"{path} is not a campaign folder or campaign.toml; `maglev estimate` also reads one data file"
        )
    text = toml_text(path, "campaign")
    try:
        tables = toml_tables(text)
        check_schema(tables)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from error
    return path, tables


def check_schema(tables: Mapping[str, Any]) -> None:
    """Raise ValueError if tables are of another schema."""
    if tables.get("schema") != SCHEMA:
        raise ValueError(f'schema = {tables.get("schema")!r}; this version reads schema = "{SCHEMA}"')
