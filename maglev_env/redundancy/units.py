"""Columns whose name states a unit, against the scale that the campaign states."""

from maglev_env.channels import unit_of
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.guess.units import header_unit
from maglev_env.redundancy.finding import Finding

# One metre a volt is no sensor of a levitated rotor, while 1 A/V is a usual amplifier, and 1 N/V a possible transducer.
_NEVER_ONE = ("displacement", "reference", "gap_estimate")


def unscaled(campaign: Campaign, spec: RecordingSpec) -> list[Finding]:
    """Lengths that are read from volts, or from millimetres, as if these were metres."""
    found = []
    for name, source in spec.channels.items():
        if name.partition("_")[0] not in _NEVER_ONE or abs(source.scale) != 1 or sum(source.weights) != 1:
            continue
        headers = campaign.files.columns(campaign.folder / spec.file, spec.layout).headers
        column = source.columns[0]
        _, unit = header_unit(headers.get(column, column).rpartition(".")[2])
        if unit is None or (unit.si == "m" and unit.scale == 1):
            continue
        text = (
            f"{name}: column {column!r} is in {unit.text}, and no scale is stated for it; state scale, "
            f"{unit_of(name)} per {unit.text}, in [recording.channels]"
        )
        found.append(Finding("unit", spec.file, name, None, None, text, "contradiction"))
    return found
