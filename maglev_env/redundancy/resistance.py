"""The mean voltage at a coil against its mean current: by Ohm's law, whatever the rotor does."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.magnets.kinds import geometric_law
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.redundancy.finding import Finding
from maglev_env.rig.rig import axis_rig

WARM = 0.3  # logarithm of a resistance over the stated one: copper that warms by 75 K reaches it
WIDE = 4.0  # standard deviations of a stated tolerance
STEADY = 1.0  # of its mean: a voltage that varies by more is switched, and its samples need not have its mean


def ohm(campaign: Campaign, spec: RecordingSpec, channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """A mean voltage that does not drive the mean current through the stated resistance.

    Only where both channels include the bias: a deviation says nothing of the whole.

    Args:
        campaign: With its rig.
        spec: The recording.
        channels: Name -> (samples,), V and A, without the bias, as read.
    """
    found: list[Finding] = []
    if campaign.rig is None or not campaign.rig.controlled:
        return []
    limit = WARM + WIDE * campaign.rig.tolerance.get("coil_resistance", 0.0)
    for name in [n for n in spec.channels if n.partition("_")[0] == "voltage" and n in channels]:
        rig = axis_rig(campaign.rig, int(name.endswith("_y")))
        if not rig.coil_resistance:
            continue
        bias, stated = geometric_law(rig).bias_current, rig.coil_resistance
        of = name.replace("voltage", "current", 1)
        if of not in channels or not (spec.channels[name].total and spec.channels[of].total):
            continue
        voltage, current = channels[name] + bias * stated, channels[of] + bias
        volts, amperes = float(voltage.mean()), float(current.mean())
        if not amperes or float(voltage.std()) > STEADY * abs(volts):
            continue
        shown = volts / amperes
        if shown > 0 and abs(np.log(shown / stated)) <= limit:
            continue
        columns = " and ".join(repr(spec.channels[n].expression) for n in (name, of))
        text = (
            f"{name} or {of}: a mean of {volts:.4g} V and of {amperes:.4g} A make {shown:.3g} ohm, "
            f"{shown / stated:.3g} times coil_resistance ({stated:g} ohm); check coil_resistance, and the "
            f"scales of columns {columns}"
        )
        found.append(Finding("resistance", spec.name, f"{name} or {of}", shown / stated, None, text, "wiring"))
    return found
