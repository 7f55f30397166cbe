"""The experiment of one step: the rig's full SPHS protocol, or a quick one for many steps."""

from dataclasses import replace

import numpy as np

from maglev_env.rig.excitation import lines_at
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig

PROTOCOLS = ("full", "quick")
# Ratios of the quick fundamental to the full one: the first with whole samples in a period that leaves IN_BAND force
# lines in the target band.
_COARSER = (5, 3, 2, 1)
IN_BAND = 2
_EVERY = 3  # every third of the quick lines belongs to the injection
_PERIODS = 3


def env_protocol(rig: Rig, name: str) -> Protocol:
    """The rig's protocol ("full"), or one with five times its fundamental and three periods ("quick").

    A slow loop, whose target band would hold no two of the quick force lines, has a lower fundamental. Without an
    injection, as where nothing controls the rig, all of the quick lines belong to the force.

    The quick protocol takes an eighth of the time. Because it has fewer lines and a shorter record, its standard errors
    are two to five times larger, and a sharp resonance may fall between its lines: on hmb_radial it measures a peak
    sensitivity of 4.6, the full protocol 5.3. Amplitudes, places and directions are those of the full protocol.

    Raises:
        ValueError: The name is another one, or the rig has no [protocol] with an excitation at the force.
    """
    if name not in PROTOCOLS:
        raise ValueError(f"protocol = {name!r}; use one of {', '.join(PROTOCOLS)}")
    full = rig.protocol
    if full is None or not lines_at(full.excitations, "force").size:
        raise ValueError(f"rig {rig.name}: protocol {name!r} needs a [protocol] with an excitation at the force")
    if name == "full":
        return full
    for coarser in _COARSER:
        samples = rig.control_rate / (coarser * full.excitations[0].fundamental)
        if abs(samples - round(samples)) > 1e-6 * samples:  # a period of it would be no whole number of them
            continue
        protocol = _quick(full, coarser)
        low, high = rig.target.band or (0.0, np.inf)
        at = lines_at(protocol.excitations, "force") * protocol.excitations[0].fundamental
        if np.sum((at >= low) & (at <= high)) >= IN_BAND:
            break
    return protocol


def _quick(full: Protocol, coarser: int) -> Protocol:
    places = {place: [e for e in full.excitations if e.at == place] for place in ("force", "current")}
    force, injected = np.arange(1, max(_top(full, "force") // coarser, 2) + 1), np.array([], int)
    if places["current"]:
        highest = max(_top(full, "current") // coarser, force[-1] + 2)
        beyond = np.round(np.geomspace(force[-1] + 1, highest, 20)).astype(int)
        injected = np.union1d(force[_EVERY - 1 :: _EVERY], beyond)
        force = np.setdiff1d(force, injected)
    parts = []
    for place, lines in (("force", force), ("current", injected)):
        for turn, e in enumerate(places[place]):
            own = tuple(map(int, lines[turn :: len(places[place])]))
            parts.append(replace(e, fundamental=e.fundamental * coarser, lines=own))
    return replace(full, excitations=tuple(parts), periods=_PERIODS, transient_periods=1)


def _top(protocol: Protocol, place: str) -> int:
    """The highest line at a place that the protocol excites."""
    return int(lines_at(protocol.excitations, place)[-1])
