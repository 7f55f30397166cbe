"""Tables of a recording's quality for the terminal."""

from rich.table import Table

from maglev_env.recordings.quality import Quality


def quality_tables(file: str, q: Quality) -> list[Table]:
    """Tables of the channels, of the excited bands, and of the uses for which the recording is good enough."""
    dropped = f", {q.transient_periods} of transient dropped" if q.transient_periods else ""
    channels = Table("channel", "rms", "crest", "step / rms", "signal / noise, median", "worst line")
    channels.title = f"{file}: {q.periods} steady periods{dropped}" if q.periods else f"{file}: nothing repeats"
    for c in q.channels:
        snr = ["-" if v is None else f"{v:.3g}" for v in (c.snr_median, c.snr_worst)]
        channels.add_row(c.name, f"{c.rms:.3g}", f"{c.crest:.2f}", f"{c.resolution_share:.1e}", *snr)
    bands = Table("band, Hz", "displacement / noise", "coherence", "verdict")
    for b in q.bands:
        bands.add_row(f"{b.f_lo:.4g} .. {b.f_hi:.4g}", f"{b.snr:.3g}", f"{b.coherence:.4f}", b.verdict)
    uses = Table("good for", "")
    for use, verdict in q.can.items():
        uses.add_row(use, verdict, style=None if verdict.startswith("yes") else "yellow")
    return [channels, bands, uses] if q.bands else [channels, uses]
