"""Self-sensors in the rotor's lanes: their clocks, the common structure of both axes' sensors, and their rows."""

from collections.abc import Sequence


from maglev_env.experiment import Experiment, self_sensors
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import SingleSidedLaw
from maglev_env.loop.self_sensing_pieces import COIL_GAP, REST_CURRENT, SELF, SHIFT
from maglev_env.loop.sensor import Z1
from maglev_lanes.layout import LaneRows
from selfsense.kernel_pieces import SensorStructure
from selfsense.sensor import SelfSensor, samples_and_periods, sensor_rows, structure_of, whole_ratio


NO_SENSORS = 0, 1, 1, 1


def timing_of(experiment: Experiment, substeps: int = 1) -> tuple[int, int, int, int]:
    """Ratios of the self-sensors' clocks, (4,); NO_SENSORS without self-sensors.

    timing[0] current samples last as long as timing[1] substeps, and timing[2] of them as long as timing[3] PWM
    periods.

    Raises:
        ValueError: The rates are not in a ratio of small whole numbers.
    """
    if experiment.sensor == "probe":
        return NO_SENSORS
    sensors = self_sensors(experiment)
    if len({(s.acquisition.rate, samples_and_periods(s)) for s in sensors}) > 1:
        raise ValueError("self-sensing: both axes need the same sample rate and PWM frequency")
    return sensor_timing(sensors[0], experiment.rig.control_rate, substeps)


def sensor_timing(sensor: SelfSensor, control_rate: float, substeps: int) -> tuple[int, int, int, int]:
    """The ratios of `timing_of` of one self-sensor, with a number of substeps per control sample; control_rate: Hz.

    Raises:
        ValueError: The rates are not in a ratio of small whole numbers.
    """
    rate = sensor.acquisition.rate
    per_substep = whole_ratio(rate, control_rate * substeps)
    if per_substep is None:
        raise ValueError(
            f"self-sensing: its sample rate {rate:g} Hz and the control rate {control_rate:g} Hz are in no ratio of "
            "whole numbers below 1,000; change one of them"
        )
    return *per_substep, *samples_and_periods(sensor)


def sensed_structure(sensors: Sequence[SelfSensor]) -> SensorStructure | None:
    """The common structure of the sensors of all axes; None without sensors.

    A part that only one of them has gets neutral constants for the others.
    """
    structures = [structure_of(sensor, regulated=True) for sensor in sensors]
    if not structures:
        return None
    if len({(s.rms, s.emf, s.adc) for s in structures}) > 1:
        raise ValueError("self-sensing: both axes need the same kind of forward path, coil model and converter")
    return SensorStructure(*(any(column) for column in zip(*(vars(s).values() for s in structures), strict=True)))


def write_self_sensors(x: LaneRows, own: Sequence[Experiment]) -> None:
    """Write the self-sensors of one axis' experiments and their first reading; the magnets' rows are written before."""
    x[SELF] = sensor_rows([self_sensors(e)[0] for e in own])
    laws = [force_law(e.rig) for e in own]  # the coil's inductance does not follow an effect that reshapes the pull
    x[COIL_GAP] = [
        law.gap + (law.coil_gap if isinstance(law, SingleSidedLaw) else 0.0) - effect_value(e.effects, "eccentricity")
        for law, e in zip(laws, own, strict=True)
    ]
    x[REST_CURRENT] = [law.bias_current for law in laws]
    x[Z1] = x[SHIFT]
