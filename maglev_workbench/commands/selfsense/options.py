"""Options that several `maglev selfsense` commands share."""

from pathlib import Path
from typing import Annotated

import typer

PageOption = Annotated[Path | None, typer.Option(help="HTML page (default: selfsense-<command>.html here).")]
FrequencyOption = Annotated[float, typer.Option(help="Of the gap's motion, Hz.")]
AmplitudeOption = Annotated[float, typer.Option(help="Of the gap's motion, m.")]
SwingOption = Annotated[float, typer.Option(help="Of the duty cycle (0 to 1) about one half, at the same frequency.")]
