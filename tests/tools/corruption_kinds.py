"""What `corruptions.py` does to a campaign: wrong scales, signs, times and files, and wrong wiring of other kinds."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from corruption_campaigns import Made, made
from scipy.signal import lfilter

FACTORS = (2.0, 9.81, 1000.0, 0.5)
CHANNELS = ("force", "displacement", "command", "current", "injection")


@dataclass(frozen=True)
class Done:
    """What was done to a campaign: the channel, in words, and whether some redundancy covers it (or why none does)."""

    channel: str
    words: str
    uncovered: str = ""


@dataclass(frozen=True)
class Case:
    """What a corruption works on: its kind of campaign, one drawn channel, and the generator."""

    made: Made
    kind: str
    name: str
    rng: np.random.Generator

    @property
    def names(self) -> list[str]:
        """Columns that the campaign names."""
        return [n for n in self.made.table["channels"] if n in self.made.columns]

    @property
    def usual(self) -> list[str]:
        return [n for n in self.names if n.partition("_")[0] in CHANNELS]

    @property
    def periodic(self) -> list[dict]:
        """Tables of the excitations, where something repeats."""
        stated = self.made.table["excitation"]
        return stated if isinstance(stated, list) else []

    @property
    def x(self) -> np.ndarray:
        return self.made.columns[self.name]

    def put(self, values: np.ndarray) -> None:
        self.made.columns[self.name] = values

    def of(self, quantity: str) -> list[str]:
        """Columns of a quantity, of both axes where there are two."""
        return [n for n in self.usual if n.partition("_")[0] == quantity]


def scale(c: Case) -> Done:
    factor = float(c.rng.choice(FACTORS))
    c.put(c.x * factor)
    return Done(c.name, f"{c.name} x {factor:g}")


def sign(c: Case) -> Done:
    c.put(-c.x)
    return Done(c.name, f"-{c.name}")


def delay(c: Case, k: int) -> Done:
    c.put(np.concatenate([c.x[k:0:-1], c.x[:-k]]))  # a constant would be a stuck reading
    late = ""
    if c.kind in ("mass only", "current only") and k == 1:
        late = "one sample is within the tolerance of the loop"
    return Done(c.name, f"{c.name} late by {k}", late)


def dropped(c: Case) -> Done:
    length, n = int(c.rng.integers(10, 500)), c.x.size
    at = int(c.rng.integers(n // 5, 4 * n // 5))
    for key, v in c.made.columns.items():
        c.made.columns[key] = np.delete(v, slice(at, at + length))
    if c.rng.random() < 0.3:
        c.made.table["channels"]["time"] = {"from": "time"}
    for e in c.periodic:
        e["periods"] -= 1
    return Done("all channels", f"{length} samples dropped at {at}")


def low_passed(c: Case) -> Done:
    corner = float(c.rng.choice([30.0, 100.0, 300.0]))
    c.put(filtered(c.x, corner, c.made.table["sample_rate"]))
    return Done(c.name, f"{c.name} low-passed at {corner:g} Hz")


def filtered(x: np.ndarray, corner: float, rate: float) -> np.ndarray:
    a = np.exp(-2 * np.pi * corner / rate)
    return lfilter([1 - a], [1, -a], x - x[0]) + x[0]


def rate(c: Case) -> Done:
    factor = float(c.rng.choice([2.0, 0.5, 1.1]))
    c.made.table["sample_rate"] *= factor
    if c.rng.random() < 0.3:
        c.made.table["channels"]["time"] = {"from": "time"}
    for e in c.periodic:
        e["periods"] = max(2, int(e["periods"] / factor))
    return Done("time", f"rate x {factor:g}")


def mass(c: Case) -> Done:
    factor = float(c.rng.choice([2.0, 0.5, 9.81, 1000.0]))
    c.made.tree["parameters"]["mass"] = c.made.rig.mass * factor
    return Done("mass", f"mass x {factor:g}")


def gains(c: Case) -> Done | None:
    if "gains" not in c.made.table:
        return None
    f = c.rng.choice([0.7, 0.8, 1.25, 1.5], 2)
    stated = c.made.table["gains"]
    stated |= {"kp": stated["kp"] * float(f[0]), "kd": stated["kd"] * float(f[1])}
    why = "nothing is recorded that the controller makes" if "command" not in c.names and c.kind == "open" else ""
    if c.kind == "open" and not {"injection", "reference"} & set(c.names):
        why = "what was injected is not recorded: it is found by these very gains"
    return Done("gains", f"kp x {f[0]}, kd x {f[1]}", why)


def file(c: Case) -> Done | None:
    """The file of another rig, with as many samples."""
    for _ in range(20):
        other, source, _ = made("x-y" if c.kind == "x-y" else "named", c.rng)
        if other.rig.name != c.made.rig.name and set(c.names) - {"reference", "injection"} <= set(other.columns):
            break
        if c.kind == "x-y":
            return None
    else:
        return None
    size = min(c.x.size, other.columns["time"].size)
    names = c.names
    c.made.columns.clear()
    c.made.columns.update({k: v[:size] for k, v in other.columns.items()})
    for n in names:
        c.made.columns.setdefault(n, np.zeros(size))
    for e in c.periodic:
        e.pop("periods", None)
    return Done("any", f"file of {source}")


def swapped(c: Case) -> Done:
    one, other = map(str, c.rng.choice(c.usual, 2, replace=False))
    return exchange(c, [(one, other)])


def exchange(c: Case, pairs: list[tuple[str, str]]) -> Done:
    columns = c.made.columns
    for one, other in pairs:
        columns[one], columns[other] = columns[other], columns[one]
    return Done("|".join(n for pair in pairs for n in pair), f"{' and '.join('/'.join(p) for p in pairs)} swapped")


def clipped(c: Case) -> Done:
    level = 0.6 * float(np.abs(c.x - c.x.mean()).max())
    c.put(np.clip(c.x, c.x.mean() - level, c.x.mean() + level))
    why = "an injection is a stored sequence, of which rails say nothing" if c.name == "injection" else ""
    return Done(c.name, f"{c.name} clipped at 60 %", why)


def offset(c: Case) -> Done:
    c.put(c.x + 3 * c.x.std())
    return Done(c.name, f"{c.name} + 3 rms")


def drift(c: Case) -> Done:
    c.put(c.x + np.linspace(0, float(c.rng.uniform(1, 5)) * c.x.std(), c.x.size))
    return Done(c.name, f"{c.name} drifts")


# What else an engineer can plug in wrongly.


def axes(c: Case) -> Done | None:
    """One quantity, or all of them, of x and y exchanged."""
    both = [q for q in CHANNELS if len(c.of(q)) == 2]
    if not both:
        return None
    chosen = both if c.rng.random() < 0.5 else [str(c.rng.choice(both))]
    done = exchange(c, [(f"{q}_x", f"{q}_y") for q in chosen])
    return Done(done.channel, done.words, "" if len(chosen) < len(both) else "the axes of this rig are alike")


def command_current(c: Case) -> Done | None:
    pairs = list(zip(c.of("command"), c.of("current"), strict=False))
    return exchange(c, pairs[:1]) if pairs else None


def half(c: Case) -> Done:
    """A differential sensor of which one half has the wrong sign: its halves cancel but for 2 % and their noise."""
    name = str(c.rng.choice(c.of("displacement")))
    x = c.made.columns[name]
    noise = c.made.rig.noise.displacement * c.rng.standard_normal(x.size) / np.sqrt(2)
    c.made.columns[name] = 0.02 * x + noise
    return Done(name, f"one half of {name} reversed")


def one_half(c: Case) -> Done:
    """A differential sensor of which one half is not connected."""
    name = str(c.rng.choice(c.of("displacement")))
    c.made.columns[name] = 0.5 * c.made.columns[name]
    return Done(name, f"one half of {name} not connected")


def millimetres(c: Case) -> Done:
    """In one of two recordings, mm where um are stated, or the other way round."""
    factor = float(c.rng.choice([1e-3, 1e3]))
    for name in c.of("displacement"):
        c.made.columns[name] = factor * c.made.columns[name]
    return Done("displacement", f"displacement x {factor:g} in one of two")


def bias(c: Case) -> Done | None:
    """In one of two recordings, the currents with the bias that others leave out."""
    found = [*c.of("current"), *(c.of("command") if c.rng.random() < 0.5 else [])]
    size = getattr(c.made.rig, "bias_current", 0.0)
    if not found or not size:
        return None
    for name in found:
        c.made.columns[name] = c.made.columns[name] + size
    why = "" if c.kind == "open" else "means are not used where something repeats"
    return Done("|".join(found), f"bias of {size:g} A in {', '.join(found)}, in one of two", why)


def milliseconds(c: Case) -> Done:
    c.made.table["channels"]["time"] = {"from": "time"}
    c.made.columns["time"] = 1e3 * c.made.columns["time"]
    return Done("time", "time in ms")


def mixed(c: Case) -> Done | None:
    """One of two recordings is another rig's."""
    return file(c)


def reference_filtered(c: Case) -> Done | None:
    if "reference" not in c.names:
        return None
    corner = float(c.rng.choice([10.0, 30.0, 100.0]))
    c.made.columns["reference"] = filtered(c.made.columns["reference"], corner, c.made.table["sample_rate"])
    return Done("reference", f"reference recorded behind its filter of {corner:g} Hz")


def before_gain(c: Case) -> Done | None:
    """The injection recorded, and its amplitude stated, before a gain."""
    gain = float(c.rng.choice([2.0, 5.0, 0.5]))
    stated = [e for e in c.periodic if e["at"] == "current"]
    if not c.of("injection") and not stated:
        return None
    for name in c.of("injection"):
        c.made.columns[name] = c.made.columns[name] / gain
    for e in stated:
        e["amplitude"] /= gain
    return Done("injection", f"injection before a gain of {gain:g}")


def force_cell(c: Case) -> Done | None:
    """A force sensor of wrong polarity and factor, by which the stated amplitude was set too, or not."""
    if not c.of("force"):
        return None
    factor = -float(c.rng.choice([2.0, 4.448, 9.81, 0.5]))
    both = c.rng.random() < 0.5
    for name in c.of("force"):
        c.made.columns[name] = factor * c.made.columns[name]
    for e in c.periodic:
        if both and e["at"] == "force":
            e["amplitude"] *= -factor
    return Done("|".join(c.of("force")), f"force x {factor:g}{', its amplitude too' if both else ''}")


def volts(c: Case) -> Done:
    """The displacement as the probe's voltage, its gain forgotten."""
    name = str(c.rng.choice(c.of("displacement")))
    c.made.columns[name] = c.made.rig.probe_gain * c.made.columns[name]
    return Done(name, f"{name} in V")


def one_coil(c: Case) -> Done | None:
    """The current of one coil of a pair, which holds its bias."""
    found = c.of("current")
    if not found or not c.made.rig.controlled:
        return None
    name = str(c.rng.choice(found))
    c.made.columns[name] = 0.5 * c.made.columns[name] + getattr(c.made.rig, "bias_current", 0.0)
    return Done(name, f"{name} of one coil")


KINDS_OF: dict[str, Callable[[Case], Done | None]] = {
    "scale": scale, "sign": sign, "dropped": dropped, "filter": low_passed, "rate": rate, "mass": mass, "gains": gains,
    "file": file, "swapped": swapped, "clipped": clipped, "offset": offset, "drift": drift, "axes": axes,
    "command|current": command_current, "half sign": half, "half lost": one_half, "mm in one": millimetres,
    "bias in one": bias, "ms": milliseconds, "mixed": mixed, "reference": reference_filtered, "gain": before_gain,
    "force cell": force_cell, "volts": volts, "one coil": one_coil,
}  # fmt: skip
USUAL = (
    *("scale", "scale", "scale", "sign", "delay 1", "delay 10", "dropped", "filter", "rate", "mass", "gains"),
    *("file", "swapped", "clipped", "offset", "drift"),
)
WIRING = tuple(KINDS_OF)[tuple(KINDS_OF).index("axes") :]
IN_ONE = ("mm in one", "bias in one", "mixed", "clamp in one")  # of two recordings
