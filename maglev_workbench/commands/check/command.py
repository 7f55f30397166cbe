"""`maglev check`: every recording of a campaign judged before anything is identified from it."""

from pathlib import Path

from rich.table import Table

from maglev_env.loop.axes import AXES
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.json_data import plain
from maglev_env.recordings.quality import Quality, recording_quality
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import axis_signals
from maglev_env.rig.rig import axis_rig
from maglev_workbench.console import console, require_folder, write_json
from maglev_workbench.page import write_page
from maglev_workbench.record_page import record_page


def run(source: Path, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.cli.check`."""
    campaign = load_campaign(source)
    page = out or campaign.folder / "check.html"
    require_folder(json_file, "--json")
    require_folder(page, "--out")
    found, datasets = [], []
    for spec in campaign.recordings:
        dataset = read_recording(campaign, spec)
        signals = recorded_signals(campaign, spec, dataset)
        for axis in range(signals.axes):
            own = axis_signals(signals, axis)
            name = spec.file if signals.axes == 1 else f"{spec.file}, {AXES[axis]}"
            if not own.excitations:
                console.print(f"{name}: nothing is excited along this axis")
                continue
            rig = campaign.rig if campaign.rig is None or own.axis is None else axis_rig(campaign.rig, own.axis)
            quality = recording_quality(own, rig)
            found.append((name, quality))
            for table in _tables(name, quality):
                console.print(table)
            for problem in quality.problems:
                console.print(f"  [yellow]![/] {problem}")
        datasets.append((spec.file, dataset))
    write_page(page, record_page(f"Check of {campaign.folder.name}", datasets))
    console.print(f"page  {page}")
    write_json(json_file, {"schema": "maglev-check/1", "recordings": [{"file": f, **plain(q)} for f, q in found]})


def _tables(file: str, q: Quality) -> list[Table]:
    dropped = f", {q.transient_periods} of transient dropped" if q.transient_periods else ""
    channels = Table("channel", "rms", "crest", "step / rms", "signal / noise, median", "worst line")
    channels.title = f"{file}: {q.periods} steady periods{dropped}"
    for c in q.channels:
        snr = ["-" if v is None else f"{v:.3g}" for v in (c.snr_median, c.snr_worst)]
        channels.add_row(c.name, f"{c.rms:.3g}", f"{c.crest:.2f}", f"{c.resolution_share:.1e}", *snr)
    bands = Table("band, Hz", "displacement / noise", "coherence", "verdict")
    for b in q.bands:
        bands.add_row(f"{b.f_lo:.4g} .. {b.f_hi:.4g}", f"{b.snr:.3g}", f"{b.coherence:.4f}", b.verdict)
    uses = Table("good for", "")
    for use, verdict in q.can.items():
        uses.add_row(use, verdict, style=None if verdict.startswith("yes") else "yellow")
    return [channels, bands, uses]
