"""A campaign of one recording in which a measured force moves the rotor, as an engineer writes it down."""

from pathlib import Path

import numpy as np

CAMPAIGN = """\
schema = "maglev-campaign/1"
rig = "rig.toml"

[[recording]]
file = "run.npz"
role = "fit"
sample_rate = {rate}

[[recording.excitation]]
kind = "recorded"
at = "force"

[recording.channels]
"""


def write_campaign(folder: Path, rig: str, rate: float, columns: dict[str, np.ndarray]) -> Path:
    """Write rig.toml, campaign.toml and run.npz into a folder, and return the folder.

    Args:
        folder: that exists.
        rig: the text of rig.toml.
        rate: sample rate, Hz.
        columns: channel -> (samples,), SI.
    """
    (folder / "rig.toml").write_text(rig)
    channels = "".join(f'{name} = {{ from = "{name}" }}\n' for name in columns)
    (folder / "campaign.toml").write_text(CAMPAIGN.format(rate=rate) + channels)
    np.savez(folder / "run.npz", **columns)
    return folder
