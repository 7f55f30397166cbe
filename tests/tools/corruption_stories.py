"""What else goes wrong between a rig and its campaign.toml: wrong settings of instruments, and statements mixed up."""

import numpy as np
from corruption_campaigns import under_other_gains
from corruption_kinds import Case, Done, filtered


def other_side(c: Case) -> Done:
    """The displacement from a probe at the other side: reversed, about another mean."""
    name = str(c.rng.choice(c.of("displacement")))
    x = c.made.columns[name]
    c.made.columns[name] = 0.3 * c.made.rig.clearance - x
    return Done(name, f"{name} from the other side")


def clamp(c: Case) -> Done | None:
    """In one of two recordings, a current clamp at another range."""
    if not c.of("current"):
        return None
    name, factor = str(c.rng.choice(c.of("current"))), float(c.rng.choice([10.0, 0.1]))
    c.made.columns[name] = factor * c.made.columns[name]
    return Done(name, f"{name} x {factor:g} in one of two")


def autorange(c: Case) -> Done:
    """An instrument changes its range in the middle, and one channel goes on at another scale."""
    x = c.x.copy()
    factor = float(c.rng.choice([10.0, 0.1, 2.0]))
    x[int(x.size * c.rng.uniform(0.3, 0.7)) :] *= factor
    c.put(x)
    return Done(c.name, f"{c.name} x {factor:g} from the middle on")


def peak_to_peak(c: Case) -> Done | None:
    """The amplitude of an excitation stated as peak to peak, or as rms."""
    if not c.periodic:
        return None
    e = c.periodic[int(c.rng.integers(len(c.periodic)))]
    factor = float(c.rng.choice([2.0, 0.5, 0.4]))
    e["amplitude"] *= factor
    name = {"current": "injection"}.get(e["at"], e["at"])
    shown = any(n.partition("_")[0] == name for n in c.names)
    # Where its waveform stands in the file the amplitude is used for nothing but the comparison.
    return Done(
        name, f"amplitude of {e['at']} x {factor:g}", "" if shown or name == "injection" else "nothing shows it"
    )


def wrong_filter(c: Case) -> Done | None:
    """The filter of one channel is stated on another one."""
    if len(c.usual) < 2:
        return None
    one, other = map(str, c.rng.choice(c.usual, 2, replace=False))
    corner = float(c.rng.choice([100.0, 300.0]))
    c.made.columns[one] = filtered(c.made.columns[one], corner, c.made.table["sample_rate"])
    c.made.table["channels"][other]["filter"] = [corner]
    return Done(f"{one}|{other}", f"the filter of {one} at {corner:g} Hz stated on {other}")


def per_millimetre(c: Case) -> Done | None:
    if "gains" not in c.made.table:
        return None
    stated = c.made.table["gains"]
    for name in ("kp", "ki", "kd"):
        stated[name] /= 1000.0
    return Done("gains", "gains per mm", _unread(c))


def _unread(c: Case) -> str:
    if c.kind == "open" and not {"injection", "reference"} & set(c.names):
        return "what was injected is not recorded: it is found by these very gains"
    return ""


def ideal_gains(c: Case) -> Done | None:
    """kd given as a time constant, as the ideal form of a PID has it."""
    if "gains" not in c.made.table:
        return None
    stated = c.made.table["gains"]
    stated["kd"] /= stated["kp"]
    return Done("gains", "kd as Td", _unread(c))


def decimated(c: Case) -> Done:
    factor = int(c.rng.choice([2, 4]))
    for key, v in c.made.columns.items():
        c.made.columns[key] = v[::factor]
    for e in c.periodic:
        e.pop("periods", None)
    return Done("time", f"every {factor}th sample, the first rate stated")


def slightly(c: Case) -> Done:
    """The nearest rate of the converter, not the one that was asked for."""
    factor = float(c.rng.choice([1.024, 1.001, 0.99, 1.0001]))
    c.made.table["sample_rate"] *= factor
    for e in c.periodic:
        e.pop("periods", None)
    why = "one part in ten thousand moves nothing by a standard error" if factor == 1.0001 else ""
    return Done("time", f"rate x {factor:g}", why)


def truncated(c: Case) -> Done:
    """The file ends, or begins, in the middle of a period."""
    cut = int(c.x.size * c.rng.uniform(0.05, 0.3))
    end = c.rng.random() < 0.5
    for key, v in c.made.columns.items():
        c.made.columns[key] = v[:-cut] if end else v[cut:]
    for e in c.periodic:
        e.pop("periods", None)
    return Done("all channels", f"{'last' if end else 'first'} {cut} samples cut off", "whole periods are used")


def second_clock(c: Case) -> Done:
    """One channel by a second device, whose clock is off by 30 ppm and began some samples later."""
    t = np.arange(c.x.size) * (1 + 30e-6 * float(c.rng.choice([-1, 1]))) + float(c.rng.uniform(0, 3))
    c.put(np.interp(t, np.arange(c.x.size), c.x))
    return Done(c.name, f"{c.name} by another clock, 30 ppm off")


def ac_coupled(c: Case) -> Done:
    corner = float(c.rng.choice([1.0, 5.0, 16.0]))
    c.put(c.x - filtered(c.x, corner, c.made.table["sample_rate"]))
    return Done(c.name, f"{c.name} AC coupled at {corner:g} Hz")


def averaged(c: Case) -> Done | None:
    """An oscilloscope's mean of all periods, stored as if it had been recorded period by period."""
    if not c.periodic:
        return None
    e = c.periodic[0]
    size = round(c.made.table["sample_rate"] / e["fundamental"])
    for key, v in c.made.columns.items():
        if key != "time":
            whole = v[: v.size // size * size].reshape(-1, size)
            c.made.columns[key] = np.tile(whole[1:].mean(axis=0), len(whole))
    c.made.columns["time"] = c.made.columns["time"][: c.x.size]
    return Done("all channels", "the mean period repeated")


def doubly_inverted(c: Case) -> Done | None:
    """The sensor is inverted, and so is the command, so that the loop works."""
    signs = [*c.of("displacement"), *c.of("command")]
    if not c.of("command"):
        return None
    for name in signs:
        c.made.columns[name] = -c.made.columns[name]
    return Done("|".join(signs), "displacement and command both reversed")


def other_gains(c: Case) -> Done | None:
    """The recording of the same rig under other gains, swapped between two folders."""
    if "gains" not in c.made.table or c.kind == "open":
        return None
    columns = under_other_gains(c.made, c.rng)
    if columns is None:
        return None
    c.made.columns.update({k: v for k, v in columns.items() if k in c.made.columns})
    return Done("gains|any", "the recording of other gains of the same rig")


def hum(c: Case) -> Done:
    """Mains hum as large as the channel itself."""
    t = np.arange(c.x.size) / c.made.table["sample_rate"]
    c.put(c.x + 2 * c.x.std() * np.sin(2 * np.pi * 50.0 * t))
    return Done(c.name, f"50 Hz hum on {c.name}")


def skewed(c: Case) -> Done | None:
    """The direction of a force of two axes stated wrong."""
    found = [e for e in c.periodic if e["at"] == "force"]
    if c.kind != "x-y" or not found:
        return None
    for e in found:
        e["direction"] = e.get("direction", 0.0) + 90.0
    return Done("force|time", "direction of the force off by 90 degrees")


def integer_volts(c: Case) -> Done:
    """An 8-bit oscilloscope at its largest range."""
    step = 8 * float(np.ptp(c.x)) / 256
    c.put(np.round(c.x / step) * step)
    return Done(c.name, f"{c.name} by 8 bits of 8 times its range", "coarse steps are noise")


STORIES_OF = {
    "other side": other_side, "clamp in one": clamp, "autorange": autorange, "pp": peak_to_peak,
    "wrong filter": wrong_filter, "per mm": per_millimetre, "ideal": ideal_gains, "decimated": decimated,
    "slightly": slightly, "truncated": truncated, "clock": second_clock, "AC": ac_coupled, "averaged": averaged,
    "both signs": doubly_inverted, "other gains": other_gains, "hum": hum, "direction": skewed, "8 bits": integer_volts,
}  # fmt: skip
