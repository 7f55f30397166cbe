"""What to do where recordings contradict the fitted rig: the diagnosis names the effect, or what to record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from maglev_env.loop.gains import Gains, with_gains
from maglev_env.recordings.campaign import Campaign
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig
from sim2real.corrected import corrected_rig
from sim2real.diagnosis import diagnose
from sim2real.report import sentence
from tuning.campaign.gain_set import GainSet

EXPLAINED = "explained"


@dataclass(frozen=True)
class Disagreement:
    """A diagnosis, as far as tuning needs it.

    Attributes:
        sentence: What it says.
        rig: The corrected rig, with the stated mass; None where no effect explains the recordings.
        what: The recording that it proposes, in words; None without one.
        change: How that differs from the recordings made, see `sim2real.advice.proposal.Proposal`.
    """

    sentence: str
    rig: Rig | None = None
    what: str | None = None
    change: Mapping[str, Any] | None = None


def disagreement(campaign: Campaign, seed: int = 0) -> Disagreement:
    """Diagnose a campaign; about a minute.

    Args:
        campaign: With a rig.
        seed: Of the diagnosis.
    """
    try:
        found = diagnose(campaign, seed)
    except ValueError as error:
        return Disagreement(f"`maglev diagnose` cannot judge these recordings: {error}")
    rig = replace(corrected_rig(found), mass=found.rig.mass) if found.verdict == EXPLAINED else None
    if found.next_experiments is None:
        return Disagreement(sentence(found), rig)
    proposal = found.next_experiments.proposals[0]
    return Disagreement(sentence(found), rig, proposal.what, proposal.change)


def diagnosing(
    found: Disagreement, gains: Gains, protocol: Protocol, sets: Sequence[GainSet]
) -> tuple[Gains, tuple[Excitation, ...]] | None:
    """Gains and excitations of the diagnosing recording; None where there is none that can be stated, or it was made.

    Args:
        found: The diagnosis.
        gains: At which it is to be recorded.
        protocol: Of the rig.
        sets: What was recorded.
    """
    change = found.change or {}
    if any(len(s.files) > 1 for s in sets):
        return None
    if "gains" in change:
        kp, kd = change["gains"]
        other = with_gains(gains, kp=kp * gains.kp, kd=kd * gains.kd)
        return None if any(s.gains == other for s in sets) else (other, protocol.excitations)
    if "amplitude" in change:
        factor = change["amplitude"]
        return gains, tuple(replace(e, amplitude=factor * e.amplitude) for e in protocol.excitations)
    if "excitation" in change:
        return gains, protocol.excitations
    return None
