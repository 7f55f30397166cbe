"""Whole diagnoses of two small campaigns: recordings with a period, and recordings that never repeat."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.timing import Size, alternately, stepper
from sim2real.diagnosis import diagnose

_FORCED, _INJECTED = tuple(range(1, 40, 2)), (43, 51, 61, 79, 99, 127, 167, 215)
_CHANNELS = ("displacement", "command", "current")


def diagnosis_figures(size: Size) -> dict[str, Figure]:
    """Seconds of a diagnosis of each kind, all effects tried, and the lane steps of the bare kernel that take as long.

    Only the second figure can be compared with that of another moment, or of another machine.
    """
    del size  # two runs of each are enough: the second one compiles nothing
    quiet = _experiment("current", 20.0, 0)
    with tempfile.TemporaryDirectory(prefix="maglev-bench-") as folder:
        works: dict[str, Callable[[], object]] = {
            "kernel": stepper([replace(quiet, seed=i) for i in range(LANES)], 2),
            "periodic": partial(diagnose, _periodic(Path(folder, "periodic"))),
            "open": partial(diagnose, _open(Path(folder, "open"))),
        }
        seconds = alternately(works, 2)
    steps = LANES * quiet.samples_per_period / seconds.pop("kernel") / 1e6
    found = {f"diagnosis_{kind}_seconds": Figure(value, "s") for kind, value in seconds.items()}
    return found | {
        f"diagnosis_{kind}_over_kernel": Figure(value * steps, "million lane steps") for kind, value in seconds.items()
    }


def _experiment(at: str, fundamental: float, seed: int, periods: int = 4) -> Experiment:
    """A rig with a delay under a random-phase multisine."""
    rig = load_rig("hmb_free")
    lines, peak = {"force": (_FORCED, 0.5), "current": (_INJECTED, 0.1)}[at]
    excited = Excitation("multisine", at, fundamental, lines, peak, seed=seed)
    return Experiment(rig, rig.gains, (excited,), periods, effects=effect("delay", 4e-5), seed=seed)


def _periodic(folder: Path) -> Path:
    """Three recordings of 50 ms periods, the last one a holdout."""
    runs = [_experiment(at, 20.0, seed) for seed, at in enumerate(("force", "current", "force"))]
    rows = [
        (f"run{i}", "holdout" if i == 2 else "fit", simulated_recording(e, simulate_records([e])[0]), e)
        for i, e in enumerate(runs)
    ]
    write_campaign(folder, "hmb_free", {}, rows)
    return folder


def _open(folder: Path) -> Path:
    """Three recordings of half a second under an injection that nobody stored, the last one a holdout."""
    folder.mkdir()
    text = ['schema = "maglev-campaign/1"', 'rig = "hmb_free"']
    for seed in range(3):
        e = _experiment("current", 2.0, seed, periods=1)
        series = simulated_recording(e, simulate_records([e])[0])
        np.savez(folder / f"run{seed}.npz", **{name: series[name].values for name in _CHANNELS})
        gains = ", ".join(f"{name} = {getattr(e.gains, name)!r}" for name in ("kp", "ki", "kd", "td", "ti"))
        text += [
            "[[recording]]",
            f'file = "run{seed}.npz"',
            f'role = "{"holdout" if seed == 2 else "fit"}"',
            f"sample_rate = {e.rig.control_rate!r}",
            f"gains = {{ {gains} }}",
            'excitation = { kind = "none" }',
            "[recording.channels]",
            *(f'{name} = {{ from = "{name}" }}' for name in _CHANNELS),
        ]
    (folder / "campaign.toml").write_text("\n".join(text), encoding="utf-8")
    return folder
