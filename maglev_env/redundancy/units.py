"""Columns whose name states a unit, against the scale that the campaign states."""

from maglev_env.channels import unit_of
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.guess.units import header_unit
from maglev_env.redundancy.finding import Finding

# One metre a volt is no sensor of a levitated rotor, while 1 A/V is a usual amplifier, and 1 N/V a possible transducer.
_NEVER_ONE = ("displacement", "reference", "gap_estimate")
_CHECKED = (*_NEVER_ONE, "command", "current", "injection", "force", "voltage")


def unscaled(campaign: Campaign, spec: RecordingSpec) -> list[Finding]:
    """Readings in another unit than that of their channel, which the campaign takes as if they were in that one.

    Lengths in volts, and millimetres, milliamperes or kilonewtons taken as the unit itself, are contradictions. A
    current or force in volts may be 1 A or 1 N per volt, which is to be looked at.
    """
    found = []
    for name, source in spec.channels.items():
        kind = "gap_estimate" if name.startswith("gap_estimate") else name.partition("_")[0]
        if kind not in _CHECKED or abs(source.scale) != 1 or sum(source.weights) != 1 or source.polynomial:
            continue
        headers = campaign.files.columns(campaign.folder / spec.file, spec.layout).headers
        column, wanted = source.columns[0], unit_of(name)
        _, unit = header_unit(headers.get(column, column).rpartition(".")[2])
        if unit is None or (unit.si == wanted and unit.scale == 1):
            continue
        beyond = kind in _NEVER_ONE or unit.si == wanted
        if not beyond and unit.si != "V":
            continue
        taken = "" if beyond else f", so that 1 {unit.text} counts as 1 {wanted}"
        text = (
            f"{name}: column {column!r} is in {unit.text}, and no scale is stated for it{taken}; state scale, "
            f"{wanted} per {unit.text}, in [recording.channels]"
        )
        found.append(Finding("unit", spec.name, name, None, None, text, "contradiction" if beyond else "wiring"))
    return found
