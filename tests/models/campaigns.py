"""Small campaigns for the diagnosis: few lines, periods of a quarter of a second."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from maglev_env.design.protocols import PlannedRecording, diagnosis_campaign
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import NO_EFFECTS, Effects
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.records import Record, read_records

FUNDAMENTAL, PERIODS = 4.0, 4
FORCED = tuple(range(1, 42))
INJECTED = ((65, 93, 121, 155, 197, 255, 331, 427), (73, 101, 133, 173, 219, 283, 367, 475))  # of x and of y


def small(rig: Rig) -> Rig:
    """The rig with a protocol of few lines from 4 Hz up."""
    push = next(e for e in rig.protocol.excitations if e.at == "force")
    turned = 45.0 * (rig.axes - 1)
    parts = [Excitation("sphs", "force", FUNDAMENTAL, FORCED, push.amplitude, direction=turned)]
    if lines_at(rig.protocol.excitations, "current").size:
        peak = next(e.amplitude for e in rig.protocol.excitations if e.at == "current")
        for axis in range(rig.axes):
            parts.append(Excitation("sphs", "current", FUNDAMENTAL, INJECTED[axis], peak, direction=90.0 * axis))
    return replace(rig, protocol=replace(rig.protocol, excitations=tuple(parts)))


def planned(
    rig: Rig, effects: Effects = NO_EFFECTS, names: Sequence[str] = ("base", "half", "holdout"), seed: int = 0
) -> list[PlannedRecording]:
    """Recordings of the diagnosis campaign of a small rig, PERIODS long after a transient one."""
    rows = diagnosis_campaign(small(rig), rig.gains or NO_CONTROLLER, effects, seed)
    return [replace(row, experiment=replace(row.experiment, periods=PERIODS)) for row in rows if row.name in names]


def write(
    folder: Path,
    rows: Sequence[tuple[str, str, Experiment]],
    nominal: str = "hmb_free",
    parameters: Mapping[str, float] | None = None,
    keep: Sequence[str] = (),
) -> Path:
    """A campaign folder of simulated experiments (name, role, experiment); keep: channels written, default all."""
    written = []
    for name, role, e in rows:
        dataset = simulated_recording(e, simulate_records([e])[0])
        written.append((name, role, dataset[list(keep)] if keep else dataset, e))
    write_campaign(folder, nominal, parameters or {}, written)
    return folder


def campaign(folder: Path, rig: str = "hmb_free", effects: Effects = NO_EFFECTS, **options) -> Path:
    """The small diagnosis campaign of a preset with effects; options as `planned` and `write`."""
    plan = {key: options.pop(key) for key in ("names", "seed") if key in options}
    rows = [(p.name, p.role, p.experiment) for p in planned(load_rig(rig), effects, **plan)]
    return write(folder, rows, rig, **options)


def repeated(folder: Path, experiments: Sequence[Experiment], nominal: str = "hmb_free") -> tuple[Record, ...]:
    """Records of experiments that share a schedule (see `simulate_records`), simulated in lanes."""
    series = simulate_records(experiments)
    rows = [
        (f"r{i}", "fit", simulated_recording(e, s), e) for i, (e, s) in enumerate(zip(experiments, series, strict=True))
    ]
    write_campaign(folder, nominal, {}, rows)
    return read_records(folder)[1]
