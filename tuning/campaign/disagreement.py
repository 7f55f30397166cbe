"""What to do where recordings contradict the fitted rig: the diagnosis names the effect, or what to record."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from maglev_env.loop.gains import PidGains, with_gains
from maglev_env.recordings.campaign import Campaign
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig
from sim2real.advice.proposal import Proposal
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
        asked: The recordings that it proposes, in order.
    """

    sentence: str
    rig: Rig | None = None
    asked: tuple[Proposal, ...] = ()


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
    return Disagreement(sentence(found), rig, found.next_experiments.proposals if found.next_experiments else ())


def diagnosing(
    found: Disagreement, gains: PidGains, protocol: Protocol, sets: Sequence[GainSet]
) -> tuple[str, PidGains, tuple[Excitation, ...]] | None:
    """The first diagnosing recording that can be stated and was not made, in words, its gains and excitations.

    None where there is none.

    Args:
        found: The diagnosis.
        gains: At which it is to be recorded.
        protocol: Of the rig.
        sets: What was recorded.
    """
    if any(len(s.files) > 1 for s in sets):
        return None
    for proposal in found.asked:
        change, what = proposal.change, proposal.what
        if "gains" in change:
            kp, kd = change["gains"]
            other = with_gains(gains, kp=kp * gains.kp, kd=kd * gains.kd)
            if all(s.gains != other for s in sets):
                return what, other, protocol.excitations
        elif "amplitude" in change:
            factor = change["amplitude"]
            return what, gains, tuple(replace(e, amplitude=factor * e.amplitude) for e in protocol.excitations)
        elif "excitation" in change:
            return what, gains, protocol.excitations
    return None
