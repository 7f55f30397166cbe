"""`maglev simulate`: a simulated rig recorded as a campaign folder; `maglev effects`: what can be simulated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from maglev_env.design.defaults import with_defaults
from maglev_env.design.protocols import PlannedRecording, diagnosis_campaign, sphs_campaign
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import EFFECTS, parse_effects
from maglev_env.loop.gains import Controllers, Gains, with_gains
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import parse_excitation
from maglev_env.rig.rig import Protocol, Rig, load_rig
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page
from maglev_workbench.record_page import record_page

if TYPE_CHECKING:
    import xarray as xr

PROTOCOLS = {"sphs": sphs_campaign, "diagnosis": diagnosis_campaign}


@dataclass(frozen=True)
class Recorded:
    """What of the rig's protocol the command line replaces: excitations (empty: none) and their kind, fundamental Hz,
    periods kept, sample rate of the recording Hz."""

    excite: tuple[str, ...]
    kind: str
    fundamental: float | None
    periods: int | None
    sample_rate: float | None


def run(
    rig: str,
    gains: Mapping[str, float | None],
    protocol: str,
    recorded: Recorded,
    effects: Sequence[str],
    sensor: str,
    seed: int,
    data_format: str,
    out: Path,
    json_file: Path | None,
) -> None:
    """See `maglev_workbench.cli.simulate`."""
    if protocol not in PROTOCOLS:
        raise ValueError(f"--protocol {protocol}: use one of {', '.join(PROTOCOLS)}")
    require_folder(json_file, "--json")
    if (out / "campaign.toml").exists():
        raise ValueError(f"{out / 'campaign.toml'} exists; choose another --out or delete the folder")
    loaded = with_defaults(_excited(load_rig(rig), recorded))
    chosen = {name: value for name, value in gains.items() if value is not None}
    if chosen and not loaded.controlled:
        raise ValueError(f"rig {loaded.name} has no magnets: gains mean nothing on it")
    planned = PROTOCOLS[protocol](loaded, with_gains(loaded.gains, **chosen), parse_effects(effects), seed)
    recordings = []
    with progress_bar() as bar:
        for plan in bar.track(planned, description=f"simulate {loaded.name}"):
            e = replace(plan.experiment, sample_rate=recorded.sample_rate, sensor=sensor)
            e = e if recorded.periods is None else replace(e, periods=recorded.periods)
            recordings.append((plan.name, plan.role, _record(plan, e), e))
    toml = write_campaign(out, rig, {}, recordings, data_format)
    page = out / "recordings.html"
    write_page(page, record_page(f"Simulated {loaded.name}", [(name, d) for name, _, d, _ in recordings]))
    console.print(f"{len(recordings)} recording(s) of {loaded.name}\ncampaign  {toml}\npage      {page}")
    write_json(json_file, _summary(loaded, recordings, toml))


def _excited(rig: Rig, recorded: Recorded) -> Rig:
    """The rig with its protocol's excitations replaced by those of the command line, if any."""
    if not recorded.excite:
        if recorded.fundamental is not None or recorded.kind != "sphs":
            raise ValueError("--fundamental and --kind go with --excite")
        return rig
    protocol = rig.protocol or Protocol(())
    own = next((e.fundamental for e in protocol.excitations), 1.0)
    fundamental = recorded.fundamental or own
    excitations = tuple(parse_excitation(text, fundamental, recorded.kind) for text in recorded.excite)
    return replace(rig, protocol=replace(protocol, excitations=excitations))


def _record(plan: PlannedRecording, e: Experiment) -> "xr.Dataset":
    record = simulate_records([e])[0]
    try:
        return simulated_recording(e, record)
    except ValueError as error:
        raise ValueError(f"recording {plan.name}: {error}: the loop with {_words(e.gains)} does not hold it") from None


def _words(gains: Controllers) -> str:
    if isinstance(gains, tuple):
        return " and ".join(map(_words, gains))
    if not isinstance(gains, Gains):
        return "its linear controller"
    return f"kp = {gains.kp:g} A/m, ki = {gains.ki:g} A/(m s), kd = {gains.kd:g} A s/m"


def _summary(rig: Rig, recordings: list, toml: Path) -> dict:
    rows = [
        {"file": name, "role": role, "samples": d.sizes["time"], "periods": e.periods + e.transient_periods}
        for name, role, d, e in recordings
    ]
    return {"schema": "maglev-simulate/1", "rig": rig.name, "campaign": str(toml), "recordings": rows}


def list_effects() -> None:
    """See `maglev_workbench.cli.effects`."""
    table = Table("effect", "block", "parameters", "identified by", "source")
    for name, kind in EFFECTS.items():
        parameters = ", ".join(f"{k} {p.low:g} .. {p.high:g} {p.unit}".strip() for k, p in kind.parameters.items())
        table.add_row(name, kind.block, parameters, kind.identified_by, kind.source)
    console.print(table)
