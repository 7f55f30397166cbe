"""Sealed sets and answers made by hand, without generator or diagnosis."""

import json
import os
from hashlib import sha256
from pathlib import Path


def label(i, kind="single", effects=("delay",), sizes=(20.0,), channels="full", rig="hmb_free"):
    """What the labels say of one campaign."""
    names = {name: {} for name in effects}
    sizes = [] if kind == "none" else list(sizes)
    return {"id": f"c{i:04d}", "kind": kind, "rig": rig, "channels": channels, "effects": names, "sizes": sizes}


def seal(folder: Path, labels, speeds=(0.0,)):
    """Write campaign stubs and labels, and publish the hash."""
    for one in labels:
        campaign = folder / "campaigns" / one["id"]
        campaign.mkdir(parents=True)
        tables = "".join(f"[[recording]]\nspeed_rpm = {speed}\n" for speed in speeds)
        (campaign / "campaign.toml").write_text('schema = "maglev-campaign/1"\n' + tables)
    text = json.dumps(labels)
    (folder / "labels.json").write_text(text)
    (folder / "labels.sha256").write_text(f"{sha256(text.encode()).hexdigest()}  labels.json\n")
    return folder


def diagnosis(verdict, cause=(), which=None, blocks=None, closed=0.97):
    """A diagnosis of the published form; which: {"a+b": probability}."""
    which = which or {"+".join(cause) if verdict == "explained" else "none": 1.0}
    return {
        "schema": "maglev-diagnosis/1",
        "verdict": verdict,
        "cause": list(cause),
        "where": {"blocks": blocks or {}, "bands": [], "kind": {}},
        "which": [{"effects": k.split("+"), "probability": p, "parameters": {}} for k, p in which.items()],
        "gap": {"closed_fraction": closed},
    }


def no_gap(campaign):
    """Says that there is nothing, whatever there is."""
    return diagnosis("no_gap")


def by_name(campaign):
    """By the campaign's number: an answer, a failure, something unfit, and a process that dies."""
    match int(campaign.name[1:]) % 4:
        case 0:
            return diagnosis("explained", ["delay"])
        case 1:
            raise ArithmeticError("the loop does not stand")
        case 2:
            return diagnosis("explained", ["gremlins"])
    os._exit(3)
