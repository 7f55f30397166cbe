"""Section 4.4: influence of PID gains on stiffness, damping and the response at resonance (Figures 4.9 to 4.12)."""

from dataclasses import replace
from math import inf

import numpy as np

from estimation.bands import sliding_bands
from estimation.effective import pid_effective_coefficients
from maglev_env.experiment import Experiment, without_noise
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.chapters.shaker import Shaker, least_squares_bands, receptance, simulated
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row

SHAKER = Shaker(200, 0.7)
FACTOR = {"kp": 1.25, "ki": 2.0, "kd": 1.25}
LOW, HIGH = 6.0, 100.0  # Hz, centres of bands
LIGHT = {"ki": 0.0, "kd": 2.0}  # little damping, to see what K_p's lag takes of it


def run(seed: int) -> Outcome:
    """The E-frame rig without noise at its preset gains and with each of them raised."""
    rig = load_rig("eframe")
    quiet = without_noise(Experiment(rig, rig.gains, ())).rig
    changed = {name: replace(rig.gains, **{name: getattr(rig.gains, name) * by}) for name, by in FACTOR.items()}
    every = [rig.gains, *changed.values()]
    statistics = simulated([quiet] * len(every), SHAKER, [seed] * len(every), every).statistics
    bands = sliding_bands(statistics.frequency, 10.0, 8.0)
    f = bands.mean(axis=1)
    fits = least_squares_bands(statistics, bands, rig.mass)
    size = np.abs(receptance(statistics))
    peaks = size.max(axis=1)
    resonance = statistics.frequency[size.argmax(axis=1)]
    gain, pull = linearise(force_law(rig))
    effective = [pid_effective_coefficients(f, g.kp, g.ki, g.kd, g.td, gain, pull) for g in every]
    low, high = (int(np.abs(f - hz).argmin()) for hz in (LOW, HIGH))
    near = int(np.abs(f - resonance[0]).argmin())
    row = {"kp": 1, "ki": 2, "kd": 3}

    def stiffness(name: str, band: int) -> float:
        return 100 * float(fits.stiffness[row[name], band] / fits.stiffness[0, band] - 1)

    def damping(name: str, band: int) -> float:
        return float(fits.damping[row[name], band] - fits.damping[0, band])

    def peak(name: str) -> float:
        return 100 * float(peaks[row[name]] / peaks[0] - 1)

    def promised(name: str, which: int, band: int) -> float:
        return float(effective[row[name]][which][band] - effective[0][which][band])

    lag, light = _lag(rig), _light_peak(rig)
    taken = gain * (FACTOR["kp"] - 1) * rig.gains.kp * lag
    allowed = 2 * fits.stiffness[0, near] * lag
    rows = (
        Row("K_p + 25 %: stiffness near resonance", "increases", stiffness("kp", near), "%", None, "As published.",
            means=(0, inf), kind="prediction"),
        Row("K_p + 25 %: resonance", "increases", float(resonance[1] - resonance[0]), "Hz", None, "As published.",
            means=(0, inf), kind="prediction"),
        Row("K_p + 25 %: damping, low range", "increases", damping("kp", low), "N s/m", None,
            f"Not as published. The lag takes {taken:.1f} N s/m, at every frequency; the rest is the fit: from 1 to 11 "
            "Hz the damping runs from -357 to 25 N s/m, and a constant one weighs that anew with every gain.",
            means=(0, inf), kind="prediction"),
        Row("K_p + 25 %: damping, 100 Hz", "decreases", damping("kp", high), "N s/m", None,
            f"As published. Eq 4.7 knows no such effect; the lag of {lag * 1e3:.2f} ms between reading and force makes "
            "it.", means=(-inf, 0), kind="prediction"),
        Row("K_p + 25 %: response at resonance", "increases", peak("kp"), "%", None,
            "Not as published: stiffer means less response, unless the damping lost outweighs it. That needs a damping "
            f"below about 2 k times the lag, {allowed:.1f} N s/m; here it is {fits.damping[0, near]:.0f}.",
            means=(0, inf), kind="prediction"),
        Row("the same with little damping (K_d = 2 A s/m, no K_i)", "increases", light, "%", None,
            "As published: the published rise asks for a rig with hardly any damping, or with more lag than ours.",
            means=(0, inf), kind="prediction", again="gain-influence"),
        Row("K_i doubled: stiffness, low range", "increases", stiffness("ki", low), "%", None,
            "As published: an integrator that is a low-pass (eq 3.27) adds a real part at low frequency. Eq 4.7 has an "
            f"ideal one and gives {promised('ki', 0, low):.0f}.", means=(0, inf), kind="prediction"),
        Row("K_i doubled: damping, low range", "decreases significantly", damping("ki", low), "N s/m", None,
            f"As published; eq 4.7 gives {promised('ki', 1, low):.0f}.", means=(-inf, -5), kind="prediction"),
        Row("K_i doubled: response at resonance", "increases", peak("ki"), "%", None, "As published.",
            means=(0, inf), kind="prediction"),
        Row("K_i doubled: stiffness, 100 Hz", "negligible", stiffness("ki", high), "%", None, "As published.",
            means=(-2, 2), kind="prediction"),
        Row("K_d + 25 %: damping near resonance", "increases", damping("kd", near), "N s/m", None, "As published.",
            means=(0, inf), kind="prediction"),
        Row("K_d + 25 %: response at resonance", "reduced significantly", peak("kd"), "%", None, "As published.",
            means=(-inf, -10), kind="prediction"),
        Row("K_d + 25 %: stiffness, low range", "a little", stiffness("kd", low), "%", None, "As published.",
            means=(-5, 5), kind="prediction"),
        Row("K_d + 25 %: stiffness, 100 Hz", "increases", stiffness("kd", high), "%", None,
            "As published; but eq 4.7, which is said not to give it, does: its term K_d tau_d w^2 makes "
            f"{100 * promised('kd', 0, high) / effective[0][0][high]:+.0f} %.", means=(0, inf), kind="prediction"),
    )  # fmt: skip
    names = ("preset", "K_p + 25 %", "K_i doubled", "K_d + 25 %")
    curves = [tuple(zip(names, values, strict=True)) for values in (fits.stiffness * 1e-3, fits.damping, size)]
    plots = (
        ("Stiffness (Figures 4.9 to 4.12)", by_frequency(f, curves[0], "stiffness in kN/m")),
        ("Damping", by_frequency(f, curves[1], "damping in N s/m")),
        ("Response", by_frequency(statistics.frequency, curves[2], "m/N", log=True)),
    )
    note = (
        "Directions only: the gains of this rig and their changes are not published. Without noise, so that no "
        "direction is drowned. Low range: the band of 1 to 11 Hz."
    )
    return Outcome(rows, plots, (note,))


def _lag(rig: Rig) -> float:
    """Delay (s) from the reading to the magnets' force at low frequency: half a hold period, amplifier and probe."""
    return 0.5 / rig.control_rate + rig.amplifier_time_constant + rig.sensor_time_constant


def _light_peak(rig: Rig) -> float:
    """Change (%) of the largest response by 25 % more K_p on the linearised rig with little damping."""
    frequency = np.arange(10.0, 40.0, 0.01)
    gains: list[Gains] = [replace(rig.gains, kp=rig.gains.kp * by, **LIGHT) for by in (1.0, FACTOR["kp"])]
    before, after = (np.abs(loop_response(Experiment(rig, g, ()), frequency).receptance).max() for g in gains)
    return float(100 * (after / before - 1))


ITEM = Item("gain-influence", "What the PID gains do", "Section 4.4, Figures 4.9 to 4.12", run)
