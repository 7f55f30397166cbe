"""Case study: theory gives the actuator 1.28 N/A, the rig 5.7; the tool names the cause, the mended model levitates.

python examples/actuator_gain_gap.py --out docs/actuator_gain_gap.png
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure

from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.corrected import corrected_rig
from sim2real.diagnosis import diagnose
from sim2real.report import sentence
from sim2real.result import Diagnosis

THEORY = Path(__file__).parent / "rigs" / "hmb_free_magnet_path.toml"
STEP, SHOWN = 17.5e-6, 0.1  # m, 5 % of the gap, and s of what follows
COLOURS = {"measured": "#222222", "theory": "#c1440e", "corrected": "#1f6f8b"}


def record(folder: Path, rig: Rig, seed: int = 0) -> Path:
    """Record a rig by the diagnosis protocol; the campaign says that it is the theory's."""
    recordings = []
    for plan in diagnosis_campaign(rig, rig.gains, {}, seed):
        data = simulated_recording(plan.experiment, simulate_records([plan.experiment])[0])
        recordings.append((plan.name, plan.role, data, plan.experiment))
    return write_campaign(folder, str(THEORY), {}, recordings)


def rightmost_pole(rig: Rig) -> float:
    """Growth rate (1/s) of the sampled loop with the rig's own gains; above 0 it falls."""
    poles = closed_loop_poles(Experiment(rig, rig.gains, ()))
    return float(np.log(abs(poles).max()) * rig.control_rate)


def step(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    """Time (s) and reading (m) after the reference steps by STEP; nan from the touchdown on."""
    silent = Excitation("multisine", "reference", fundamental=1 / SHOWN, lines=(1,), amplitude=1e-12)
    e = Experiment(rig, rig.gains, (silent,), periods=1, transient_periods=0, offset=STEP)
    reading = simulate_records([e])[0][0]
    return np.arange(reading.size) / rig.control_rate, reading


def plants(diagnosis: Diagnosis) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Frequency (n,) Hz of the holdout's injection lines, and reading over command (m/A) there: measured, by theory,
    and of the corrected rig. Neither simulated one needs a loop that holds."""
    record = diagnosis.judged.parts[0].record
    on = record.driven["current"][0]
    f = record.frequency[on]
    rigs = {"theory": diagnosis.campaign.rig, "corrected": corrected_rig(diagnosis)}
    found = {name: loop_response(Experiment(rig, rig.gains, ()), f).plant for name, rig in rigs.items()}
    return f, {"measured": (record.mean("displacement") / record.mean("command"))[0, on], **found}


def picture(diagnosis: Diagnosis, measured: Rig) -> Figure:
    """The opened loop's plant, and the step that levitates or falls."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    f, plant = plants(diagnosis)
    for name, values in plant.items():
        style = {"ls": "", "marker": "o", "ms": 4} if name == "measured" else {"ls": "--" if name == "theory" else "-"}
        left.loglog(f, 1e6 * abs(values), color=COLOURS[name], label=name, **style)
    left.set(xlabel="frequency in Hz", ylabel="|displacement / command| in µm/A", title="Plant, from the opened loop")
    left.legend()
    rigs = {"measured": measured, "theory": diagnosis.campaign.rig, "corrected": corrected_rig(diagnosis)}
    for name, rig in rigs.items():
        t, y = step(rig)
        label = f"{name}: right-most pole {rightmost_pole(rig):+.0f} 1/s"
        right.plot(1e3 * t, 1e6 * y, color=COLOURS[name], label=label, lw=3 if name == "measured" else 1.5)
    end = 1e6 * measured.clearance
    right.axhline(end, color="#999999", ls=":", label="touchdown")
    right.set(xlim=(0, 1e3 * SHOWN / 2), ylim=(-20, 1.1 * end), xlabel="time in ms", ylabel="displacement in µm")
    right.set_title(f"Step of {1e6 * STEP:g} µm with Table 3.5's gains")
    right.legend(loc="center right")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("actuator_gain_gap.png"))
    out = parser.parse_args().out
    with TemporaryDirectory() as folder:
        found = diagnose(record(Path(folder), load_rig("hmb_free")))
    print(sentence(found))
    if found.gap.after is not None:
        print(f"gap on the {found.gap.judged_on}: {found.gap.after:.2f} times the noise after the correction")
    for entry in found.which[:5]:
        print(f"  {entry.probability:6.3f}  {' + '.join(entry.effects)}")
    for name, rig in (("theory", found.campaign.rig), ("corrected", corrected_rig(found))):
        print(f"right-most pole, {name}: {rightmost_pole(rig):+.1f} 1/s")
    picture(found, load_rig("hmb_free")).savefig(out, dpi=110, metadata={"Software": None})
    print(out)
