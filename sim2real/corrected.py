"""The corrected rig as a rig TOML: the nominal rig with what closes the gap, for sweeps and environments."""

from dataclasses import replace
from pathlib import Path

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.files import write_text_atomic
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_toml import rig_toml
from sim2real.compared.point import experiment_at
from sim2real.report import corrections, sentence
from sim2real.result import Diagnosis
from sim2real.words import AT_BOUND


def corrected_rig(diagnosis: Diagnosis) -> Rig:
    """The campaign's rig at the point that closes its gap; its name ends in "-corrected".

    Args:
        diagnosis: of the campaign.
    """
    rig = diagnosis.rig
    at = experiment_at(Experiment(rig, rig.gains or NO_CONTROLLER, ()), diagnosis.corrected)
    return replace(at.rig, name=f"{rig.name}-corrected", effects=at.effects)


def corrected_toml(diagnosis: Diagnosis) -> str:
    """`corrected_rig` as a rig TOML that `load_rig` reads back unchanged; comments state its origin."""
    head = [
        f"Made by maglev diagnose from the campaign {diagnosis.campaign.folder.resolve().name}.",
        sentence(diagnosis),
    ]
    if diagnosis.gap.after is not None:
        head.append(
            f"Gap on the {diagnosis.gap.judged_on}, in units of the noise: "
            f"{'no levitation' if diagnosis.gap.before is None else f'{diagnosis.gap.before:.4g}'} before, "
            f"{diagnosis.gap.after:.4g} after."
        )
    if diagnosis.free is not None and (diagnosis.corrected_freely or diagnosis.free.trend):
        head.append(diagnosis.free.sentence())
    for c in corrections(diagnosis):
        head.append(
            f"{c.name} = {c.value:.6g} {c.unit}".rstrip()
            + (f" +- {c.se:.2g} (standard error)" if c.se else "")
            + (f" ({AT_BOUND})" if c.at_bound else "")
        )
    comment = "".join(f"# {' '.join(line.split())}\n" for line in head)
    return comment + rig_toml(corrected_rig(diagnosis))


def write_corrected(diagnosis: Diagnosis, path: str | Path) -> None:
    """Write `corrected_toml` atomically.

    Args:
        diagnosis: of a campaign.
        path: of the rig file to write.

    Raises:
        OSError: The file cannot be written.
    """
    write_text_atomic(path, corrected_toml(diagnosis))
