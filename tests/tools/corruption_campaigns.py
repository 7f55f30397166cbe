"""Campaigns for `corruptions.py`: simulated recordings of rigs that are off by their tolerances, of five kinds."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "models"))
import bench_loop

from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import check_effects, effect
from maglev_env.loop.gains import NO_CONTROLLER, Gains
from maglev_env.recordings.campaign_writer import excitation_table, toml_value
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.rig.rig_file import load_rig
from sim2real.blind.menu import EFFECTS as MENU

KINDS = ("named", "mass only", "current only", "open", "x-y")
RIGS = {
    "named": ("hmb_free", "eframe", "pedestal", "wide"),
    "mass only": ("hmb_free", "eframe", "pedestal", "hmb_axial", "wide"),
    "current only": ("hmb_free", "eframe", "wide"),
    "open": ("bench",),
    "x-y": ("hmb_radial",),
}


@dataclass
class Made:
    """A campaign in memory: the tree of its campaign.toml, the columns of its one or two files, and what made them."""

    tree: dict[str, Any]
    files: list[dict[str, np.ndarray]]
    rig: Rig
    run: Experiment | None = None

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """The columns of the last file, which is the one that is corrupted."""
        return self.files[-1]

    @property
    def table(self) -> dict[str, Any]:
        """What the campaign states of it."""
        return self.tree["recording"][-1]

    def copy(self) -> "Made":
        tree = json.loads(json.dumps(self.tree))
        return Made(tree, [{k: v.copy() for k, v in columns.items()} for columns in self.files], self.rig, self.run)

    def write(self, folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for table, columns in zip(self.tree["recording"], self.files, strict=True):
            np.savez(folder / table["file"], **columns)
        head = [f"{k} = {inline(v)}" for k, v in self.tree.items() if not isinstance(v, dict | list)]
        if self.tree.get("parameters"):
            head += ["[parameters]", *(f"{k} = {inline(v)}" for k, v in self.tree["parameters"].items())]
        for table in self.tree["recording"]:
            head += ["[[recording]]", *(f"{k} = {inline(v)}" for k, v in table.items())]
        (folder / "campaign.toml").write_text("\n".join(head) + "\n")
        return folder


def inline(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {inline(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(inline, value)) + "]"
    return toml_value(value)


def wide(rng: np.random.Generator) -> Rig:
    """A one-axis rig with gains and mass of its own that levitates well."""
    while True:
        rig = load_rig(str(rng.choice(["hmb_free", "eframe"])))
        kp, kd, m = rng.uniform(0.8, 1.6), rng.uniform(0.9, 2.0), rng.uniform(0.75, 1.3)
        gains = replace(rig.gains, kp=rig.gains.kp * kp, kd=rig.gains.kd * kd)
        rig = replace(with_parameters(rig, {"mass": rig.mass * m}), gains=gains)
        if np.abs(closed_loop_poles(Experiment(rig, gains, ()))).max() < 0.998:
            return rig


def deviations(rig: Rig, rng: np.random.Generator) -> tuple[Rig, dict]:
    """The true rig: off by its tolerances."""
    off = {k: float(v * rng.standard_normal()) for k, v in rig.tolerance.items()}
    effects: dict = {}
    for parameter, name in (
        ("mass", "mass"),
        ("actuator_gain", "actuator_gain"),
        ("negative_stiffness", "negative_stiffness"),
        ("probe_gain", "sensor_gain"),
        ("support_stiffness", "support_stiffness"),
    ):
        if parameter in off:
            effects |= effect(name, off[parameter])
    if "amplifier_time_constant" in off:
        t = rig.amplifier_time_constant * max(1 + off["amplifier_time_constant"], 0.2)
        rig = with_parameters(rig, {"amplifier_time_constant": t})
    return rig, effects


def drawn_effect(rig: Rig, rng: np.random.Generator) -> dict:
    """One effect of the library, of 1 to 100 times the size at which a sealed set's search for its threshold starts."""
    while True:
        name = str(rng.choice(list(MENU)))
        card = MENU[name]
        if name in ("runout", "unbalance", "pickup") or (card.rig and not rig.support_stiffness):
            continue
        if not rig.controlled and card.block in ("controller", "amplifier", "actuator"):
            continue
        size = min(card.start * np.exp(rng.uniform(0, np.log(100.0))), card.high)
        sign = -1.0 if card.low and rng.random() < 0.5 else 1.0
        if sign < 0:
            size = min(size, -card.low)
        values = card.values(float(size), sign, card.others(rng))
        if name == "friction":
            values = {"force": values["force"], "velocity": values["velocity"], "presliding": values["bristle"]}
        if name == "eddy_current":
            values.pop("diffusion")
            values["corner_hz"] = float(np.clip(values["corner_hz"], 1.0, 1e6))
        try:
            found = effect(name, **values)
            check_effects(found, rig)
        except ValueError:
            continue
        return found


def made(kind: str, rng: np.random.Generator, effected: bool = False, records: int = 1) -> tuple[Made, str, str]:
    """A sound campaign of a kind with so many recordings, the name of its rig and of its effect."""
    source = str(rng.choice(RIGS[kind]))
    if kind == "open":
        return open_campaign(rng, effected, records), source, "bench" if effected else ""
    for _ in range(40):
        rig = wide(rng) if source == "wide" else load_rig(source)
        true, effects = deviations(rig, rng)
        extra = drawn_effect(rig, rng) if effected else {}
        gains = rig.gains or NO_CONTROLLER
        e = protocol_experiment(rig, gains, {}, int(rng.integers(2**31)))
        if rng.random() < 0.5 and rig.axes == 1:
            base = diagnosis_campaign(rig, gains, {}, int(rng.integers(2**31)))[0].experiment
            e = replace(base, seed=e.seed)
        if kind == "current only":
            lines = lines_at(e.excitations, "current")
            amplitude = next(x.amplitude for x in e.excitations if x.at == "current")
            low = tuple(range(3, int(lines.min()) + 100, 4))
            all_lines = tuple(map(int, np.union1d(lines, low)))
            e = replace(e, excitations=(Excitation("sphs", "current", e.fundamental, all_lines, amplitude),))
        noisy = replace(e, rig=true, effects={**effects, **extra}, transient_periods=1)
        runs = [replace(noisy, periods=e.periods + 1, seed=noisy.seed + i) for i in range(records)]
        found = [simulate_records([run])[0] for run in runs]
        if all(np.isfinite(record).all() for record in found):
            break
    else:
        raise RuntimeError(f"no draw of {source} levitates")
    files = []
    for run, record in zip(runs, found, strict=True):
        files.append(_columns(run, record))
    periods = e.periods + 1
    tables = [{**excitation_table(x), "periods": periods} for x in e.excitations]
    keep = {
        "mass only": ["force", "displacement"],
        "current only": ["displacement", "current"],
    }.get(kind, [n for n in files[0] if n != "time"])
    if rng.random() < 0.3 and kind == "named":
        keep = [n for n in keep if n != "current"]
    table = {
        "role": "fit", "sample_rate": rig.control_rate, "intersample": "zoh",
        **({} if kind == "mass only" or not rig.controlled else {"gains": vars(gains)}),
        "excitation": [t for t in tables if kind != "mass only" or t["at"] == "force"],
        "channels": {n: {"from": n} for n in keep},
    }  # fmt: skip
    tree: dict[str, Any] = {"schema": "maglev-campaign/1"}
    if kind != "mass only":
        tree["rig"] = rig.name
    tree["parameters"] = {"mass": rig.mass}
    tree["recording"] = _tables(table, records)
    return Made(tree, files, rig, noisy), source, next(iter(extra), "")


def _columns(run: Experiment, record: np.ndarray) -> dict[str, np.ndarray]:
    dataset = simulated_recording(run, record)
    return {"time": dataset["time"].values, **{str(n): dataset[n].values for n in dataset.data_vars}}


def under_other_gains(m: Made, rng: np.random.Generator) -> dict[str, np.ndarray] | None:
    """The columns of the same recording, had its gains been others; None where the rotor does not levitate."""
    if m.run is None or not isinstance(m.run.gains, Gains):
        return None
    kp, kd = rng.choice([0.8, 1.2, 1.3], 2)
    other = replace(m.run, gains=replace(m.run.gains, kp=m.run.gains.kp * kp, kd=m.run.gains.kd * kd))
    other = replace(other, periods=other.periods + 1)
    record = simulate_records([other])[0]
    return _columns(other, record) if np.isfinite(record).all() else None


def _tables(table: dict[str, Any], records: int) -> list[dict[str, Any]]:
    """A table for each recording."""
    return [{"file": f"run{i}.npz", **json.loads(json.dumps(table))} for i in range(records)]


def open_campaign(rng: np.random.Generator, effected: bool, records: int) -> Made:
    """Noise or steps on a bench of another hand; half of the files hold what was injected."""
    bench = bench_loop.Bench(gain=0.05 * rng.standard_normal(), stiffness=0.1 * rng.standard_normal(), noise=0.5e-6)
    if effected:
        which = rng.integers(3)
        size = float(np.exp(rng.uniform(0, np.log(50.0))))
        bench = replace(bench, **[{"delay": 2e-6 * size}, {"gain": 0.01 * size}, {"stiffness": 0.01 * size}][which])
    kind, seconds, seed = str(rng.choice(["noise", "steps", "chirp"])), 2.0, int(rng.integers(2**31))
    name = "reference" if kind == "steps" else "injection"
    keep = ["displacement", "command", "current", *([name] if rng.random() < 0.5 else [])]
    files = []
    for i in range(records):
        columns = bench_loop.record(bench, kind, seconds, seed + i)
        injection, reference = bench_loop.excitation(kind, seconds, np.random.default_rng(seed + i))
        columns |= {"injection": injection, "reference": reference}
        time = np.arange(injection.size) / bench_loop.RATE
        files.append({"time": time, **{name: columns[name] for name in keep}})
    b = bench_loop
    gains = {"kp": b.KP, "ki": b.KI, "kd": b.KD, "td": b.TD, "ti": b.TI}
    table = {
        "sample_rate": b.RATE, "gains": gains, "excitation": {"kind": "none"},
        "channels": {n: {"from": n} for n in keep},
    }  # fmt: skip
    tree = {"schema": "maglev-campaign/1", "rig": "hmb_free", "parameters": {}, "recording": _tables(table, records)}
    return Made(tree, files, load_rig("hmb_free"))
