"""The models that `maglev export` writes: of a rig its linearised loop, of recordings what was identified."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count

import numpy as np

from estimation.lines.frequency_response import frequency_response
from estimation.stability_margins import loop_gain
from maglev_env.evaluation.identification import Identification
from maglev_env.experiment import Experiment
from maglev_env.linear.control_systems import Matrices, linear_systems
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import Effects
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.rig import Rig

CONVENTIONS = (
    "All numbers are in SI units: A, m, N, s, kg; frequencies are in Hz.",
    "A positive force and a positive current move the rotor to positive displacement (y: toward the upper magnet).",
    "The controller acts on the error = reference - displacement, so it is given from the negative displacement; "
    "feedback is negative: loop gain L = controller * plant, sensitivity S = 1 / (1 + L).",
    "Sampled models are in z at the control rate, inputs held over each sample. Responses are complex, output / input; "
    "a variance is E|error|^2 of a response.",
    "A transfer function in z loses digits at frequencies far below the control rate; the state space keeps them.",
)
POINTS = 400  # of the frequency response of a rig
LOWEST, HIGHEST = 1.0, 0.45  # Hz; share of the control rate
Signals = tuple[str, str, str, str]  # input, its unit, output, its unit


@dataclass(frozen=True)
class Model:
    """One linear model; what it does not have is None.

    Attributes:
        name: A word that MATLAB and Python take as a name.
        about: What it is, in a sentence.
        signals: Input, its unit, output, its unit.
        sample_time: s; 0 for a continuous model, None for a measured frequency response.
        state_space: A (n, n), B (n, axes), C (axes, n), D (axes, axes).
        transfer_function: Numerator and denominator in descending powers of z or s; of one input and one output only.
        frequency: (n,), Hz.
        response: Complex, (n,), or (n, 2, 2) with indices [to, from] axis.
        variance: (n,) of a measured response.
    """

    name: str
    about: str
    signals: Signals
    sample_time: float | None
    frequency: np.ndarray
    response: np.ndarray
    state_space: Matrices | None = None
    transfer_function: tuple[np.ndarray, np.ndarray] | None = None
    variance: np.ndarray | None = None


# Name -> what it is, its signals, and the field of `LoopResponse` that is its response.
_OF_RIG: dict[str, tuple[str, Signals, str]] = {
    "plant": ("amplifier, magnets, rotor and probe", ("command", "A", "displacement", "m"), "plant"),
    "controller": ("controller", ("negative displacement", "m", "command", "A"), "controller"),
    "closed": ("closed loop", ("force", "N", "displacement", "m"), "receptance"),
}


def rig_models(rig: Rig, effects: Effects) -> list[Model]:
    """Plant, controller and closed loop of a rig with its gains; a rig without magnets has the last one only.

    Where the controller reads the coil's current, no loop can be broken, and the closed loop alone is given.

    Args:
        rig: Complete, see `with_defaults`; its own effects are in.
        effects: Added to these.
    """
    experiment = Experiment(rig, rig.gains or NO_CONTROLLER, (), effects=effects)
    frequency = np.geomspace(LOWEST, HIGHEST * rig.control_rate, POINTS)
    responses = loop_response(experiment, frequency)
    found = []
    for name, matrices in linear_systems(experiment).items():
        if not rig.controlled and name != "closed":
            continue
        what, signals, field = _OF_RIG[name]
        about = f"{what} of {rig.name}, linearised at rest, sampled at {rig.control_rate:g} Hz"
        if experiment.effects:
            about += f"; effects: {', '.join(experiment.effects)}"
        response = getattr(responses, field)
        one = Model(name, about, signals, 1 / rig.control_rate, frequency, response, matrices)
        found.append(replace(one, transfer_function=_transfer_function(matrices)) if rig.axes == 1 else one)
    return found


def identified_models(found: Sequence[tuple[str, Identification]]) -> list[Model]:
    """Measured responses, and the mode of bands that hold one, of every recording.

    Args:
        found: (file, what was identified of it).
    """
    models: list[Model] = []
    taken: set[str] = set()
    for file, one in found:
        stem = _name(file, taken)
        receptance, variance = frequency_response(one.statistics, "displacement", "force")
        force = "force, which the current stands for by the actuator's gain" if one.actuator else "force"
        signals = (force, "N", "displacement", "m")
        about = f"measured receptance of the rotor in {file}, without the nominal probe's lag and a converter's hold"
        measured = (one.statistics.frequency, receptance, np.real(variance))
        models.append(_measured(f"{stem}_receptance", about, signals, *measured))
        if one.natural_frequency is not None and one.damping_ratio is not None:
            models.append(_mode(f"{stem}_mode", file, one, signals, models[-1].frequency))
        if (s := one.stability) is not None:
            about = f"loop gain of {file}, {'measured' if s.source == 'injection' else s.source}"
            around = ("negative displacement", "m", "displacement", "m")
            measured = (s.frequency, loop_gain(s.sensitivity), s.variance / np.abs(s.sensitivity) ** 4)
            models.append(_measured(f"{stem}_loop_gain", about, around, *measured))
    return models


def _name(file: str, taken: set[str]) -> str:
    """A file's name as a word that is not taken yet."""
    word = re.sub(r"[^A-Za-z0-9]+", "_", re.sub(r"\.\w+(?=,|$)", "", file)).strip("_")
    word = word if word[:1].isalpha() else f"record_{word}"
    name = next(n for n in chain((word,), (f"{word}_{i}" for i in count(2))) if n not in taken)
    taken.add(name)
    return name


def _measured(
    name: str, about: str, signals: Signals, frequency: np.ndarray, response: np.ndarray, variance: np.ndarray
) -> Model:
    """A response at the lines that have one; without its variance where a single period cannot tell it."""
    known = np.isfinite(response)
    sure = variance[known] if np.isfinite(variance[known]).all() else None
    return Model(name, about, signals, None, frequency[known], response[known], variance=sure)


def _mode(name: str, file: str, one: Identification, signals: Signals, frequency: np.ndarray) -> Model:
    """1 / (m s^2 + c s + k) of the natural frequency and damping ratio that were found."""
    w, zeta = 2 * np.pi * (one.natural_frequency or 0.0), one.damping_ratio or 0.0
    denominator = one.mass * np.array([1.0, 2 * zeta * w, w**2])
    response = 1 / np.polyval(denominator, 2j * np.pi * frequency)
    about = f"mass, damping and stiffness of {file} around {one.natural_frequency:.4g} Hz"
    return Model(name, about, signals, 0.0, frequency, response, transfer_function=(np.ones(1), denominator))


def _transfer_function(matrices: Matrices) -> tuple[np.ndarray, np.ndarray]:
    from scipy.signal import ss2tf

    numerator, denominator = ss2tf(*matrices)
    return numerator[0], np.asarray(denominator)
