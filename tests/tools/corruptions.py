"""How often is a wrong recording used without a word, and a sound one accused? Corruptions of simulated campaigns.

    python tests/tools/corruptions.py --count 300 --seed 1 --out result.json [--sound]

Each case draws a kind of campaign, a rig off by its tolerances, and one corruption (or, with --sound, none, and in half
of the cases an effect of 1 to 100 times a small size). A case is silent if no rule warns and some estimate is more than
three of its standard errors from that of the sound recording. A warning is right if it names the channel that was
changed and what was done to it. The tables count by corruption and kind; every silent case is listed with whether some
redundancy covers it. Exit status 0 always: this is a measurement.
"""

import argparse
import json
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1] / "models"))
import bench_loop

from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import excitation_table, toml_value
from maglev_env.recordings.recording import simulated_recording
from maglev_env.redundancy.rules import examine
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import Rig, load_rig, with_parameters
from maglev_workbench.commands.estimate.recordings import identify_campaign
from sim2real.blind.menu import EFFECTS as MENU

KINDS = ("named", "mass only", "current only", "open", "x-y")
FACTORS = (2.0, 9.81, 1000.0, 0.5)
CORRUPTIONS = (
    *("scale", "scale", "scale", "sign", "delay 1", "delay 10", "dropped", "filter", "rate", "mass", "gains"),
    *("file", "swapped", "clipped", "offset", "drift"),
)
RIGS = {
    "named": ("hmb_free", "eframe", "pedestal", "wide"),
    "mass only": ("hmb_free", "eframe", "pedestal", "hmb_axial", "wide"),
    "current only": ("hmb_free", "eframe", "wide"),
    "open": ("bench",),
    "x-y": ("hmb_radial",),
}
# What a right answer may be called, and on which channel, where it is not the changed one.
RIGHT: Mapping[str, tuple[str, ...]] = {
    "scale": ("scale", "clearance", "sensitivity", "newton", "designed", "controller"),
    "sign": ("sign", "scale", "newton"),
    "delay": ("delay", "scale", "newton", "controller", "amplifier"),
    "dropped": ("missing samples", "samples", "period", "file"),
    "filter": ("filter", "shape", "delay", "scale", "newton", "amplifier", "controller"),
    "rate": ("rate", "lines", "file"),
    "mass": ("scale", "newton", "mismatch"),
    "gains": ("gains", "controller", "scale"),
    "file": ("mismatch", "lines", "file", "clearance", "controller", "scale", "gains", "newton", "amplifier", "delay"),
    "swapped": ("swapped", "clearance"),
    "clipped": ("rail", "file"),
    "offset": ("clearance", "drift", "balance"),
    "drift": ("drift", "period", "clearance"),
}


@dataclass
class Made:
    """A campaign in memory: the tree of its campaign.toml, and the columns of its one file."""

    tree: dict[str, Any]
    columns: dict[str, np.ndarray]
    period: int
    rig: Rig | None

    def copy(self) -> "Made":
        tree = json.loads(json.dumps(self.tree))
        return Made(tree, {k: v.copy() for k, v in self.columns.items()}, self.period, self.rig)

    def write(self, folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(folder / "run.npz", **self.columns)
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
            return effect(name, **values)
        except ValueError:
            continue


def made(kind: str, rng: np.random.Generator, effected: bool) -> tuple[Made, str, str]:
    """A sound campaign of a kind, the name of its rig and of its effect."""
    source = str(rng.choice(RIGS[kind]))
    if kind == "open":
        return open_campaign(rng, effected), source, "bench" if effected else ""
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
        record = simulate_records([replace(noisy, periods=e.periods + 1)])[0]
        if np.isfinite(record).all():
            break
    else:
        raise RuntimeError(f"no draw of {source} levitates")
    dataset = simulated_recording(replace(noisy, periods=e.periods + 1), record)
    columns = {"time": dataset["time"].values, **{str(n): dataset[n].values for n in dataset.data_vars}}
    period = e.samples_per_period
    periods = e.periods + 1
    tables = [{**excitation_table(x), "periods": periods} for x in e.excitations]
    keep = {
        "mass only": ["force", "displacement"],
        "current only": ["displacement", "current"],
    }.get(kind, [n for n in columns if n != "time"])
    if rng.random() < 0.3 and kind == "named":
        keep = [n for n in keep if n != "current"]
    table = {
        "file": "run.npz", "role": "fit", "sample_rate": rig.control_rate, "intersample": "zoh",
        **({} if kind == "mass only" or not rig.controlled else {"gains": vars(gains)}),
        "excitation": [t for t in tables if kind != "mass only" or t["at"] == "force"],
        "channels": {n: {"from": n} for n in keep},
    }  # fmt: skip
    tree: dict[str, Any] = {"schema": "maglev-campaign/1"}
    if kind != "mass only":
        tree["rig"] = rig.name
    tree["parameters"] = {"mass": rig.mass}
    tree["recording"] = [table]
    return Made(tree, columns, period, rig), source, next(iter(extra), "")


def open_campaign(rng: np.random.Generator, effected: bool) -> Made:
    """Noise or steps on a bench of another hand; half of the files hold what was injected."""
    bench = bench_loop.Bench(gain=0.05 * rng.standard_normal(), stiffness=0.1 * rng.standard_normal(), noise=0.5e-6)
    if effected:
        which = rng.integers(3)
        size = float(np.exp(rng.uniform(0, np.log(50.0))))
        bench = replace(bench, **[{"delay": 2e-6 * size}, {"gain": 0.01 * size}, {"stiffness": 0.01 * size}][which])
    kind, seconds, seed = str(rng.choice(["noise", "steps", "chirp"])), 2.0, int(rng.integers(2**31))
    columns = bench_loop.record(bench, kind, seconds, seed)
    injection, reference = bench_loop.excitation(kind, seconds, np.random.default_rng(seed))
    columns = {"time": np.arange(injection.size) / bench_loop.RATE, **columns}
    keep = ["displacement", "command", "current"]
    if rng.random() < 0.5:
        name = "reference" if kind == "steps" else "injection"
        columns[name] = reference if kind == "steps" else injection
        keep.append(name)
    b = bench_loop
    gains = {"kp": b.KP, "ki": b.KI, "kd": b.KD, "td": b.TD, "ti": b.TI}
    table = {
        "file": "run.npz", "sample_rate": b.RATE, "gains": gains, "excitation": {"kind": "none"},
        "channels": {n: {"from": n} for n in keep},
    }  # fmt: skip
    tree = {"schema": "maglev-campaign/1", "rig": "hmb_free", "parameters": {}, "recording": [table]}
    return Made(tree, columns, 20_000, load_rig("hmb_free"))


@dataclass(frozen=True)
class Done:
    """What was done to a campaign: the channel, in words, and whether some redundancy covers it (or why none does)."""

    channel: str
    words: str
    uncovered: str = ""


def corrupt(m: Made, kind: str, what: str, rng: np.random.Generator) -> Done | None:
    """Apply one corruption; None if it has no meaning here."""
    table, columns = m.tree["recording"][0], m.columns
    names = [n for n in table["channels"] if n in columns]
    usual = [n for n in names if n.partition("_")[0] in ("force", "displacement", "command", "current", "injection")]
    name = str(rng.choice(usual))
    x = columns[name]
    if what == "scale":
        factor = float(rng.choice(FACTORS))
        columns[name] = x * factor
        return Done(name, f"{name} x {factor:g}")
    if what == "sign":
        columns[name] = -x
        return Done(name, f"-{name}")
    if what.startswith("delay"):
        k = int(what.split()[1])
        columns[name] = np.concatenate([np.full(k, x[0]), x[:-k]])
        late = ""
        if kind == "mass only":
            late = "no controller or rig is known that a delay could contradict"
        if kind == "current only" and k == 1:
            late = "one sample is within the tolerance of the nominal loop"
        return Done(name, f"{name} late by {k}", late)
    if what == "dropped":
        length, n = int(rng.integers(10, 500)), x.size
        at = int(rng.integers(n // 5, 4 * n // 5))
        for key, v in columns.items():
            columns[key] = np.delete(v, slice(at, at + length))
        if rng.random() < 0.3:
            table["channels"]["time"] = {"from": "time"}
        for e in table["excitation"] if isinstance(table["excitation"], list) else []:
            e["periods"] -= 1
        return Done("all channels", f"{length} samples dropped at {at}")
    if what == "filter":
        rate = table["sample_rate"]
        corner = float(rng.choice([30.0, 100.0, 300.0]))
        a = np.exp(-2 * np.pi * corner / rate)
        columns[name] = lfilter([1 - a], [1, -a], x - x[0]) + x[0]
        why = "a low-pass of one channel looks like another mass and damping" if kind == "mass only" else ""
        return Done(name, f"{name} low-passed at {corner:g} Hz", why)
    if what == "rate":
        factor = float(rng.choice([2.0, 0.5, 1.1]))
        table["sample_rate"] *= factor
        if rng.random() < 0.3:
            table["channels"]["time"] = {"from": "time"}
        if isinstance(table["excitation"], list):
            for e in table["excitation"]:
                e["periods"] = max(2, int(e["periods"] / factor))
        return Done("time", f"rate x {factor:g}")
    if what == "mass":
        factor = float(rng.choice([2.0, 0.5, 9.81, 1000.0]))
        m.tree["parameters"]["mass"] = m.rig.mass * factor
        return Done("mass", f"mass x {factor:g}")
    if what == "gains":
        if "gains" not in table:
            return None
        f = rng.choice([0.7, 0.8, 1.25, 1.5], 2)
        gains = table["gains"]
        gains |= {"kp": gains["kp"] * float(f[0]), "kd": gains["kd"] * float(f[1])}
        why = "nothing is recorded that the controller makes" if "command" not in names and kind == "open" else ""
        if kind == "open" and not {"injection", "reference"} & set(names):
            why = "what was injected is not recorded: it is found by these very gains"
        return Done("gains", f"kp x {f[0]}, kd x {f[1]}", why)
    if what == "file":
        for _ in range(20):
            other, source, _ = made("x-y" if kind == "x-y" else "named", rng, False)
            if other.rig.name != m.rig.name and set(names) - {"reference", "injection"} <= set(other.columns):
                break
            if kind == "x-y":
                return None
        else:
            return None
        size = min(x.size, other.columns["time"].size)
        m.columns.clear()
        m.columns |= {k: v[:size] for k, v in other.columns.items()}
        for n in names:
            m.columns.setdefault(n, np.zeros(size))
        for e in table["excitation"] if isinstance(table["excitation"], list) else []:
            e.pop("periods", None)
        return Done("any", f"file of {source}")
    if what == "swapped":
        one, other = map(str, rng.choice(usual, 2, replace=False))
        columns[one], columns[other] = columns[other], columns[one]
        return Done(f"{one}|{other}", f"{one} and {other} swapped")
    if what == "clipped":
        level = 0.6 * float(np.abs(x - x.mean()).max())
        columns[name] = np.clip(x, x.mean() - level, x.mean() + level)
        why = "an injection is a stored sequence, of which rails say nothing" if name == "injection" else ""
        return Done(name, f"{name} clipped at 60 %", why)
    if what == "offset":
        columns[name] = x + 3 * x.std()
        return Done(name, f"{name} + 3 rms")
    columns[name] = x + np.linspace(0, float(rng.uniform(1, 5)) * x.std(), x.size)
    return Done(name, f"{name} drifts")


def right(done: Done, what: str, found: list) -> tuple[bool, bool]:
    """Whether a warning names the channel, and whether it names channel and cause."""
    codes = RIGHT[what.split()[0]]
    named = caused = False
    for code, channel, message in found:
        parts = {p.split("_")[0] for p in channel.replace(" or ", "|").split("|")}
        wanted = {p.split("_")[0] for p in done.channel.split("|")}
        hit = (
            done.channel in ("any", "time")
            or (code == "samples" and done.channel == "all channels")
            or bool(parts & wanted)
            or "all channels" in channel
        )
        hit = hit or (any(w in message for w in wanted) and code == "file")
        named |= hit
        caused |= hit and any(code.startswith(c) for c in codes)
    return named, caused


def warned(folder: Path) -> list[tuple[str, str, str]]:
    """Warnings of a campaign as (code, channel, message); a refusal on reading counts as one."""
    try:
        found = examine(load_campaign(folder))
    except (ValueError, OSError) as error:
        return [("file", _quoted(str(error)), str(error))]
    return [(f.code, f.channel, f.message) for f in found if f.kind != "not checkable"]


def _quoted(text: str) -> str:
    """What a refusal is about."""
    for name in ("displacement", "force", "command", "current", "injection", "mass"):
        if name in text:
            return name
    return "all channels"


def estimates(folder: Path) -> dict[str, tuple[float, float]] | None:
    """Value and standard error of all that `maglev estimate` bounds; None where it refuses."""
    try:
        campaign = load_campaign(folder)
        found = identify_campaign(campaign, campaign.mass, False, None, None, iter)
    except (ValueError, OSError, np.linalg.LinAlgError):
        return None
    result = {}
    for file, one in found.axes:
        axis = file.partition(", ")[2]
        for i, b in enumerate(one.bands):
            if b.informative:
                result[f"{axis} k {i}"], result[f"{axis} c {i}"] = (
                    (b.stiffness, b.stiffness_se),
                    (b.damping, b.damping_se),
                )
        if one.stability and (ci := one.stability.margins.intervals.get("peak_sensitivity")) and None not in ci:
            result[f"{axis} Ms"] = one.stability.margins.peak_sensitivity, (ci[1] - ci[0]) / 3.92
    for c in found.pooled.coefficients if found.pooled else ():
        if c.bounded:
            result[c.name] = c.value, c.se
    return result


def wrong(sound: dict[str, tuple[float, float]] | None, used: dict[str, tuple[float, float]] | None) -> str:
    """The worst estimate that is more than three of its standard errors, and one per cent, off; empty if none is."""
    worst, name = 3.0, ""
    for key, (value, se) in (used or {}).items():
        if sound and key in sound:
            true, error = sound[key]
            off = abs(value - true)
            if off > 0.01 * abs(true) and off > worst * max(se, 1e-12) and off > 3 * error:
                worst, name = off / max(se, 1e-12), f"{key}: {value:.4g} for {true:.4g}, {off / max(se, 1e-12):.3g} se"
    return name


def one_case(number: int, seed: int, sound: bool, folder: Path) -> dict[str, Any]:
    """Make, corrupt and examine one case."""
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    if sound:
        m, source, extra = made(kind, rng, bool(rng.random() < 0.5))
        m.write(folder / "s")
        campaign = load_campaign(folder / "s")
        try:
            found = [f for f in examine(campaign) if f.kind != "not checkable"]
            said = [(f.kind, f.code, f.channel, f.message) for f in found]
        except ValueError as error:
            said = [("contradiction", "file", "", str(error))]
        accused = [s for s in said if s[0] != "effect" and not (extra and s[0] == "quality")] if extra else said
        return {"number": number, "kind": kind, "rig": source, "effect": extra, "false": bool(accused), "said": said}
    while True:
        m, source, _ = made(kind, rng, False)
        clean = m.copy()
        what = CORRUPTIONS[int(rng.integers(len(CORRUPTIONS)))]
        done = corrupt(m, kind, what, rng)
        if done is not None:
            break
    m.write(folder / "c")
    found = warned(folder / "c")
    case = {"number": number, "kind": kind, "rig": source, "what": what, "done": done.words,
            "uncovered": done.uncovered, "warned": found[:4]}  # fmt: skip
    if found:
        case["channel"], case["cause"] = right(done, what, found)
        return case
    clean.write(folder / "s")
    case["wrong"] = wrong(estimates(folder / "s"), estimates(folder / "c"))
    return case


def table(cases: list[dict[str, Any]]) -> str:
    """Counts by corruption and kind of campaign, then every silent case."""
    lines = [f"{'corruption':<10} " + " ".join(f"{k:>14}" for k in KINDS) + "   warned/harmless/silent"]
    grouped: dict[str, dict[str, Counter]] = defaultdict(lambda: defaultdict(Counter))
    for c in cases:
        state = "warned" if c["warned"] else "silent" if c["wrong"] else "harmless"
        grouped[c["what"]][c["kind"]][state] += 1
    for what, by in sorted(grouped.items()):
        cells = ["/".join(str(by[k][s]) for s in ("warned", "harmless", "silent")) for k in KINDS]
        lines.append(f"{what:<10} " + " ".join(f"{c:>14}" for c in cells))
    silent = [c for c in cases if not c["warned"] and c["wrong"]]
    covered = [c for c in cases if not c["uncovered"]]
    missed = [c for c in silent if not c["uncovered"]]
    alarms = [c for c in cases if c["warned"]]
    lines += [
        f"cases {len(cases)}, covered {len(covered)}, silent {len(silent)}, of the covered {len(missed)} "
        f"({len(missed) / max(len(covered), 1):.2%})",
        f"alarms {len(alarms)}: channel right {np.mean([c['channel'] for c in alarms]):.1%}, channel and cause right "
        f"{np.mean([c['cause'] for c in alarms]):.1%}",
    ]
    lines += [f"silent: {c['number']} {c['kind']}, {c['rig']}: {c['done']}: {c['wrong']}; {c['uncovered'] or 'COVERED'}"
              for c in silent]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Run the cases and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sound", action="store_true", help="sound recordings: false alarms")
    parser.add_argument("--out", type=Path, help="JSON of all cases, written as they come")
    options = parser.parse_args()
    cases, begun = [], time.monotonic()
    for number in range(options.first, options.first + options.count):
        with tempfile.TemporaryDirectory() as folder:
            cases.append(one_case(number, options.seed, options.sound, Path(folder)))
        if options.out and (number % 10 == 9 or number == options.first + options.count - 1):
            options.out.write_text(json.dumps(cases, indent=1, default=str))
    print(f"{time.monotonic() - begun:.0f} s")
    if not options.sound:
        print(table(cases))
        return
    for which in ("", "with an effect"):
        some = [c for c in cases if bool(c["effect"]) == bool(which)]
        print(f"sound {which}: {len(some)}, false alarms {sum(c['false'] for c in some)}")
    for c in cases:
        if c["false"]:
            print(c["number"], c["kind"], c["rig"], c["effect"], c["said"][:3])


if __name__ == "__main__":
    main()
