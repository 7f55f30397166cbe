"""The self-sensors of a rig: coils, supply and estimator from its parameters and its [self_sensing] table."""

from dataclasses import replace
from functools import lru_cache

from maglev_env.loop.magnets.kinds import KINDS, check_turns, force_law
from maglev_env.loop.self_sensor import PATHS
from maglev_env.rig.rig import Rig, axis_rig
from selfsense.coil import Coil
from selfsense.design import design_pi
from selfsense.sensor import Estimator, SelfSensor
from selfsense.supply import Acquisition, Supply

LEAST_GAP, LARGEST_GAP = 0.02, 2.0  # limits of the estimated gap, as shares of the rig's gap


def rig_sensors(rig: Rig, nominal: Rig | None = None) -> tuple[SelfSensor, ...]:
    """The self-sensor of each axis of a rig, with estimators designed for the nominal rig; see `self_sensor`."""
    believed = nominal or rig
    return tuple(self_sensor(axis_rig(rig, axis), axis_rig(believed, axis)) for axis in range(rig.axes))


def coil_of(rig: Rig) -> Coil:
    """The upper coil of a one-axis rig.

    Raises:
        ValueError: The inductance of the rig's coil does not depend on the gap, or its turns are not known.
    """
    sensing = [name for name, kind in KINDS.items() if kind.inductance_follows_gap]
    if rig.magnet not in sensing:
        raise ValueError(
            f"rig {rig.name}: magnet = {rig.magnet!r} has no coil whose inductance follows the gap: "
            f"self-sensing needs a magnet of the kind {', '.join(sensing)}; use the probe"
        )
    check_turns(rig)
    law = force_law(rig)
    reach = rig.gap + law.magnet_gap
    return Coil(
        turns=rig.turns,
        pole_area=rig.pole_area,
        resistance=rig.coil_resistance,
        core_length=rig.self_sensing.core_length + 2 * law.coil_gap,
        magnet_emf=rig.turns * rig.pole_area * law.magnet_flux / reach**2,
        bias_field=law.magnet_flux / reach,
    )


def self_sensor(rig: Rig, nominal: Rig | None = None) -> SelfSensor:
    """The self-sensor of a one-axis rig.

    Args:
        rig: its coil, supply and acquisition.
        nominal: the rig for which the estimator is designed (default: the rig itself).

    Raises:
        ValueError: As `coil_of`, or no gains of the estimator reach the wanted lag.
    """
    s, believed = rig.self_sensing, nominal or rig
    supply = Supply(rig.supply_voltage, s.pwm_frequency, 2, s.dead_time)
    acquisition = Acquisition(s.sample_rate, s.adc_bits, s.current_range, rig.noise.current)
    estimator = _estimator(replace(coil_of(believed), magnet_emf=0.0, bias_field=0.0), believed)
    return SelfSensor(coil_of(rig), supply, acquisition, estimator, believed.gap)


def check_in_loop(sensor: SelfSensor) -> None:
    """Raise ValueError unless a self-sensor can close a levitation loop."""
    if sensor.supply.states != 2:
        raise ValueError(
            "self-sensing in a levitation loop needs a supply of two states: with three the coil hardly ripples near "
            "its resting current"
        )


def _estimator(coil: Coil, rig: Rig) -> Estimator:
    s = rig.self_sensing
    span = (LEAST_GAP * rig.gap, LARGEST_GAP * rig.gap)
    plain = Estimator(coil, rig.supply_voltage, s.kp or 0.0, s.ki or 0.0, span, PATHS[s.forward_path]())
    if s.kp is not None:
        return plain
    sensor = SelfSensor(coil, Supply(rig.supply_voltage, s.pwm_frequency), Acquisition(s.sample_rate), plain, rig.gap)
    kp, ki = _designed(sensor, s.lag, s.lag_frequency)
    return replace(plain, kp=kp, ki=ki)


@lru_cache(maxsize=256)
def _designed(sensor: SelfSensor, lag: float, frequency: float) -> tuple[float, float]:
    design = design_pi(sensor, lag, frequency)
    return float(design.kp), float(design.ki)
