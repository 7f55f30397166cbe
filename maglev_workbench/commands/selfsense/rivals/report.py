"""Observer, Kalman filter and parameter estimator: console table, page and JSON."""

from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.rig_sensor import made_by, sampling_note
from maglev_workbench.commands.selfsense.rivals.experiments import AVERAGED, NAMES, Result, Rivalry
from maglev_workbench.commands.selfsense.rivals.figures import series
from maglev_workbench.page import note, number, page, table
from selfsense.rivals.averaged import observability

if TYPE_CHECKING:
    import rich.table

_STEP = 25  # samples between those that the JSON keeps


def rivals_table(r: Rivalry) -> "rich.table.Table":
    """The errors as they are in 80 columns."""
    from rich import box
    from rich.table import Table

    result = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"{r.rig.name}: error of the displacement, µm rms")
    for name in ("", "motion", "observer", "Kalman", "parameter\nestimator"):
        result.add_column(name, justify="left" if not name else "right")
    for one in r.results:
        result.add_row(one.case.name, *(number(1e6 * v) for v in (one.motion, *(one.errors[n] for n in NAMES))))
    return result


def rivals_summary(r: Rivalry) -> str:
    """Sentences on the errors of the three methods, with nominal and with wrong parameters."""
    by_name = {one.case.name: one for one in r.results}
    nominal, hot, step = (by_name[name] for name in ("nominal", "resistance +20 %", "force step"))
    others = [by_name[f"{name} +20 %"] for name in ("supply voltage", "inductance")]
    raw, left = (" and ".join(_um(getattr(o, of)["estimator"]) for o in others) for of in ("errors", "fitted"))
    observer, kalman, estimator = (_um(nominal.errors[n]) for n in NAMES)
    return (
        f"On the rig that all three believe in, the state observer reads a motion of {_um(nominal.motion)} µm rms to "
        f"{observer} µm, the Kalman filter to {kalman} and the parameter estimator to {estimator}. With 20 % more coil "
        f"resistance these errors are {_three(hot)}, under a constant force of {number(step.case.step)} N "
        f"{_three(step)}: observer and filter infer the displacement from the balance of forces and voltages, the "
        f"parameter estimator from the ripple. A supply voltage or an inductance 20 % off scales its reading, {raw} "
        f"µm, of which offset and gain calibrated leave {left} µm; of the observer's error with more resistance they "
        f"leave {_um(hot.fitted['observer'])} µm, of {_um(hot.motion)} µm of motion."
    )


def rivals_json(r: Rivalry) -> dict[str, Any]:
    """The comparison as JSON data, schema maglev-selfsense-rivals/1, SI; time series thinned."""
    results = []
    for one in r.results:
        case = asdict(one.case)
        numbers = {name: getattr(one, name) for name in ("motion", "errors", "fitted", "claim")}
        thin = {name: getattr(one, name)[::_STEP] for name in ("time", "position", "observer", "kalman")}
        every = max(1, round(_STEP * one.own_time.size / one.time.size))
        thin |= {name: getattr(one, name)[::every] for name in ("own_time", "estimator")}
        results.append({**case, **numbers, "series": thin})
    rank, condition = observability(r.results[0].case.magnet)
    return plain(
        {
            "schema": "maglev-selfsense-rivals/1",
            "version": version("maglev-workbench"),
            "rig": r.rig.name,
            "sensor": r.sensor,
            "seed": r.seed,
            "seconds": r.seconds,
            "force_noise": r.force_noise,
            "observability": {"rank": rank, "condition": condition},
            "observer_poles": {"real": r.poles.real, "imag": r.poles.imag},
            "cases": results,
        }
    )


def rivals_page(r: Rivalry) -> str:
    """The HTML of the comparison."""
    head = ["", "motion", "state\nobserver", "Kalman\nfilter", "the filter\nclaims", "parameter\nestimator"]
    head += [f"{name},\ncalibrated" for name in ("observer", "filter", "estimator")]
    rows = []
    for one in r.results:
        values = [one.motion, one.errors["observer"], one.errors["kalman"], one.claim, one.errors["estimator"]]
        rows.append([one.case.name, *(number(1e6 * v) for v in (*values, *(one.fitted[n] for n in NAMES)))])
    m, pwm = r.results[0].case.magnet, r.sensor.supply.frequency
    text = (
        "All in µm rms over the second half of the record. Calibrated: after the offset and gain that fit this record "
        "best, which shrink noise too; where the motion itself is left, the reading says nothing of it. The rig is as "
        "the row says, and all three believe in the nominal one"
    )
    text += "; in the last row they know the smaller back-EMF. " if r.results[-1].case.believed is not m else ". "
    text += "The rivals err slowly, so one record scatters: the filter claims what many records would show."
    how = (
        f"The nonlinear rotor is levitated on its true position under a white force of {1e3 * r.force_noise:.3g} "
        "mN/√Hz; coil and supply are simulated switching edge by switching edge along that motion. The rivals get the "
        f"best of everything: one equivalent coil with all the back-EMF that energy allows, {number(m.emf)} V s/m, its "
        f"current averaged over every PWM period from {AVERAGED} samples (edges between fewer would bias it), the "
        f"strength of the force, and the observer the poles of the steady filter, {_poles(r.poles)} 1/s. Their model "
        f"is observable with a condition of {number(observability(m)[1], 2)} in natural units. Its slow pole stays: "
        "displacement shows only through the force that stiffness makes of it, and so does any constant force. "
    )
    sections = [
        ("Error of the displacement", table(head, rows)),
        ("", note(text)),
        ("What they read", series(r)),
        (
            "",
            note(
                "Black (white on a dark screen): "
                "true position. A force step is a displacement to observer and filter; the estimator follows."
            ),
        ),
        ("How it was compared", note(how + sampling_note(r.sensor) + f"The rivals run at {pwm / 1e3:g} kHz.")),
    ]
    made = made_by(r.rig, r.sensor, **{"Seed": r.seed, "Record": f"{r.seconds:.3g} s"})
    return page(f"Rivals of the parameter estimator on {r.rig.name}", rivals_summary(r), sections, made)


def _um(value: float) -> str:
    return number(1e6 * value, 2)


def _three(one: Result) -> str:
    observer, kalman, estimator = (_um(one.errors[n]) for n in NAMES)
    return f"{observer}, {kalman} and {estimator} µm"


def _poles(poles: np.ndarray) -> str:
    real = [p for p in poles if p.imag >= 0]
    return ", ".join(f"{p.real:.0f}" + (f" ± {p.imag:.0f}j" if p.imag else "") for p in real)
