"""Five benches and what their engineers know: physics, records, and the rig.toml that describes them.

Each `rig_x(effect)` returns a Rig. `effect` changes the physics alone; what the engineer writes down stays. EFFECTS
lists the names: "none"; "gain" (the amplifier gives 20 % more), "delay" (one sample more, less of one on the slow
rigs), "law" (a force law of another slope), "friction", "log_filter" (the logged displacement passes a filter that the
controller's does not). Every mass is weighed to 0.2 %.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from math import exp, sqrt

import excite
import numpy as np
from bench import Bench
from physics import GRAVITY, Body, CurrentDrive, VoltageDrive, dipole, exponential, inverse_square, opposed_pair, slopes
from regulators import Cascade, Pid

EFFECTS = ("none", "gain", "delay", "law", "friction", "log_filter")


@dataclass(frozen=True)
class Record:
    """name, kind of excitation, reference m and injection A per tick, the controller, and its role in a campaign."""

    name: str
    kind: str
    controller: Callable[[], Pid | Cascade]
    reference: np.ndarray
    injection: np.ndarray | None = None
    role: str = "fit"
    start: float = 0.0


@dataclass(frozen=True)
class Rig:
    """A bench, its records, the text of rig.toml, and what is true of it.

    layout, channels: the engineer's own files: ending and form, and per channel (column, scale, offset, decimals), the
    value in the file being (SI - offset) / scale. chain: what campaign.toml states of a channel beside its column.
    """

    name: str
    bench: Bench
    records: list[Record]
    rig_toml: str
    truth: dict
    layout: dict
    channels: dict[str, tuple[str, float, float, int]]
    chain: dict[str, dict] = field(default_factory=dict)


def truth(bench: Bench, nominal: Bench, effect: str, **more: object) -> dict:
    """What a sealed envelope would hold: mass, slopes per ampere of command, damping, delays, and the effect."""
    drive = bench.drive
    per_command = drive.gain if isinstance(drive, CurrentDrive) else 1.0
    gain, stiffness = slopes(lambda y, i: bench.body.law(y, i * drive.gain), bench.rest)
    known, knows = slopes(nominal.body.law, nominal.rest)
    return {
        "effect": effect,
        "mass_kg": bench.body.mass,
        "actuator_gain_N_per_A": gain,
        "negative_stiffness_N_per_m": stiffness,
        "damping_N_s_per_m": bench.body.damping,
        "rest_current_A": bench.rest,
        "delay_s": bench.delay,
        "amplifier_gain": per_command,
        "current_meter": {"lag_s": bench.meter_lag, "scale": bench.meter_scale, "one_tick_late": bench.meter_late},
        "log_lag_s": bench.log_lag,
        "nominal": {
            "actuator_gain_N_per_A": known,
            "negative_stiffness_N_per_m": knows,
            "rest_current_A": nominal.rest,
        },
        **more,
    }


def hanging(law: Callable[[float, float], float], mass: float) -> float:
    """The current that carries the weight at y = 0, by bisection."""
    low, high = 0.0, 50.0
    for _ in range(80):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if law(0.0, mid) < mass * GRAVITY else (low, mid)
    return 0.5 * (low + high)


def pole_area(mass: float, current: float, gap: float, turns: int) -> float:
    """The area (m2) that makes mu_0 turns^2 area / 4 (current / gap)^2 the weight."""
    return 4 * mass * GRAVITY * gap**2 / (current**2 * 4e-7 * np.pi * turns**2)


def disturbed(
    bench: Bench, effect: str, other_law: Callable[[float, float], float], friction: float, delay: float
) -> Bench:
    """The bench with one effect; a hanging body's current follows."""
    if effect == "gain":
        drive = replace(bench.drive, gain=1.2)
        return replace(bench, drive=drive, rest=bench.rest / 1.2)
    if effect == "delay":
        return replace(bench, delay=bench.delay + delay)
    if effect == "law":
        rest = hanging(other_law, bench.body.mass) if bench.body.hangs else bench.rest
        return replace(bench, body=replace(bench.body, law=other_law), rest=rest)
    if effect == "friction":
        return replace(bench, body=replace(bench.body, friction=friction))
    if effect == "log_filter":
        return replace(bench, log_lag=3 * bench.dt)
    if effect != "none":
        raise ValueError(f"unknown effect {effect}; there are {', '.join(EFFECTS)}")
    return bench


def rig_a(effect: str = "none", seed: int = 1, form: str = "inverse_square", seconds: float = 30.0) -> Rig:
    """A steel ball of 58 g below a coil, PID of the position at 1 kHz, current amplifier of 1 ms, 12-bit reading."""
    mass, gap, dt, rest = 0.0583, 8e-3, 1e-3, 0.9
    offset, length = 3e-3, 5.5e-3  # both laws have the same slope at the gap
    square = inverse_square(mass * GRAVITY * (gap + offset) ** 2 / rest**2, gap, offset)
    expo = exponential(2 * mass * GRAVITY * length * exp(gap / length) / rest**2, gap, length)
    # another pole shape: nearer to an open gap, steeper by a third
    steep = inverse_square(mass * GRAVITY * gap**2 / 0.8**2, gap, 0.0)
    nominal = Bench(
        Body(mass, square if form == "inverse_square" else expo), CurrentDrive(1e-3), dt, rest, noise=5e-6,
        step=20e-3 / 4096, command_step=6.0 / 4096, stops=(-10e-3, gap), meter_lag=2e-3, meter_scale=0.01,
        meter_noise=3e-3, meter_step=6.0 / 4096, meter_late=True, limits=(0.0, 3.0),
    )  # fmt: skip
    bench = disturbed(nominal, effect, steep, 0.004, dt)
    soft, stiff = partial(Pid, 480.0, 1500.0, 8.0, 1.5e-3, dt), partial(Pid, 600.0, 2500.0, 10.0, 1.5e-3, dt)
    rng, n = np.random.default_rng(seed), round(seconds / dt)
    records = [
        Record("steps", "steps", soft, excite.steps(rng, n, dt, 0.25e-3, 1.5)),
        Record("chirp", "chirp", soft, excite.chirp(n, dt, 0.15e-3, 0.5, 25.0)),
        Record("sine", "one sine", soft, excite.sine(n, dt, 0.4e-3, 3.0)),
        Record("hover", "hover", soft, np.zeros(n)),
        Record("steps2", "steps", stiff, excite.steps(rng, n, dt, 0.3e-3, 1.0)),
        Record("last", "steps", stiff, excite.steps(rng, n, dt, 0.2e-3, 1.2), role="holdout"),
    ]
    toml = f"""schema = "maglev-rig/1"
name = "ball-58g"
magnet = "electromagnet"
axes = 1

[parameters]
mass = {mass}                  # weighed
gap = {gap + offset}                 # 8 mm of air, and 3 mm that the pull's fit adds
clearance = {gap}
turns = 1200
pole_area = {pole_area(mass, rest, gap + offset, 1200):.8g}  # K i^2 / x^2 is the weight
bias_current = {rest}
actuator_gain = {2 * mass * GRAVITY / rest:.6g}
negative_stiffness = {-2 * mass * GRAVITY / (gap + offset):.6g}
coil_inductance = 0.1
coil_resistance = 4.0
amplifier_gain = 0.3             # A/V
amplifier_time_constant = 1e-3
probe_gain = 1000.0              # V/m: 20 mm are 20 V
adc_bits = 12
dac_bits = 12
control_rate = 1000.0

[noise]
displacement = 5e-6
current = 3e-3

[tolerance]
mass = 0.002
actuator_gain = 0.05
negative_stiffness = 0.05
amplifier_time_constant = 0.2
"""
    return Rig(
        "A", bench, records, toml, truth(bench, nominal, effect, law=form if effect != "law" else "steeper"),
        {"ending": "csv", "separator": ";", "decimal": ",", "preamble": ["Kugel 58 g, PID", "Messung vom 3. Mai"]},
        {
            "time": ("Zeit [s]", 1.0, 0.0, 4),
            "reference": ("Sollabstand [mm]", -1e-3, gap, 4),
            "displacement": ("Abstand [mm]", -1e-3, gap, 4),
            "command": ("Sollstrom [A]", 1.0, -rest, 4),
            "current": ("Strom [A]", 1.0, -rest, 4),
        },
    )  # fmt: skip


def rig_b(effect: str = "none", seed: int = 2, seconds: float = 30.0) -> Rig:
    """A ball of 18 g at 100 Hz: an outer PID asks for a current, an inner PI for a voltage; L(x), R and EMF."""
    mass, gap, dt, length, rest = 0.018, 6e-3, 0.01, 15e-3, 0.42
    top = 2 * mass * GRAVITY * length * exp(gap / length) / rest**2
    law = exponential(top, gap, length)
    steep = exponential(2 * mass * GRAVITY * 11e-3 * exp(gap / 11e-3) / 0.42**2, gap, 11e-3)
    drive = VoltageDrive(3.0, 20e-3, top, gap, length, (-12.0, 12.0))
    nominal = Bench(
        Body(mass, law), drive, dt, rest, noise=15e-6, step=20e-3 / 4096, command_step=24.0 / 4096, substeps=20,
        stops=(-12e-3, gap), meter_noise=2e-3, meter_step=2.0 / 4096, sensor_lag=1e-3,
    )  # fmt: skip
    bench = disturbed(nominal, effect, steep, 0.002, 3e-3)

    def cascade(kp: float, ki: float, kd: float) -> Cascade:
        return Cascade(Pid(kp, ki, kd, 0.0, dt), 5.0, 150.0, bench.rest, feed=0.0)

    rng, n = np.random.default_rng(seed), round(seconds / dt)
    soft, stiff = partial(cascade, 70.0, 60.0, 1.7), partial(cascade, 80.0, 90.0, 2.0)
    records = [
        Record("escalon", "steps", soft, excite.steps(rng, n, dt, 0.8e-3, 3.0)),
        Record("chirp", "chirp", soft, excite.chirp(n, dt, 0.4e-3, 0.1, 6.0)),
        Record("senoidal", "one sine", soft, excite.sine(n, dt, 0.7e-3, 0.5)),
        Record("reposo", "hover", soft, np.zeros(n)),
        Record("multi", "steps", stiff, excite.steps(rng, n, dt, 1.0e-3, 2.0)),
        Record("final", "steps", stiff, excite.steps(rng, n, dt, 0.7e-3, 2.5), role="holdout"),
    ]
    toml = f"""schema = "maglev-rig/1"
name = "ball-18g"
magnet = "electromagnet"
axes = 1

[parameters]
mass = {mass}
gap = {2 * length}                  # the law's slope is that of L(x) = L0 + L1 exp(-x / 15 mm)
clearance = {gap}
turns = 1000
pole_area = {pole_area(mass, rest, 2 * length, 1000):.8g}
bias_current = {rest}
actuator_gain = {2 * mass * GRAVITY / rest:.6g}
negative_stiffness = {-mass * GRAVITY / length:.6g}
coil_inductance = {20e-3 + top * exp(-gap / length):.4g}
coil_resistance = 3.0
supply_voltage = 12.0
amplifier_gain = 0.1
amplifier_time_constant = 0.012   # the inner loop, roughly
sensor_time_constant = 1e-3
probe_gain = 1000.0
adc_bits = 12
dac_bits = 0
control_rate = 100.0

[noise]
displacement = 15e-6
current = 2e-3

[tolerance]
mass = 0.002
actuator_gain = 0.05
negative_stiffness = 0.05
amplifier_time_constant = 0.3
"""
    return Rig(
        "B", bench, records, toml, truth(bench, nominal, effect, law="exponential", cascade=[5.0, 150.0]),
        {"ending": "txt", "separator": "\t", "decimal": ".", "preamble": ["# t y_ref y i u i_ref"], "names": False},
        {
            "time": ("[0]", 1.0, 0.0, 3),
            "reference": ("[1]", -1.0, gap, 6),
            "displacement": ("[2]", -1.0, gap, 6),
            "current": ("[3]", 1.0, -rest, 5),
            "voltage": ("[4]", 1.0, 0.0, 4),
            "command": ("[5]", 1.0, -rest, 5),
        },
    )  # fmt: skip


def rig_c(effect: str = "none", seed: int = 3, seconds: float = 30.0) -> Rig:
    """A magnet of 16 g below an air coil, PD at 49 Hz with jittered ticks; two runs with gains that do not hold it."""
    mass, gap, rest, dt = 0.016, 60e-3, 1.0, 1 / 49
    law = dipole(mass * GRAVITY * gap**4 / rest, gap, 4.0)
    steep = dipole(mass * GRAVITY * gap**5.2 / rest, gap, 5.2)
    nominal = Bench(
        Body(mass, law), CurrentDrive(2e-3), dt, rest, noise=40e-6, step=100e-3 / 4096, substeps=20, jitter=0.08,
        stops=(-40e-3, 40e-3), meter_noise=5e-3, limits=(0.0, 5.0), command_step=1e-3,
    )  # fmt: skip
    bench = disturbed(nominal, effect, steep, 0.002, 4e-3)
    rng, n = np.random.default_rng(seed), round(seconds / dt)
    good, other, poor = (
        partial(Pid, 110.0, 0.0, 3.0, 0.0, dt),
        partial(Pid, 115.0, 0.0, 3.3, 0.0, dt),
        partial(Pid, 66.0, 0.0, 0.8, 0.0, dt),
    )
    records = [
        Record("run1", "steps", good, excite.steps(rng, n, dt, 2e-3, 3.0)),
        Record("run2", "steps", other, excite.steps(rng, n, dt, 2e-3, 2.0)),
        Record("run3", "chirp", good, excite.chirp(n, dt, 1e-3, 0.1, 4.0)),
        Record("run4", "hover", good, np.zeros(n)),
        Record("run5", "lost", poor, excite.steps(rng, n, dt, 2e-3, 2.0)),
        Record("run6", "lost", good, excite.steps(rng, n, dt, 2e-3, 2.0) + 30e-3 * (np.arange(n) > 0.7 * n)),
        Record("run7", "steps", good, excite.steps(rng, n, dt, 2e-3, 2.5), role="holdout"),
    ]
    toml = f"""schema = "maglev-rig/1"
name = "magnet-16g"
magnet = "magnet_coil"
axes = 1

[parameters]
mass = {mass}
gap = {gap}
clearance = 0.04
force_constant = {mass * GRAVITY * gap**4 / rest:.6g}
force_exponent = 4.0
bias_current = {rest}
coil_inductance = 5e-3
coil_resistance = 2.5
amplifier_gain = 0.5
amplifier_time_constant = 2e-3
probe_gain = 200.0
adc_bits = 12
dac_bits = 0
control_rate = 49.0

[noise]
displacement = 40e-6
current = 5e-3

[tolerance]
mass = 0.002
actuator_gain = 0.05
negative_stiffness = 0.05
amplifier_time_constant = 0.2
"""
    return Rig(
        "C", bench, records, toml, truth(bench, nominal, effect, law="C i / x^4", jitter_of_a_tick=0.08),
        {"ending": "csv", "separator": ",", "decimal": ".", "preamble": []},
        {
            "time": ("time_s", 1.0, 0.0, 5),
            "reference": ("setpoint_m", -1.0, gap, 6),
            "displacement": ("distance_m", -1.0, gap, 6),
            "command": ("i_cmd", 1.0, -rest, 4),
        },
    )  # fmt: skip


def rig_d(effect: str = "none", seed: int = 4, seconds: float = 10.0) -> Rig:
    """An opposed pair at 5 kHz, PID; white noise is added to the command and stored nowhere; integer counts."""
    mass, gap, bias, dt, factor = 3.0, 0.4e-3, 2.5, 2e-4, 2e-6
    law = opposed_pair(factor, gap, bias)
    steep = opposed_pair(factor * 0.81, gap * 0.9, bias)  # the same gain over a gap that is 10 % smaller
    nominal = Bench(
        Body(mass, law, hangs=False), CurrentDrive(2e-4), dt, noise=0.3e-6, step=1e-3 / 16384, command_step=20 / 4096,
        stops=(-0.2e-3, 0.2e-3), meter_lag=1e-4, meter_scale=0.01, meter_noise=5e-3, meter_step=20 / 4096,
    )  # fmt: skip
    bench = disturbed(nominal, effect, steep, 1.5, dt)
    rng, n = np.random.default_rng(seed), round(seconds / dt)
    soft, stiff = partial(Pid, 13000.0, 1e5, 17.0, 2e-4, dt), partial(Pid, 16000.0, 1e5, 20.0, 2e-4, dt)
    zero = np.zeros(n)
    records = [
        Record("noise1", "unstored noise", soft, zero, excite.white(rng, n, 0.05)),
        Record("noise2", "unstored noise", stiff, zero, excite.white(rng, n, 0.15)),
        Record("noise3", "unstored noise", soft, zero, excite.white(rng, n, 0.2)),
        Record("hover", "hover", soft, zero),
        Record("noise4", "unstored noise", stiff, zero, excite.white(rng, n, 0.1), role="holdout"),
    ]
    gain, stiffness = slopes(law, 0.0)
    toml = f"""schema = "maglev-rig/1"
name = "pair"
magnet = "electromagnet_pair"
axes = 1

[parameters]
mass = {mass}
gap = {gap}
clearance = 0.2e-3
turns = 100
pole_area = {4 * factor / (4e-7 * np.pi * 1e4):.6g}
bias_current = {bias}
actuator_gain = {gain:.6g}
negative_stiffness = {stiffness:.6g}
coil_inductance = 0.01
coil_resistance = 1.0
amplifier_gain = 1.0
amplifier_time_constant = 2e-4
probe_gain = 20000.0
adc_bits = 14
dac_bits = 12
control_rate = 5000.0
gravity = 0.0

[noise]
displacement = 0.3e-6
current = 5e-3

[tolerance]
mass = 0.002
actuator_gain = 0.05
negative_stiffness = 0.05
amplifier_time_constant = 0.2
"""
    return Rig(
        "D", bench, records, toml, truth(bench, nominal, effect, law="pair"),
        {"ending": "mat", "struct": "rec"},
        {
            "displacement": ("pos", 1e-3 / 16384, 0.0, 0),
            "command": ("out", 20 / 4096, 0.0, 0),
            "current": ("cur", 20 / 4096, 0.0, 0),
        },
    )  # fmt: skip


def rig_e(effect: str = "none", seed: int = 5, seconds: float = 10.0, flexible: bool = True) -> Rig:
    """A pair at 5 kHz with a flexible mode at 160 Hz: stepped sweep and chirps, injections and accelerations."""
    base = rig_d(effect, seed, seconds)
    mass, second, mode, zeta = 2.4, 0.6, 160.0, 0.01
    spring = second * (2 * np.pi * mode) ** 2
    body = replace(
        base.bench.body, mass=mass, flexible=(second, spring, 2 * zeta * sqrt(spring * second)) if flexible else None
    )
    bench = replace(base.bench, body=body)
    n, dt = round(seconds / bench.dt), bench.dt
    soft, stiff = partial(Pid, 12000.0, 8e4, 20.0, 2e-4, dt), partial(Pid, 14000.0, 8e4, 23.0, 2e-4, dt)
    zero = np.zeros(n)
    sweep = np.concatenate([np.arange(5.0, 60.0, 5.0), np.arange(60.0, 400.0, 10.0)])
    records = [
        Record("sweep", "stepped sweep", soft, zero, excite.stepped_sweep(n, dt, 0.15, sweep)),
        Record("chirp_up", "chirp", soft, zero, excite.chirp(n, dt, 0.15, 5.0, 400.0)),
        Record("chirp_big", "chirp", stiff, zero, excite.chirp(n, dt, 0.3, 5.0, 400.0)),
        Record("chirp_last", "chirp", stiff, zero, excite.chirp(n, dt, 0.15, 400.0, 5.0), role="holdout"),
    ]
    tail = f"""
[effects.support_resonance]
frequency = {mode}
damping_ratio = {zeta}
mass_ratio = {second / mass}
"""
    toml = base.rig_toml.replace("mass = 3.0", f"mass = {mass}").replace('name = "pair"', 'name = "amb"')
    return Rig(
        "E", bench, records, toml + (tail if flexible else ""),
        truth(bench, bench, effect, law="pair", flexible_mode_Hz=mode, second_mass_kg=second, zeta=zeta),
        {"ending": "csv", "separator": ",", "decimal": ".", "preamble": ["AMB test bench;rev 3"]},
        {
            "time": ("Time", 1.0, 0.0, 5),
            "injection": ("Exc_A", 1.0, 0.0, 5),
            "displacement": ("Pos_um", 1e-6, 0.0, 4),
            "command": ("Cmd_A", 1.0, 0.0, 5),
            "current": ("Cur_A", 1.0, 0.0, 5),
            "acceleration": ("Acc1_g", GRAVITY, 0.0, 5),
            "acceleration2": ("Acc2_g", GRAVITY, 0.0, 5),
        },
    )  # fmt: skip


RIGS = {"A": rig_a, "B": rig_b, "C": rig_c, "D": rig_d, "E": rig_e}
