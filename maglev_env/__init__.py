"""Magnetically levitated rigs: physics, effects, the lane simulator, experiments, recordings and the score.

Heavy parts load on first use; the environments are registered with Gymnasium on import.
"""

from importlib import import_module
from typing import Any

from maglev_env.envs.registration import register_envs

_HOME = {
    "Gains": "gains",
    "Excitation": "excitation",
    "Experiment": "experiment",
    "protocol_experiment": "experiment",
    "rig_sensors": "experiment",
    "SelfSensing": "self_sensing",
    "Rig": "rig",
    "load_rig": "rig",
    "with_parameters": "rig",
    "effect": "effects",
    "EFFECTS": "effects",
    "simulate_statistics": "simulate",
    "simulate_records": "simulate",
    "Evaluation": "evaluation",
    "evaluate": "evaluation",
    "identify": "identification",
    "RecordedSignals": "record_spectra",
    "load_campaign": "campaign",
    "read_recording": "recording",
    "recorded_signals": "recorded",
    "write_campaign": "campaign_writer",
    "with_defaults": "defaults",
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
