"""An experiment that is simulated with its noise, and identified as its recording would be."""

from maglev_env.evaluation.identification import Identification, identify
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.poles import pole_radii
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals, axis_signals
from maglev_env.rig.rig import axis_rig


def identify_experiment(experiment: Experiment, axis: int = 0, band_overlap: float | None = None) -> Identification:
    """What `maglev simulate` and `maglev estimate` give for one axis of an experiment.

    Args:
        experiment: with periodic excitations.
        axis: 0 (x or the only one) or 1 (y).
        band_overlap: of the estimation bands, Hz; by default that of the rig's protocol.

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
    return identify(axis_signals(signals, axis), own, own.mass, band_overlap=band_overlap)
