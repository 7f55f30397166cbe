"""The pooled estimate of a named rig: a table of identified against nominal values, and JSON."""

from typing import TYPE_CHECKING, Any

from sim2real.pooled import Coefficient, Pooled

if TYPE_CHECKING:
    import rich.table


def pooled_table(found: Pooled) -> "rich.table.Table":
    """Identified beside nominal coefficients, in percent and in standard errors."""
    from rich.table import Table

    table = Table("all recordings together", "identified", "95 %", "nominal", "change", "standard errors")
    for c in found.coefficients:
        low, high = c.interval
        interval = f"{low:.5g} .. {high:.5g}" if c.bounded else "not bounded"
        change = "-" if c.change is None else f"{c.change:+.1%}"
        name = f"{c.name.replace('_', ' ')}, {c.unit}"
        table.add_row(name, f"{c.value:.5g}", interval, f"{c.nominal:.5g}", change, f"{c.apart:+.1f}")
    return table


def pooled_lines(found: Pooled) -> list[str]:
    """What is to be said below the table."""
    lines = list(found.disagreements)
    if found.misfit > 1.1:
        lines.append(
            f"the rig's model leaves {found.misfit:.2g} times the noise: intervals are widened for it; "
            "`maglev diagnose` looks for what is missing"
        )
    return lines


def pooled_json(found: Pooled) -> dict[str, Any]:
    """The pooled estimate as JSON data, SI; what is not bounded has no interval."""
    return {
        "coefficients": [_coefficient(c) for c in found.coefficients],
        "misfit": found.misfit,
        "disagreements": list(found.disagreements),
        "recordings": {name: [_coefficient(c) for c in own] for name, own in found.of_each.items()},
    }


def _coefficient(c: Coefficient) -> dict[str, Any]:
    return {
        "name": c.name,
        "unit": c.unit,
        "value": c.value,
        "se": c.se,
        "interval": list(c.interval) if c.bounded else None,
        "nominal": c.nominal,
        "change": c.change,
    }
