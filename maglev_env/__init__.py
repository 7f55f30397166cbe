"""Magnetically levitated rigs: physics, effects, the lane simulator, experiments, recordings and the score.

Heavy parts load on first use; the environments are registered with Gymnasium on import.
"""

from importlib import import_module
from typing import Any

from maglev_env.envs.registration import register_envs

_HOME = {
    "Gains": "loop.gains",
    "Excitation": "rig.excitation",
    "Experiment": "experiment",
    "protocol_experiment": "experiment",
    "rig_sensors": "rig.self_sensor",
    "SelfSensing": "loop.self_sensor",
    "Rig": "rig.rig",
    "load_rig": "rig.rig",
    "with_parameters": "rig.rig",
    "effect": "loop.effect",
    "EFFECTS": "loop.effect",
    "simulate_statistics": "kernel.simulate",
    "simulate_records": "kernel.simulate",
    "Evaluation": "evaluation.evaluate",
    "evaluate": "evaluation.evaluate",
    "identify": "evaluation.identification",
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
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
