"""The identification experiment of a setting, simulated with noise and identified as a recording would be."""

from threading import Lock

from maglev_env.evaluation.identification import Identification, identify
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.rig import axis_rig

_ONE = Lock()  # one experiment at a time, so that the curves keep a core for themselves


def identified(experiment: Experiment, axis: int) -> Identification:
    """What `maglev simulate` and `maglev estimate --band-overlap 0` give for one axis of an experiment.

    Raises:
        ValueError: The rotor touches down, or nothing can be identified.
    """
    with _ONE:
        recording = simulated_recording(experiment, simulate_records([experiment], threads=1)[0])
        channels = {str(name): recording[name].values for name in recording.data_vars}
        rig, rate = experiment.rig, experiment.recorded_rate
        held = rate if any(e.at == "force" for e in experiment.excitations) else None
        signals = RecordedSignals(channels, rate, experiment.excitations, held, experiment.gains, axes=rig.axes)
        own = axis_rig(rig, axis)
        # Bands side by side: overlapping ones would cost four times as long and say the same.
        return identify(axis_signals(signals, axis), own, own.mass, band_overlap=0.0)
