"""Work for processes of a scheduler, in a file that imports nothing: every process that starts imports it."""

import os
import time


def square(x):
    if x < 0:
        raise ArithmeticError(f"{x} is below 0")
    return x * x


def slow_square(x):
    time.sleep(0.1)
    return x * x


def deadly(x):
    if x == 2:
        os._exit(3)
    return x


def said(campaign):
    """A diagnosis whose cause says what was sent; campaign c0001 ends its process."""
    if campaign.name == "c0001":
        os._exit(3)
    files = {path.name: path.stat().st_size for path in campaign.iterdir()}
    found = files == {"campaign.toml": 6, "base.npz": 3000} and (campaign / "base.npz").read_bytes()[-1] == 7
    return {
        "schema": "maglev-diagnosis/1",
        "verdict": "explained" if found else "no_gap",
        "cause": ["delay"] if found else [],
        "where": {"blocks": {}},
        "which": [{"effects": ["delay"], "probability": 1.0, "parameters": {}}],
        "gap": {"closed_fraction": 0.9},
    }


class Numbered:
    """A condition of `maglev coverage` that counts as what it has drawn."""

    def drawn(self, seed, draw):
        time.sleep(0.1 * (draw == 0))  # the first is done last
        return seed, draw

    def counted(self, drawn):
        return tuple(drawn)
