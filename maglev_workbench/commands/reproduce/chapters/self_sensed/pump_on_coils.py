"""Section 7.2: the pump levitated, run up and identified on self-sensing, ahead of the experiment."""

from dataclasses import replace

import numpy as np
import scipy

from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.run_up import SPEEDS, run_up
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_dynamic import MEASURED_AT, MEASURED_LAG
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row, Table
from maglev_workbench.commands.runup.study import Report, report, slowest
from maglev_workbench.commands.selfsense.robustness.experiments import plan_robustness
from maglev_workbench.page import number
from selfsense.design import with_gains
from selfsense.linear import tracking

TOP = 14_000.0  # rpm
SOFTER = {"translation": 6000.0, "tilt": 5000.0}  # A/m: k_p with which that lag holds
SHOWN = (0.0, 4000.0, 8000.0, 10_000.0, 12_000.0, 14_000.0)  # rpm
FEW = np.array([0.0, 7000.0, TOP])
WRONG = "as believed", "voltage +20%", "voltage -20%", "pole area +20%", "pole area -20%", "eddy currents", "saturation"


def run(seed: int) -> Outcome:
    """Run up at the gains of Table 3.5; again with an estimator as late as measured; and with one that errs."""
    rotor = replace(load_rotor("pump"), sensor="self_sensing")
    found = report(rotor, SPEEDS, seed, None)
    probes, late = found.on_probes, late_by(rotor, MEASURED_LAG)
    softer = replace(late, gains={name: replace(g, kp=SOFTER[name]) for name, g in late.gains.items()})
    dropped, held = (run_up([one], SPEEDS, seed) for one in (late, softer))
    error, top = 1e6 * found.result.gap_error[0], int(np.flatnonzero(SPEEDS == TOP)[0])
    sensed, moved, stated = found.identifications.values()
    lost = 100 * (1 - sensed.damping[0, 0] / moved.damping[0, 0])
    rows = (
        Row("touchdowns from 0 to 14,000 rpm", None, float(found.result.touched_down.sum()), "", None,
            f"At {SPEEDS.size} speeds with the gains of Table 3.5: four radial axes read at their coils, by the "
            f"estimator of hmb_free, which lags {lag_of(rotor):.1f}° at 150 Hz. The axial direction is passive."),
        Row("largest radial peak", None, 1e6 * float(found.result.peak.max()), "µm", None,
            f"On the probes {1e6 * probes.result.peak.max():.1f} µm."),
        Row("error of the sensed displacement at 0 rpm, rms", None, error[0, 0], "µm", None,
            "By noise and resolution of the coil current, as on one axis."),
        Row("the same at 14,000 rpm", None, error[top, 0], "µm", None, "With what the lag adds at 233 Hz."),
        Row("slowest pole at 14,000 rpm", None, slowest(rotor, TOP), "1/s", None,
            f"On the probes {slowest(probes.rotor, TOP):.1f} 1/s: the integrator's."),
        Row("stiffness of the translation as identified, 0 rpm", None, 1e-3 * sensed.stiffness[0, 0], "kN/m", None,
            f"On probes {1e-3 * stated.stiffness[0, 0]:.2f} kN/m. Standard error {sensed.stiffness_se[0, 0]:.0f} N/m."),
        Row("damping of the translation as identified, 0 rpm", None, sensed.damping[0, 0], "N s/m", None,
            f"On probes {stated.damping[0, 0]:.1f} N s/m: the lag takes {lost:.0f} %."),
        Row("stiffness of the tilt as identified, 0 rpm", None, sensed.stiffness[0, 1], "N m/rad", None,
            f"On probes {stated.stiffness[0, 1]:.1f} N m/rad, and {moved.stiffness[0, 1]:.1f} N m/rad where they stand "
            "at the coils: half the difference is read further apart. The probes' planes are assumed."),
        Row("largest peak sensitivity as identified", None, float(sensed.peak_sensitivity.max()), "", None,
            f"On probes {stated.peak_sensitivity.max():.2f}."),
        Row("right-most pole with 30° at 150 Hz, 0 rpm", None, slowest(late, 0.0), "1/s", None,
            f"An estimator that only integrates. It touches down at {dropped.touched_down.sum()} of {SPEEDS.size} "
            "speeds with the gains of Table 3.5."),
        Row("lag at 150 Hz that takes all damping at 14,000 rpm", None, largest_lag(rotor), "°", None,
            "With the gains of Table 3.5."),
        Row("touchdowns with 30° at 150 Hz at softer gains", None, float(held.touched_down.sum()), "", None,
            f"k_p {SOFTER['translation']:,.0f} A/m of the translation and {SOFTER['tilt']:,.0f} A/m of the tilt; "
            f"largest peak {1e6 * held.peak.max():.0f} µm."),
    )  # fmt: skip
    notes = (
        "The one coil that is read of each pair is simulated from edge to edge of its supply, with the noise and the "
        "converter of its current; its control current comes from the amplifier's lag, and its force from the mean "
        "current. All four are alike, and their estimators know them, but for the last table.",
    )
    peaks = [
        (name, 1e6 * one.result.peak[0].max(axis=-1)) for name, one in (("self-sensing", found), ("probes", probes))
    ]
    figure = by_frequency(SPEEDS, peaks, "radial peak in µm").update_xaxes(title_text="speed in rpm")
    return Outcome(rows, (("Run-up on self-sensing and on the probes", figure),), notes, (by_speed(found), wrong(seed)))


def lag_of(rotor: Rotor) -> float:
    """Lag (degrees) of its estimators at MEASURED_AT."""
    return float(-np.degrees(np.angle(tracking(rotor.self_sensor, MEASURED_AT))))


def late_by(rotor: Rotor, lag: float) -> Rotor:
    """The rotor with estimators that only integrate, and so lag by `lag` degrees at MEASURED_AT."""

    def of(ki: float) -> Rotor:
        return replace(rotor, sensor=with_gains(rotor.self_sensor, 0.0, ki))

    return of(scipy.optimize.brentq(lambda ki: lag_of(of(ki)) - lag, 1.0, 30.0, xtol=1e-9))


def largest_lag(rotor: Rotor) -> float:
    """Lag (degrees) at MEASURED_AT at which the linear loop at TOP is no longer stable."""
    return scipy.optimize.brentq(lambda lag: slowest(late_by(rotor, lag), TOP), 20.0, MEASURED_LAG, xtol=1e-3)


def by_speed(found: Report) -> Table:
    """Error, peak and coil current at SHOWN speeds, on self-sensing and on the probes."""
    up, beside = found.result, found.on_probes.result
    head = (
        "rpm",
        "error in µm rms",
        "mean in µm",
        "largest in µm",
        "peak in µm",
        "on probes",
        "coil in A rms",
        "on probes",
    )
    rows = []
    for v in SHOWN:
        i = int(np.flatnonzero(found.speeds == v)[0])
        rows.append((
            f"{v:,.0f}", *(f"{1e6 * e:.2f}" for e in up.gap_error[0, i]),
            *(f"{1e6 * one.peak[0, i].max():.1f}" for one in (up, beside)),
            *(f"{one.coil_rms[0, i].max():.3f}" for one in (up, beside)),
        ))  # fmt: skip
    return Table("The pump on self-sensing", head, tuple(rows))


def wrong(seed: int) -> Table:
    """The run-up with coils or supplies that the estimators do not know, at the gains of Table 3.5."""
    rotor = load_rotor("pump")
    sensors = plan_robustness(rotor.axis).tables[0]
    rows = []
    for name in WRONG:
        up = run_up([replace(rotor, sensor=sensors[name])], FEW, seed)
        rms, mean = up.gap_error[0, -1, :2]
        rows.append((
            name, f"{up.touched_down.sum()} of {FEW.size}", f"{1e6 * mean:.1f}",
            f"{1e6 * np.sqrt(rms**2 - mean**2):.2f}", f"{1e6 * up.peak.max():.0f}",
            number(float(up.coil_whole_rms.max()), 2),
        ))  # fmt: skip
    head = ("what the estimators do not know", "touchdowns", "mean error in µm", "rms beside it", "largest peak in µm",
            "coil in A rms, with its mean")  # fmt: skip
    return Table("The pump on estimators that err, 0 to 14,000 rpm", head, tuple(rows))


ITEM = Item("pump-on-coils", "The pump on self-sensing", "Section 7.2", run)
