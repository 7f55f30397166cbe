"""Watch the bearings of a running pump: stiffness and damping block by block, and an alarm when they change.

python examples/monitoring.py --out docs/monitoring.png
"""

import argparse
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from maglev_env.rig.rig import with_parameters
from maglev_env.rotor.monitoring import Monitored, MonitorPlan, monitor
from maglev_env.rotor.rotor import load_rotor

SPEED = 8000.0  # rpm
STEP = 3300.0  # N/m: 10 % of what the loop shows
PLAN = MonitorPlan(amplitude=0.02)  # A peak, beside the translation controller
NAMES = ("stiffness in kN/m", "damping in N s/m")


def watched(seed: int = 0) -> Monitored:
    """Ten seconds of the pump as built, and ten with magnets whose negative stiffness has become weaker."""
    pump = load_rotor("pump")
    weaker = with_parameters(pump.axis, {"negative_stiffness": pump.axis.negative_stiffness + STEP})
    return monitor(pump, replace(pump, axis=weaker), SPEED, plan=PLAN, seed=seed)


def picture(found: Monitored) -> Figure:
    t, after = found.tracked, found.time > found.change
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for i, (axes, name) in enumerate(zip(figure.subplots(1, 2), NAMES, strict=True)):
        scale = (1e-3, 1.0)[i]
        value, error = ((t.stiffness, t.stiffness_se), (t.damping, t.damping_se))[i]
        axes.fill_between(found.time, *(scale * (value + z * error) for z in (-1.96, 1.96)), alpha=0.3)
        axes.plot(found.time, scale * value, label="tracked, 95 %")
        for style, label, model in (
            ("-", "along the orbit", found.expected),
            ("--", "about the centre", found.centred),
        ):
            level = [scale * model[int(late), i] for late in after]
            axes.plot(found.time, level, "C1" + style, lw=1, label=f"linear model {label}")
        for at in found.alarms:
            axes.axvline(at, color="k", ls=":")
        core = scale * value[5:]
        axes.set_ylim(core.min() - 0.15 * (core.max() - core.min()), core.max() + 0.15 * (core.max() - core.min()))
        axes.set(xlabel="time in s", title=name)
    figure.axes[0].legend(fontsize="small", loc="center right")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="Picture to write.")
    out = parser.parse_args().out
    found = watched()
    k, before = found.tracked.stiffness, found.time <= found.change
    print(f"tracked before {k[before][-1]:.0f} N/m, after {k[-1]:.0f}; linear model {found.expected[:, 0].round()}")
    print(f"alarms at {found.alarms} s; the change came at {found.change:g} s and was found {found.delay:g} s later")
    if out:
        picture(found).savefig(out, dpi=110)


if __name__ == "__main__":
    main()
