"""Lines for the terminal below the table of an identification."""

from estimation.normal import NORMAL_95
from maglev_env.evaluation.identification import Identification
from maglev_env.units import prefixed
from maglev_workbench.commands.estimate.gain_report import gain_line, gain_table
from maglev_workbench.console import console, marked


def say(found: Identification, fitted: bool = False) -> None:
    """Print mass, actuator, mode, distortion, margins and notes, as far as they are known.

    Args:
        found: of one recording.
        fitted: whether a rig is fitted to all recordings: what this one says by its linear response is then less than
            that, because it holds at this motion and takes lags that the rig leaves out as none.
    """
    if found.modal:
        m = found.modal
        console.print(f"mass {m.mass:.5g} +- {NORMAL_95 * m.mass_se:.2g} kg")
    if found.actuator:
        a = found.actuator
        for name, value, se, si in (
            ("actuator gain", a.gain, a.gain_se, "N/A"),
            ("stiffness without control", a.stiffness, a.stiffness_se, "N/m"),
        ):
            scale, unit = prefixed(value, si)
            what = f"{name} of the linear response at this motion" if fitted else name
            console.print(f"{what} {value * scale:.4g} +- {NORMAL_95 * se * scale:.2g} {unit}")
        if fitted:
            console.print("  of the rig itself: see the table of all recordings together, below")
    if found.gain and (text := gain_line(found.gain)):
        console.print(gain_table(found.gain))
        console.print(text)
    if found.natural_frequency is not None:
        damped = "" if found.damping_ratio is None else f", damping ratio {found.damping_ratio:.4f}"
        console.print(f"natural frequency {found.natural_frequency:.2f} Hz{damped}")
    d = found.distortion
    for name, level, p in (("even", d.even, d.even_p), ("odd", d.odd, d.odd_p)):
        if level is not None:
            console.print(
                f"{name} distortion {level:.2%} of the excited lines" + (f" (p = {p:.2g})" if p is not None else "")
            )
    if found.stability:
        s = found.stability
        ci = s.margins.intervals.get("peak_sensitivity")
        bounds = " .. ".join("?" if v is None else f"{v:.2f}" for v in ci) if ci else "no interval"
        console.print(
            f"peak sensitivity {s.margins.peak_sensitivity:.2f} ({bounds}), "
            f"ISO 14839-3 zone {s.iso_14839_3_zone}; {s.source}"
        )
        if "peak_sensitivity" in s.margins.reasons:
            console.print(marked("  !", f"peak sensitivity: {s.margins.reasons['peak_sensitivity']}"))
        for name, unit in (("gain_margin_low", ""), ("gain_margin_high", ""), ("phase_margin", " deg")):
            value = getattr(s.margins, name)
            text = f"{value:.3g}{unit}" if value is not None else s.margins.reasons.get(name, "not found")
            console.print(f"{name.replace('_', ' ')} {text}")
    for note in found.notes:
        console.print(f"  note: {note}")
