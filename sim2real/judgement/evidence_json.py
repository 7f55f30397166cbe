"""Evidence as JSON data and back, to the last bit: with it a judge answers again without the recordings."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from sim2real.judgement.dispersion import ChiSquare, Dispersion
from sim2real.judgement.evidence import Evidence


def evidence_to_json(evidence: Evidence) -> dict[str, Any]:
    """JSON data; None for infinite costs."""
    return plain(evidence)


def evidence_from_json(data: Mapping[str, Any]) -> Evidence:
    """The evidence of `evidence_to_json`."""
    costs = np.array([np.inf if cost is None else cost for cost in data["cost"]], float)
    kinds = {name: ChiSquare(**data["dispersion"][name]) for name in ("fit", "recordings")}
    return Evidence(
        effects=tuple(map(tuple, data["effects"])),
        cost=costs,
        nominal=np.inf if data["nominal"] is None else data["nominal"],
        excess=np.array([[np.nan if v is None else v for v in row] for row in data["excess"]], float),
        scatter=np.array(data["scatter"], float),
        groups=tuple((output, kind, octave) for output, kind, octave in data["groups"]),
        tones=data["tones"],
        spin=data["spin"],
        causes=data["causes"],
        dispersion=Dispersion(**kinds),
        strain=None if data["strain"] is None else np.array(data["strain"], float),
        by_drift=None if data["by_drift"] is None else np.array(data["by_drift"], float),
    )
