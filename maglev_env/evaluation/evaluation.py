"""What the experiments of gain sets showed: the arrays of `evaluate`, and how they present themselves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from estimation.normal import NORMAL_95
from maglev_env.presented import Presented, matplotlib_figure
from maglev_env.rig.goal import QUANTITIES
from maglev_env.units import prefixed

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Evaluation(Presented):
    """n scored experiments; arrays (n,) unless stated, nan where the rotor touched down.

    For an x-y rig every value is that of the axis with the lower score, by D's direct coefficients; there
    peak_displacement is radial and current_rms is the larger one.

    Attributes:
        bands: (b, 2), Hz.
        band_stiffness, band_damping: By maximum likelihood, (n, b), N/m and N s/m.
        band_stiffness_se, band_damping_se: Their standard errors.
        stiffness, damping: In the rig's target band, N/m and N s/m.
        stiffness_low, stiffness_high, damping_low, damping_high: Their 95 % bounds.
        ls_stiffness, ls_damping: Their least-squares values.
        margins: Margins by name, (n,); nan where the crossing lies outside the injection lines.
        peak_sensitivity_se: Standard error, wider for the few periods that tell it: 1.96 of it hold 95 %.
        peak_displacement: m.
        current_rms: A.
        touchdown_time: s.
        gap_error_rms: Of the sensed displacement, m; likewise gap_error_bias and gap_error_worst.
        added_phase: Lag of self-sensing beyond the probe's at the frequency of the phase margin, degrees; nan with a
            probe.
        margin_lost: Phase margin that a probe would have in addition, degrees; nan with a probe.
        pole_radius: Of the simulated loop, linearised.
        terms: Score terms.
        score: 0 to 1.
        feasible: The linearised loop is stable and the rotor never touched down. A rotor may also stay near a pole
            although it is unstable in the centre.
        axis: 0 (x) or 1 (y).
        required: What a goal measures, by name (see `rig.goal.QUANTITIES`), each of the axis where it is worse, and of
            the worst rig if it is judged on several. Empty for the goal `match`.
        required_low, required_high: Their 95 % bounds where they are known (see `requirements.Measured`).
        between_lines: What the linearised loop has at all frequencies, by `linear.between_lines.NAMES`, where a sharp
            resonance lies between the injection lines; nan where the lines show as much. The bounds hold it, the
            measured values do not.
    """

    bands: np.ndarray
    band_stiffness: np.ndarray
    band_damping: np.ndarray
    band_stiffness_se: np.ndarray
    band_damping_se: np.ndarray
    stiffness: np.ndarray
    stiffness_low: np.ndarray
    stiffness_high: np.ndarray
    damping: np.ndarray
    damping_low: np.ndarray
    damping_high: np.ndarray
    ls_stiffness: np.ndarray
    ls_damping: np.ndarray
    margins: dict[str, np.ndarray]
    peak_sensitivity_se: np.ndarray
    peak_displacement: np.ndarray
    current_rms: np.ndarray
    touchdown_time: np.ndarray
    gap_error_rms: np.ndarray
    gap_error_bias: np.ndarray
    gap_error_worst: np.ndarray
    added_phase: np.ndarray
    margin_lost: np.ndarray
    pole_radius: np.ndarray
    terms: dict[str, np.ndarray]
    score: np.ndarray
    feasible: np.ndarray
    axis: np.ndarray
    required: dict[str, np.ndarray] = field(default_factory=dict)
    required_low: dict[str, np.ndarray] = field(default_factory=dict)
    required_high: dict[str, np.ndarray] = field(default_factory=dict)
    between_lines: dict[str, np.ndarray] = field(default_factory=dict)

    rows = "experiment"

    def __str__(self) -> str:
        if not self.feasible.any():
            return f"Evaluation of {len(self.score)} experiments, none feasible"
        best = int(np.argmax(self.score))
        factor, unit = prefixed(float(np.nan_to_num(self.stiffness[best])), "N/m")
        return (
            f"Evaluation of {len(self.score)} experiments, {int(self.feasible.sum())} feasible; best number {best}: "
            f"score {self.score[best]:.3f}, stiffness {self.stiffness[best] * factor:.3g} {unit}, "
            f"damping {self.damping[best]:.3g} N s/m, peak |S| {self.margins['peak_sensitivity'][best]:.3g}"
        )

    def to_xarray(self) -> "xr.Dataset":
        """Every array by experiment, and by band at the bands' centres (Hz); units are in the attributes.

        Margins have their own names; the terms of the score begin with `term_`, what a goal measures with `required_`,
        and what lies between the lines with `between_lines_`.
        """
        import xarray as xr

        arrays = {}
        for f in fields(self):
            own = getattr(self, f.name)
            if isinstance(own, dict):
                arrays |= {f"{_PREFIXES[f.name]}{name}": values for name, values in own.items()}
            elif f.name != "bands":
                arrays[f.name] = own
        dims = ("experiment", "band")
        variables = {
            name: (dims[: np.ndim(values)], values, {"units": unit} if (unit := unit_of(name)) else {})
            for name, values in arrays.items()
        }
        hertz = {"units": "Hz"}
        coordinates = {
            "experiment": np.arange(len(self.score)),
            "band": ("band", self.bands.mean(axis=1), hertz),
            "f_lo": ("band", self.bands[:, 0], hertz),
            "f_hi": ("band", self.bands[:, 1], hertz),
        }
        return xr.Dataset(variables, coordinates, {"rows": self.rows})

    def plot(self) -> "Figure":
        """Stiffness and damping over frequency of every experiment with 95 % intervals, as a matplotlib figure."""
        figure = matplotlib_figure()(layout="constrained")
        axes = figure.subplots(2, 1, sharex=True)
        centre = self.bands.mean(axis=1)
        for ax, name, unit in zip(axes, ("stiffness", "damping"), ("N/m", "N s/m"), strict=True):
            value, se = getattr(self, f"band_{name}"), getattr(self, f"band_{name}_se")
            for i in range(len(self.score)):
                ax.errorbar(centre, value[i], NORMAL_95 * se[i], fmt=".-", capsize=2, label=f"experiment {i}")
            ax.set_ylabel(f"{name}, {unit}")
        axes[1].set_xlabel("frequency, Hz")
        axes[0].legend()
        return figure


# Of the arrays by name, in a table of all arrays.
_PREFIXES = {
    "margins": "", "terms": "term_", "required": "required_", "required_low": "required_low_",
    "required_high": "required_high_", "between_lines": "between_lines_",
}  # fmt: skip
# SI units of the arrays, by a part of their names; the first that fits counts.
_UNITS = (
    ("term_", ""), ("_frequency", "Hz"), ("stiffness", "N/m"), ("damping", "N s/m"), ("phase", "deg"),
    ("margin_lost", "deg"), ("delay_margin", "s"), ("displacement", "m"), ("current_rms", "A"), ("touchdown_time", "s"),
    ("gap_error", "m"),
)  # fmt: skip


def unit_of(name: str) -> str:
    """SI unit of an array as `to_xarray` or a sweep names it; "" for ratios."""
    if name.startswith("required_"):
        words = name.removeprefix("required_").removeprefix("low_").removeprefix("high_")
        quantity = QUANTITIES.get(words.removesuffix("_low").removesuffix("_high"))
        return quantity.unit if quantity else ""
    return next((unit for part, unit in _UNITS if part in name), "")


def joined(parts: Sequence[Evaluation], join: Callable[[list[np.ndarray]], np.ndarray]) -> Evaluation:
    """One evaluation with every array joined from those of the parts, which have the same bands.

    Args:
        parts: evaluations.
        join: the array made of the same array of all parts, such as np.concatenate.
    """
    found = {}
    for f in fields(Evaluation):
        values = [getattr(p, f.name) for p in parts]
        if f.name == "bands":
            found[f.name] = values[0]
        elif isinstance(values[0], dict):
            found[f.name] = {key: join([v[key] for v in values]) for key in values[0]}
        else:
            found[f.name] = join(values)
    return Evaluation(**found)
