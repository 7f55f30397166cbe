"""How often is a wrong recording used without a word, and a sound one accused? Corruptions of simulated campaigns.

    python tests/tools/corruptions.py --count 300 --seed 1 --out result.json [--sound | --wiring | --stories]

Each case draws a kind of campaign, a rig off by its tolerances, and one corruption (with --sound none, and in half of
the cases an effect of 1 to 100 times a small size; with --wiring another kind of wrong wiring; with --stories wrong
settings of instruments and statements). A case is silent if no
rule warns and some estimate is more than three of its standard errors from that of the sound recording. A warning is
right if it names the channel that was changed and what was done to it. The tables count by corruption and kind; every
silent case is listed with whether some redundancy covers it. Exit status 0 always: this is a measurement.
"""

import argparse
import json
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from corruption_campaigns import KINDS, Made, made
from corruption_kinds import IN_ONE, KINDS_OF, USUAL, WIRING, Case, Done, delay
from corruption_stories import STORIES_OF

from maglev_env.recordings.campaign import load_campaign
from maglev_env.redundancy.rules import examine
from maglev_workbench.commands.estimate.recordings import identify_campaign

STATES = ("warned", "harmless", "silent")
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
    "axes": ("swapped", "mismatch", "lines", "controller", "newton", "amplifier", "scale", "sign"),
    "command|current": ("swapped", "mismatch"),
    "half sign": ("scale", "sign", "mismatch", "controller", "newton"),
    "half lost": ("scale", "newton", "controller"),
    "mm in one": ("scale", "clearance", "range"),
    "bias in one": ("balance", "drift"),
    "ms": ("rate", "file"),
    "reference": ("filter", "controller", "shape", "delay", "mismatch", "scale"),
    "gain": ("scale", "sensitivity", "newton", "controller", "injection"),
    "force cell": ("scale", "sign", "newton", "designed"),
    "volts": ("scale", "clearance", "range"),
    "one coil": ("scale", "balance", "amplifier", "newton"),
    "other side": ("sign", "scale", "clearance", "range", "newton"),
    "clamp in one": ("scale", "amplifier", "newton", "range"),
    "autorange": ("range change", "period", "drift", "scale", "missing samples", "balance", "clearance"),
    "pp": ("scale", "designed", "newton"),
    "wrong filter": ("filter", "shape", "delay", "scale", "newton", "amplifier", "controller", "mismatch"),
    "per mm": ("controller", "gains", "scale", "mismatch"),
    "ideal": ("controller", "gains", "scale", "mismatch"),
    "decimated": ("lines", "rate", "file", "mismatch"),
    "slightly": ("lines", "rate", "file", "mismatch"),
    "truncated": ("file", "samples"),
    "clock": ("delay", "clock", "period", "missing samples", "amplifier", "controller", "newton"),
    "AC": ("filter", "shape", "controller", "amplifier", "newton", "scale", "delay"),
    "averaged": ("repeated", "samples", "period"),
    "both signs": ("sign", "scale", "newton", "amplifier"),
    "other gains": ("gains", "controller", "scale", "mismatch"),
    "hum": ("period", "spike", "lines", "file", "scale", "hum"),
    "direction": ("lines", "mismatch", "sign", "scale", "designed"),
    "8 bits": ("resolution", "scale"),
}
RIGHT = {**RIGHT, "mixed": RIGHT["file"]}


def corrupt(m: Made, kind: str, what: str, rng: np.random.Generator) -> Done | None:
    """Apply one corruption; None if it has no meaning here."""
    case = Case(m, kind, "", rng)
    case = Case(m, kind, str(rng.choice(case.usual)), rng)
    word, _, number = what.partition(" ")
    return delay(case, int(number)) if word == "delay" else {**KINDS_OF, **STORIES_OF}[what](case)


def right(done: Done, what: str, found: list) -> tuple[bool, bool]:
    """Whether a warning names the channel, and whether it names channel and cause."""
    codes = RIGHT[what if what in RIGHT else what.split()[0]]
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


def warned(folder: Path, done: Done, what: str) -> tuple[list[tuple[str, str, str]], bool]:
    """Warnings of a campaign as (code, channel, message), and whether what was changed is named as not checkable.

    A refusal on reading counts as a warning. That a time or coupling is not checkable counts for what is late,
    filtered or coupled alone.
    """
    try:
        found = examine(load_campaign(folder))
    except (ValueError, OSError) as error:
        return [("file", _quoted(str(error)), str(error))], False
    names = [name for f in found if f.kind == "not checkable" for name in f.channel.split(" or ")]
    of = {"time": ("delay", "filter"), "AC": "AC"}
    noted = " ".join(name for name in names if what.startswith(of.get(name.split()[0], "")))
    changed = [name.partition("_")[0] for name in done.channel.split("|")]
    return [(f.code, f.channel, f.message) for f in found if f.kind != "not checkable"], any(
        c in noted for c in changed
    )


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
        found = identify_campaign(campaign, False, None, None, iter)
    except (ValueError, OSError, np.linalg.LinAlgError):
        return None
    result = {}
    for axis, one in found.axes:
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


def one_case(number: int, seed: int, sound: bool, drawn: tuple[str, ...], folder: Path) -> dict[str, Any] | None:
    """Make, corrupt and examine one case, by one of the drawn corruptions."""
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
    for _ in range(20):
        what = str(rng.choice(drawn))
        m, source, _ = made(kind, rng, records=2 if what in IN_ONE else 1)
        clean = m.copy()
        done = corrupt(m, kind, what, rng)
        if done is not None:
            break
    else:
        return None  # none of the drawn corruptions has a meaning for this kind
    m.write(folder / "c")
    found, noted = warned(folder / "c", done, what)
    why = done.uncovered or ("named as not checkable" if noted and not found else "")
    case = {"number": number, "kind": kind, "rig": source, "what": what, "done": done.words,
            "uncovered": why, "warned": found[:4]}  # fmt: skip
    if found:
        case["channel"], case["cause"] = right(done, what, found)
        return case
    clean.write(folder / "s")
    case["wrong"] = wrong(estimates(folder / "s"), estimates(folder / "c"))
    return case


def markdown(cases: list[dict[str, Any]]) -> str:
    """The counts as the table of docs/recordings.md: warned / harmless / silent, "-" where nothing was drawn."""
    lines = [f"| corruption | {' | '.join(KINDS)} |", "|---|" + "---|" * len(KINDS)]
    for what, by in sorted(_counted(cases).items()):
        cells = ["/".join(str(by[k][s]) for s in STATES) if by[k] else "-" for k in KINDS]
        lines.append(f"| {what} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _counted(cases: list[dict[str, Any]]) -> dict[str, dict[str, Counter]]:
    """How many cases were warned of, harmless and silent, by corruption and kind of campaign."""
    grouped: dict[str, dict[str, Counter]] = defaultdict(lambda: defaultdict(Counter))
    for c in cases:
        state = "warned" if c["warned"] else "silent" if c["wrong"] else "harmless"
        grouped[c["what"]][c["kind"]][state] += 1
    return grouped


def table(cases: list[dict[str, Any]]) -> str:
    """Counts by corruption and kind of campaign, then every silent case."""
    lines = [f"{'corruption':<15} " + " ".join(f"{k:>14}" for k in KINDS) + f"   {'/'.join(STATES)}"]
    for what, by in sorted(_counted(cases).items()):
        cells = ["/".join(str(by[k][s]) for s in STATES) for k in KINDS]
        lines.append(f"{what:<15} " + " ".join(f"{c:>14}" for c in cells))
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
    parser.add_argument("--wiring", action="store_true", help="the other kinds of wrong wiring")
    parser.add_argument("--stories", action="store_true", help="wrong settings of instruments and statements")
    parser.add_argument("--kind", choices=(*USUAL, *WIRING, *STORIES_OF), help="one corruption alone")
    parser.add_argument("--out", type=Path, help="JSON of all cases, written as they come")
    parser.add_argument(
        "--markdown", type=Path, nargs="+", help="run nothing; the table of docs/recordings.md from these"
    )
    options = parser.parse_args()
    if options.markdown:
        cases = [case for path in options.markdown for case in json.loads(path.read_text())]
        print(markdown(cases), table(cases), sep="\n\n")
        return
    drawn = (
        (options.kind,)
        if options.kind
        else WIRING
        if options.wiring
        else tuple(STORIES_OF)
        if options.stories
        else USUAL
    )
    cases, begun = [], time.monotonic()
    for number in range(options.first, options.first + options.count):
        with tempfile.TemporaryDirectory() as folder:
            case = one_case(number, options.seed, options.sound, drawn, Path(folder))
            cases += [] if case is None else [case]
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
