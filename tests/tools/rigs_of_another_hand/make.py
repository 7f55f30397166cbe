"""Write the campaigns of five benches of another hand, with truth.json beside each.

    python tests/tools/rigs_of_another_hand/make.py OUT [--rig A ...] [--effect none ...] [--seed 1]

OUT/A-none holds data files, rig.toml, campaign.toml and truth.json of bench A without an effect, and so on. Then run
`maglev check`, `estimate` and `diagnose` on them, or `score.py OUT`.
"""

import argparse
from pathlib import Path

from rigs import EFFECTS, RIGS
from write import write_campaign

USE = {
    "A": ("displacement", "command", "reference"),
    "A-current": ("displacement", "command", "reference", "current"),
    "B": ("displacement", "command", "reference"),
    "C": ("time", "displacement", "command", "reference"),
    "D": ("displacement", "command"),
    "D-current": ("displacement", "command", "current"),
    "E": ("displacement", "command", "injection"),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rig", nargs="*", default=list(USE), choices=list(USE))
    parser.add_argument("--effect", nargs="*", default=list(EFFECTS), choices=EFFECTS)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for name in options.rig:
        for effect in options.effect:
            rig = RIGS[name[0]](effect, seed=options.seed)
            write_campaign(options.out / f"{name}-{effect}", rig, USE[name], options.seed)


if __name__ == "__main__":
    main()
