"""A bearing engineer: which proportional gain gives stiffness without a high peak of S, and how sure is it?"""

from dataclasses import replace

from maglev_workbench import evaluate, load_rig, protocol_experiment


def study(picture: str | None = None):
    rig = load_rig("hmb_free")
    kp = (6000.0, 8000.0, 10000.0, 12000.0)  # A/m
    found = evaluate([protocol_experiment(rig, replace(rig.gains, kp=value)) for value in kp])
    print(found)
    table = found.to_pandas().set_axis(kp, axis="index")
    if picture:
        found.plot().savefig(picture)
    return table[["stiffness", "stiffness_low", "stiffness_high", "damping", "peak_sensitivity", "score"]]


if __name__ == "__main__":
    print(study("stiffness.png").to_string())
