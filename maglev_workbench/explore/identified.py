"""The identification experiment of a setting, simulated with noise and identified as a recording would be.

It runs in a process of its own: compiling a kernel holds the lock of the interpreter, and would stop the curves.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager

from maglev_env.evaluation.identification import Identification, identify
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import pole_radii
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.rig import axis_rig
from maglev_lanes.processes import fresh_pool

Identify = Callable[[Experiment, int], Identification]


@contextmanager
def identifying() -> Iterator[Identify]:
    """`identified` in a process of its own, one experiment at a time, so that the curves keep a core for themselves."""
    with fresh_pool(1) as pool:

        def identify_there(experiment: Experiment, axis: int) -> Identification:
            try:
                return pool.submit(identified, experiment, axis).result()
            except BrokenExecutor:
                raise ValueError("the process of the experiments was ended; start maglev explore again") from None

        yield identify_there


def identified(experiment: Experiment, axis: int) -> Identification:
    """What `maglev simulate` and `maglev estimate --band-overlap 0` give for one axis of an experiment.

    Raises:
        ValueError: The linearised loop is unstable, the rotor touches down, or nothing can be identified.
    """
    if pole_radii([experiment])[0] >= 1:  # the rotor may stay near a pole, but has no steady response there
        raise ValueError("the loop is unstable, so that the rotor has no steady response to identify")
    recording = simulated_recording(experiment, simulate_records([experiment], threads=1)[0])
    channels = {str(name): recording[name].values for name in recording.data_vars}
    rig, rate = experiment.rig, experiment.recorded_rate
    held = rate if any(e.at == "force" for e in experiment.excitations) else None
    signals = RecordedSignals(channels, rate, experiment.excitations, held, experiment.gains, axes=rig.axes)
    own = axis_rig(rig, axis)
    # Bands side by side: overlapping ones would cost four times as long and say the same.
    return identify(axis_signals(signals, axis), own, own.mass, band_overlap=0.0)
