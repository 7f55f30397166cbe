"""Wrong parameters of the estimator: their errors along a moving gap, and their effect in a rig's levitation loop."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.experiment import protocol_experiment
from maglev_env.rig.rig import Rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_workbench.commands.selfsense.loop_facts import mean_with_half_width
from selfsense.robustness import MismatchErrors, mismatches, robustness
from selfsense.sensor import SelfSensor

SEEDS = 8  # experiments with noise of their own
REACH = 1 / 7  # of the gap: amplitude of the moving gap
CORE_SHARE = 0.06  # of the gap: core assumed where a rig gives none, 0.1 m of iron at 5000 times mu_0 beside 0.35 mm
AS_BELIEVED = "as believed"


@dataclass(frozen=True)
class Loop:
    """A levitation loop with a mismatch, (SEEDS,): whether it levitates, mean gap error (m), phase margin (degrees),
    peak |S|; nan where it does not."""

    levitates: np.ndarray
    gap_error_bias: np.ndarray
    phase_margin: np.ndarray
    peak_sensitivity: np.ndarray


@dataclass(frozen=True)
class Mismatch:
    """Errors of the sensor (of the first axis) by itself, and its loops: as it reads, and statically calibrated."""

    errors: MismatchErrors
    raw: Loop
    calibrated: Loop


@dataclass(frozen=True)
class Plan:
    """What to try on a rig: for each axis the sensors by mismatch, AS_BELIEVED first.

    assumed_core: core length (m) that the rig does not give, else None.
    """

    rig: Rig
    tables: tuple[Mapping[str, SelfSensor], ...]
    assumed_core: float | None


@dataclass(frozen=True)
class Robustness:
    """Every mismatch of a plan by name, and the seed of the loops' noise."""

    plan: Plan
    seed: int
    rows: Mapping[str, Mismatch]


def change_of(r: Robustness, loop: Loop, name: str) -> tuple[float, float]:
    """Mean change of a loop's quantity against no mismatch, in pairs of equal noise, and half its 95 % interval."""
    return mean_with_half_width(getattr(loop, name) - getattr(r.rows[AS_BELIEVED].raw, name))


def calibrated(sensor: SelfSensor, errors: MismatchErrors) -> SelfSensor:
    """The sensor with the correction of a static calibration around its resting gap."""
    return replace(sensor, scale=1 / errors.gain, shift=errors.offset / errors.gain)


def plan_robustness(rig: Rig) -> Plan:
    """The mismatches of `selfsense.robustness.mismatches` on a rig, the core of CORE_SHARE of its gap if it gives none.

    ValueError when its coils cannot sense, or magnets in their path leave the gap too small a share of the reluctance.
    """
    sensors, core = rig_sensors(rig), rig.self_sensing.core_length
    if any(s.coil.core_length > core for s in sensors):
        raise ValueError(
            f"rig {rig.name}: the control flux closes through the magnets (flux_path = {rig.flux_path!r}), and their "
            "length adds to the gap: these mismatches move the estimate out of its range; there is nothing to compare"
        )
    assumed = None if core else CORE_SHARE * rig.gap
    if assumed:
        sensors = tuple(_with_core(s, assumed) for s in sensors)
    return Plan(rig, tuple(map(_mismatches, sensors)), assumed)


def measure_robustness(
    plan: Plan, seed: int, threads: int | None = None, progress: Callable[[int], None] | None = None
) -> Robustness:
    """Every mismatch by itself, without noise, and in the loop of the rig's protocol at its gains, with noise.

    progress is called with the number of loop experiments done. ValueError when an estimate leaves its range.
    """
    found: dict[SelfSensor, dict[str, MismatchErrors]] = {}
    for table in plan.tables:
        believed = table[AS_BELIEVED]
        if believed not in found:  # both axes often have the same coil
            quiet = {name: _without_noise(one) for name, one in table.items()}
            found[believed] = {one.name: one for one in robustness(quiet, amplitude=REACH * believed.gap)}
    errors = [found[table[AS_BELIEVED]] for table in plan.tables]
    experiments = []
    for name in plan.tables[0]:
        raw = tuple(table[name] for table in plan.tables)
        mended = tuple(calibrated(one, own[name]) for one, own in zip(raw, errors, strict=True))
        for sensor in (raw, mended):
            experiments += [protocol_experiment(plan.rig, seed=(seed, i), sensor=sensor) for i in range(SEEDS)]
    evaluation = evaluate(experiments, threads, progress)
    rows = {}
    for i, name in enumerate(plan.tables[0]):
        loops = (_loop(evaluation, slice(k * SEEDS, (k + 1) * SEEDS)) for k in (2 * i, 2 * i + 1))
        rows[name] = Mismatch(errors[0][name], *loops)
    return Robustness(plan, seed, rows)


def _with_core(s: SelfSensor, length: float) -> SelfSensor:
    believed = replace(s.estimator, coil=replace(s.estimator.coil, core_length=length))
    return replace(s, coil=replace(s.coil, core_length=length), estimator=believed)


def _mismatches(s: SelfSensor) -> dict[str, SelfSensor]:
    """By name, plus and minus of one constant beside each other."""
    table = mismatches(s, bias_field=s.coil.bias_field)
    constants = [_constant(name) for name in table]
    return {name: table[name] for name in sorted(table, key=lambda name: constants.index(_constant(name)))}


def _constant(name: str) -> str:
    return name.rsplit(" ", 1)[0] if name.endswith("%") else name


def _without_noise(s: SelfSensor) -> SelfSensor:
    return replace(s, acquisition=replace(s.acquisition, bits=0, noise=0.0))


def _loop(e: Evaluation, of: slice) -> Loop:
    held = e.feasible[of]
    values = (e.gap_error_bias, e.margins["phase_margin"], e.margins["peak_sensitivity"])
    return Loop(held, *(np.where(held, v[of], np.nan) for v in values))
