"""Recordings of `maglev simulate`: by the rig's own protocol, or by excitations from the command line."""

from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maglev_env.design.protocols import PlannedRecording, diagnosis_campaign, sphs_campaign
from maglev_env.experiment import Experiment, recorded_channels
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.gains import Controllers, Gains, form_of
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import parse_excitation
from maglev_env.rig.protocol import Protocol
from maglev_env.rig.rig import Rig
from maglev_lanes.price import check_bytes, check_length

if TYPE_CHECKING:
    import xarray as xr

PROTOCOLS = {"sphs": sphs_campaign, "diagnosis": diagnosis_campaign}


@dataclass(frozen=True)
class Recorded:
    """Options of the command line that replace parts of the rig's protocol.

    Args:
        excite: excitations, place=first:last[:step]@peak[@degrees]; empty: the rig's own.
        kind: of those excitations.
        fundamental: of those excitations, Hz; None: the rig's.
        periods: kept after the transient; None: the protocol's.
        sample_rate: of the recording, Hz; None: the control rate.
    """

    excite: tuple[str, ...]
    kind: str
    fundamental: float | None
    periods: int | None
    sample_rate: float | None


def excited(rig: Rig, recorded: Recorded) -> Rig:
    """The rig with its protocol's excitations replaced by those of the command line, if any."""
    if not recorded.excite:
        if recorded.fundamental is not None or recorded.kind != "sphs":
            raise ValueError("--fundamental and --kind go with --excite")
        return rig
    protocol = rig.protocol or Protocol(())
    own = next((e.fundamental for e in protocol.excitations), 1.0)
    fundamental = own if recorded.fundamental is None else recorded.fundamental
    excitations = tuple(parse_excitation(text, fundamental, recorded.kind) for text in recorded.excite)
    return replace(rig, protocol=replace(protocol, excitations=excitations))


def record(plan: PlannedRecording, recorded: Recorded, sensor: str) -> "tuple[xr.Dataset, Experiment]":
    """One simulated recording and its experiment.

    Raises:
        ValueError: The rotor touches down.
    """
    e = replace(plan.experiment, sample_rate=recorded.sample_rate, sensor=sensor)
    e = e if recorded.periods is None else replace(e, periods=recorded.periods)
    periods, columns = e.periods + e.transient_periods, len(recorded_channels(e)) * e.rig.axes + 1
    check_length(e.samples_per_period, periods, "--periods")
    check_bytes(8 * columns * periods * e.recorded_rate / e.fundamental, f"recording {plan.name}")
    found = simulate_records([e])[0]
    try:
        return simulated_recording(e, found), e
    except ValueError as error:
        raise ValueError(f"recording {plan.name}: {error}: the loop with {_words(e.gains)} does not hold it") from None


def _words(gains: Controllers) -> str:
    if isinstance(gains, tuple):
        return " and ".join(map(_words, gains))
    if not isinstance(gains, Gains):
        return f"its controller ({form_of(gains) or 'transfer_function'})"
    return f"kp = {gains.kp:g} A/m, ki = {gains.ki:g} A/m, kd = {gains.kd:g} A s/m"


def summary(rig: Rig, recordings: list[tuple[str, str, "xr.Dataset", Experiment]], toml: Path) -> dict[str, Any]:
    """The data for --json; recordings: name, role, samples and experiment of each."""
    rows = [
        {"file": name, "role": role, "samples": d.sizes["time"], "periods": e.periods + e.transient_periods}
        for name, role, d, e in recordings
    ]
    return {
        "schema": "maglev-simulate/1",
        "version": version("maglev-workbench"),
        "rig": rig.name,
        "campaign": str(toml),
        "recordings": rows,
    }
