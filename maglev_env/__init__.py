"""Magnetically levitated rigs: physics, effects, the lane simulator, experiments, recordings and the score.

The public names are imported on first use, which keeps the import fast; the environments are registered with Gymnasium
on import.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from maglev_env.envs.registration import register_envs

if TYPE_CHECKING:
    from maglev_env.design.defaults import with_defaults as with_defaults
    from maglev_env.envs.pump import PumpRotorEnv as PumpRotorEnv
    from maglev_env.envs.pump import PumpRotorVectorEnv as PumpRotorVectorEnv
    from maglev_env.envs.single import RigEnv as RigEnv
    from maglev_env.envs.vector import RigVectorEnv as RigVectorEnv
    from maglev_env.evaluation.evaluate import evaluate as evaluate
    from maglev_env.evaluation.evaluation import Evaluation as Evaluation
    from maglev_env.evaluation.identification import Identification as Identification
    from maglev_env.evaluation.identification import identify as identify
    from maglev_env.evaluation.simulated import identify_experiment as identify_experiment
    from maglev_env.experiment import Experiment as Experiment
    from maglev_env.experiment import protocol_experiment as protocol_experiment
    from maglev_env.kernel.simulate import simulate_records as simulate_records
    from maglev_env.kernel.simulate import simulate_statistics as simulate_statistics
    from maglev_env.linear.control_systems import to_control as to_control
    from maglev_env.linear.loop import LoopResponse as LoopResponse
    from maglev_env.linear.loop import loop_response as loop_response
    from maglev_env.loop.effect import EFFECTS as EFFECTS
    from maglev_env.loop.effect import effect as effect
    from maglev_env.loop.gains import Gains as Gains
    from maglev_env.loop.self_sensor import SelfSensing as SelfSensing
    from maglev_env.recordings.campaign import load_campaign as load_campaign
    from maglev_env.recordings.campaign_writer import write_campaign as write_campaign
    from maglev_env.recordings.recording import read_recording as read_recording
    from maglev_env.recordings.signals import recorded_signals as recorded_signals
    from maglev_env.recordings.spectra import RecordedSignals as RecordedSignals
    from maglev_env.rig.excitation import Excitation as Excitation
    from maglev_env.rig.rig import Rig as Rig
    from maglev_env.rig.rig import with_parameters as with_parameters
    from maglev_env.rig.rig_file import load_rig as load_rig
    from maglev_env.rig.self_sensor import rig_sensors as rig_sensors
    from maglev_env.rotor.evaluation import RotorEvaluation as RotorEvaluation
    from maglev_env.rotor.evaluation import evaluate_rotors as evaluate_rotors
    from maglev_env.rotor.rotor import load_rotor as load_rotor

_HOME = {
    "Gains": "loop.gains",
    "Excitation": "rig.excitation",
    "Experiment": "experiment",
    "protocol_experiment": "experiment",
    "rig_sensors": "rig.self_sensor",
    "SelfSensing": "loop.self_sensor",
    "Rig": "rig.rig",
    "load_rig": "rig.rig_file",
    "with_parameters": "rig.rig",
    "effect": "loop.effect",
    "EFFECTS": "loop.effect",
    "simulate_statistics": "kernel.simulate",
    "simulate_records": "kernel.simulate",
    "Evaluation": "evaluation.evaluation",
    "evaluate": "evaluation.evaluate",
    "identify": "evaluation.identification",
    "Identification": "evaluation.identification",
    "identify_experiment": "evaluation.simulated",
    "loop_response": "linear.loop",
    "LoopResponse": "linear.loop",
    "to_control": "linear.control_systems",
    "RecordedSignals": "recordings.spectra",
    "load_campaign": "recordings.campaign",
    "read_recording": "recordings.recording",
    "recorded_signals": "recordings.signals",
    "write_campaign": "recordings.campaign_writer",
    "with_defaults": "design.defaults",
    "RigEnv": "envs.single",
    "RigVectorEnv": "envs.vector",
    "PumpRotorEnv": "envs.pump",
    "PumpRotorVectorEnv": "envs.pump",
    "RotorEvaluation": "rotor.evaluation",
    "evaluate_rotors": "rotor.evaluation",
    "load_rotor": "rotor.rotor",
}
__all__ = sorted(_HOME)

register_envs()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("maglev-workbench")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
