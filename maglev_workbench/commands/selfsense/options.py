"""Options that several `maglev selfsense` commands share."""

from pathlib import Path
from typing import Annotated

import typer

PageOption = Annotated[Path | None, typer.Option(help="HTML page (default: selfsense-<command>.html here).")]
FrequencyOption = Annotated[float, typer.Option(help="Frequency of the gap's motion, Hz.")]
AmplitudeOption = Annotated[float, typer.Option(help="Amplitude of the gap's motion, m.")]
SwingOption = Annotated[float, typer.Option(help="Swing of the duty cycle (0 to 1) about one half, same frequency.")]
