"""Write campaigns of five benches of another hand, with truth.json beside each.

    python tests/tools/rigs_of_another_hand/make.py OUT [--variant A B-rest ...] [--effect none ...] [--seed 1]

OUT/A-none holds data files, rig.toml, campaign.toml and truth.json of bench A without an effect, and so on. A variant
is a bench with what its engineer states of it: `free` leaves the controller out, so the current drives; `rest` states
total current and offsets too, so that means and weight count. Then run `table.py OUT`.
"""

import argparse
from dataclasses import dataclass, field, replace
from pathlib import Path

from rigs import EFFECTS, RIGS, Rig
from write import run_all, write_campaign

METER_A = {"filter": [79.577], "delay": -1e-3, "delay_tolerance": 5e-5, "scale_tolerance": 0.01}  # 2 ms, a tick late
NOISES = ("noise1", "noise2", "noise3", "noise4")
METER_D = {"filter": [1591.55], "delay_tolerance": 5e-6, "scale_tolerance": 0.01}
LAID = {"offset_tolerance": 2e-5}  # m


@dataclass(frozen=True)
class Variant:
    """Channels that the engineer maps, whether the controller is stated, keys of channels, and records (all: ())."""

    use: tuple[str, ...]
    gains: bool = True
    chain: dict[str, dict] = field(default_factory=dict)
    only: tuple[str, ...] = ()

    def of(self, rig: Rig) -> Rig:
        records = [r for r in rig.records if r.name in self.only or not self.only]
        return replace(rig, records=records, chain=self.chain)


VARIANTS = {
    "A": Variant(("displacement", "command", "reference")),
    "A3": Variant(("displacement", "command", "reference"), only=("steps", "chirp", "sine", "last")),
    "A-current": Variant(("displacement", "command", "reference", "current"), chain={"current": METER_A}),
    "A-free": Variant(
        ("displacement", "current", "reference"), False, {"current": METER_A}, ("steps", "chirp", "sine", "last")
    ),
    "A-bare": Variant(("displacement", "current"), False, {}, ("steps", "chirp", "sine", "last")),
    "A-rest": Variant(
        ("displacement", "current", "reference"),
        False,
        {"current": {**METER_A, "total": True, "offset_tolerance": 0.005}, "displacement": LAID},
        ("steps", "chirp", "sine", "last"),
    ),
    "B": Variant(("displacement", "command", "reference")),
    "B-free": Variant(("displacement", "current", "reference"), False),
    "B-rest": Variant(
        ("displacement", "current", "reference"),
        False,
        {"current": {"total": True, "offset_tolerance": 0.003}, "displacement": LAID},
    ),
    "C": Variant(("time", "displacement", "command", "reference")),
    "C-free": Variant(("time", "displacement", "command"), False, only=("run1", "run2", "run3", "run7")),
    "C-whole": Variant(("time", "displacement", "command", "reference"), only=("run1", "run2", "run3", "run4", "run7")),
    "D": Variant(("displacement", "command")),
    "D-current": Variant(("displacement", "command", "current"), chain={"current": METER_D}),
    "D-free": Variant(
        ("displacement", "current"), False, {"current": METER_D}, ("noise1", "noise2", "noise3", "noise4")
    ),
    "D-bare": Variant(("displacement", "current"), False, {}, NOISES),
    "E": Variant(("displacement", "command", "injection")),
    "E-free": Variant(("displacement", "current"), False, {"current": METER_D}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--variant", nargs="*", default=list(VARIANTS), choices=list(VARIANTS))
    parser.add_argument("--effect", nargs="*", default=list(EFFECTS), choices=EFFECTS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, help="of each record")
    options = parser.parse_args()
    length = {} if options.seconds is None else {"seconds": options.seconds}
    for letter in sorted({v[0] for v in options.variant}):
        for effect in options.effect:
            rig = RIGS[letter](effect, seed=options.seed, **length)
            logs = run_all(rig, options.seed)
            for name in (v for v in options.variant if v[0] == letter):
                v = VARIANTS[name]
                write_campaign(options.out / f"{name}-{effect}", v.of(rig), v.use, logs, v.gains)
                print(options.out / f"{name}-{effect}", flush=True)


if __name__ == "__main__":
    main()
