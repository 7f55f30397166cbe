"""Evidence as JSON data and back, to the last bit: with it a judge answers again without the recordings."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from sim2real.judgement.dispersion import ChiSquare, Dispersion
from sim2real.judgement.evidence import Evidence


def evidence_to_json(evidence: Evidence) -> dict[str, Any]:
    """JSON data; None for infinite costs."""
    return plain(evidence)


def evidence_from_json(data: Mapping[str, Any]) -> Evidence:
    """The evidence of `evidence_to_json`.

    Raises:
        ValueError: It is no evidence.
    """
    try:
        return _evidence(data)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise ValueError(
            f"evidence cannot be read ({type(error).__name__}: {error}); answer the campaign again"
        ) from None


def _evidence(data: Mapping[str, Any]) -> Evidence:
    effects = tuple(tuple(map(str, names)) for names in data["effects"])
    cost, excess = _numbers(data["cost"]), np.array([_numbers(row, np.nan) for row in data["excess"]], float)
    groups = tuple((str(output), str(kind), float(octave)) for output, kind, octave in data["groups"])
    if cost.shape != (len(effects),) or excess.shape != (len(effects), len(groups)):
        raise TypeError("costs, excess, effects and groups do not belong together")
    kinds = {name: ChiSquare(**data["dispersion"][name]) for name in ("fit", "recordings")}
    strain, refused, at_end = (data.get(name) for name in ("strain", "refused", "at_end"))
    return Evidence(
        effects=effects,
        cost=cost,
        nominal=float(_numbers([data["nominal"]])[0]),
        excess=excess,
        scatter=_numbers(data["scatter"]),
        groups=groups,
        tones=_table(data["tones"]),
        spin=_table(data["spin"]),
        causes={family: _table(costs) for family, costs in data["causes"].items()},
        dispersion=Dispersion(**kinds),
        strain=None if strain is None else _numbers(strain),
        nameless=float(_numbers([data.get("nameless")])[0]),
        refused=None if refused is None else _numbers(refused),
        motion=float(_numbers([data.get("motion")])[0]),
        at_end=None if at_end is None else _numbers(at_end),
    )


def _numbers(values: Sequence[float | None], missing: float = np.inf) -> np.ndarray:
    return np.array([missing if value is None else value for value in values], float)


def _table(costs: Mapping[str, float | None]) -> dict[str, float]:
    return {str(name): np.inf if cost is None else float(cost) for name, cost in costs.items()}
