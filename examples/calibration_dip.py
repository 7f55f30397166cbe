"""Case study: a self-sensing calibration's dip at 75 Hz and 30 degrees at 150 Hz: what explains and what confirms it.

python examples/calibration_dip.py --out docs/calibration_dip.png
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from estimation.multisine.sphs import harmonic_range, sphs, synthesise
from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from selfsense.calibration.dynamic import dynamic_calibration
from sim2real.diagnosis import diagnose
from sim2real.report import sentence

DIP, TOP = 75.0, 150.0  # Hz, as published
COUPLING = 0.03  # of the simulated mount: a dip of 6 degrees on the eframe rig
DAMPING = 0.03  # of the resonance: the published text does not tell its width
# Readings of the published text, with what they may be off by: dB, degrees, degrees, dB.
FEATURES = {
    "level at 150 Hz": (0.0, 0.5),
    "phase at 150 Hz": (-30.0, 3.0),
    "dip": (3.0, 1.0),  # its size is not published: at least so much, to be seen
    "level around 75 Hz": (0.0, 0.5),
}
# Per line and period of 1 s: estimator noise as large as its signal, white up to 10 kHz, over the lines to 150 Hz; a
# probe of 0.5 µm against 50 µm.
ESTIMATE_NOISE, PROBE_NOISE = np.sqrt(TOP / 1e4), 0.01 * np.sqrt(TOP / 1e4)
NOISE_RATIOS = (0.2, 1.0, 5.0)  # "1 to 5", read either way
DECIDED = 25.0  # squared separation: five standard deviations
FEWEST, MOST = 2, 10_000  # periods: the noise is known from two on; nobody records more

Response = Callable[[np.ndarray, np.ndarray], np.ndarray]


def mode(f: np.ndarray, size: float, at: float = DIP) -> np.ndarray:
    """Motion of a mount in units of the displacement that drives it, by (k / m) / (k / m - w^2 + ...)."""
    return size / (1 - (f / at) ** 2 + 2j * DAMPING * f / at)


def turn(f: np.ndarray, p: np.ndarray) -> np.ndarray:
    """j w T."""
    return 2j * np.pi * f * p[0]


# Of the estimator, each with the time (s) at which a fit starts.
LAGS: Mapping[str, tuple[Response, float]] = {
    "delay": (lambda f, p: np.exp(-turn(f, p)), 3e-4),
    "one pole": (lambda f, p: 1 / (1 + turn(f, p)), 3e-4),
    "two equal poles": (lambda f, p: 1 / (1 + turn(f, p)) ** 2, 2e-4),
    "second-order low-pass": (lambda f, p: 1 / (1 + 2**0.5 * turn(f, p) + turn(f, p) ** 2), 3e-4),
    "eddy current, order 1/2": (lambda f, p: 1 / (1 + np.sqrt(turn(f, p))), 3e-4),
}


@dataclass(frozen=True)
class Candidate:
    """What may turn the estimate against the probe: response at (frequencies Hz, parameters), where a fit starts."""

    name: str
    response: Response
    start: tuple[float, ...]


def candidates() -> list[Candidate]:
    """Effects of the probe, of the estimator, and the probe's resonance beside each lag of the estimator."""
    probe = {  # below the fraction's line: where the probe lags, the estimate leads
        "sensor_gain": (lambda f, p: np.full(f.shape, 1 / (1 + p[0])), 0.1),
        "sensor_lag": (lambda f, p: 1 + abs(turn(f, p)) * 1j, 1e-4),
        "sensor_resonance": (lambda f, p: 1 / (1 - mode(f, p[0])), 0.003),
    }
    found = [Candidate(name, response, (start,)) for name, (response, start) in {**probe, **LAGS}.items()]
    return found + [
        Candidate(f"{name} + sensor_resonance", beside(response), (start, 0.003))
        for name, (response, start) in LAGS.items()
    ]


def beside(lag: Response) -> Response:
    """A lag of the estimator and a resonance of the probe's mount, its size the second parameter."""
    return lambda f, p: lag(f, p[:1]) / (1 - mode(f, p[1]))


def features(h: Response) -> np.ndarray:
    """The published features of a response, in the order of FEATURES; a dip counts from the line between 50 and 100 Hz,
    levels from 1 Hz and from that line."""
    f = np.arange(1.0, TOP + 0.5, 0.5)
    values = h(f)
    level = 20 * np.log10(abs(values / values[0]))
    phase = np.degrees(np.unwrap(np.angle(values / values[0])))
    near = (f >= DIP - 15) & (f <= DIP + 15)
    bent = [v[near] - np.interp(f[near], (50, 100), v[np.searchsorted(f, (50, 100))]) for v in (phase, level)]
    return np.array([level[-1], phase[-1], -bent[0].min(), np.max(abs(bent[1]))])


def misfit(found: np.ndarray) -> np.ndarray:
    """Features less the published ones in standard deviations; a dip that is deep enough to see is no misfit."""
    value, sd = np.array(list(FEATURES.values())).T
    off = (found - value) / sd
    off[2] = min(off[2], 0.0)
    return off


def fit(candidate: Candidate) -> tuple[np.ndarray, float]:
    """Parameters that fit the published features best, and chi-square."""

    def off(u: np.ndarray) -> np.ndarray:
        return misfit(features(lambda f: candidate.response(f, u * np.array(candidate.start))))

    best = least_squares(off, np.ones(len(candidate.start)), diff_step=1e-4)
    return best.x * np.array(candidate.start), 2 * float(best.cost)


def table() -> list[str]:
    """Every candidate with its chi-square, fitted parameters, features, and what it would do beyond the band."""
    heads = ["candidate", "χ²", "fitted", *FEATURES, "at 300 Hz", "at 1 kHz"]
    rows = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for c in candidates():
        p, chi2 = fit(c)
        level, phase, dip, around = features(lambda f, c=c, p=p: c.response(f, p))
        f = np.arange(1.0, 1001.0)
        h = c.response(f, p)
        beyond = [(20 * np.log10(abs(h / h[0]))[i], np.degrees(np.unwrap(np.angle(h)))[i]) for i in (299, 999)]
        cells = [c.name, f"{chi2:.1f}", " ".join(f"{v:.3g}" for v in p)]
        cells += [f"{level:+.2f} dB", f"{phase:+.1f}°", f"{abs(max(dip, 0.0)):.1f}°", f"{around:.2f} dB"]
        rows.append("| " + " | ".join(cells + [f"{db:+.1f} dB, {turn:+.0f}°" for db, turn in beyond]) + " |")
    return rows


def separation(truth: np.ndarray, rival: Callable[[np.ndarray], np.ndarray], start: np.ndarray, sd: float) -> float:
    """Squared distance per period, in a line's noise sd, of a response (n,) from the rival's nearest at any gain."""

    def off(u: np.ndarray) -> np.ndarray:
        d = (u[0] * rival(u[1:] * start) - truth) * np.sqrt(2) / sd
        return np.concatenate([d.real, d.imag])

    return 2 * float(least_squares(off, np.ones(start.size + 1)).cost)


def experiments() -> list[tuple[str, str, float]]:
    """What to do, what it tells apart, and the squared separation per period of 1 s."""
    fitted = {c.name: (c.response, fit(c)[0]) for c in candidates()}
    rows = []
    delayed, found = fitted["delay + sensor_resonance"]
    for top in (TOP, 400.0, 1000.0):
        f = np.arange(1.0, top + 1)
        sd = ESTIMATE_NOISE * np.sqrt(top / TOP)  # the same displacement, shared by more lines
        for other in ("second-order low-pass", "one pole"):
            response, start = fitted[f"{other} + sensor_resonance"]
            d2 = separation(delayed(f, found), lambda u, r=response, f=f: r(f, u), start, sd)
            rows.append((f"calibrate up to {top:g} Hz", f"delay or {other}", d2))
    f, size = np.arange(1.0, TOP + 1), found[1:]
    before = 1 / (1 - mode(f, size[0]))
    plates = {
        "the same calibration again": before,
        "plate twice as stiff": 1 / (1 - mode(f, size[0] / 2, DIP * 2**0.5)),
        "plate of 1.5 times the mass": 1 / (1 - mode(f, size[0], DIP / 1.5**0.5)),
        "a probe that stands elsewhere": np.ones_like(before),
    }
    for what, after in plates.items():  # a mode on the magnets' side stays as it is
        both = np.concatenate([before, after])
        d2 = separation(both, lambda u: np.tile(1 + mode(f, *u), 2), np.array([*size, DIP]), ESTIMATE_NOISE)
        rows.append((what, "the probe's plate or the magnets' side", d2))
    rows.append(("target locked, magnets driven: the probe alone", "does the plate move",
                 float(np.sum(2 * abs(mode(f, size[0])) ** 2) / PROBE_NOISE**2)))  # fmt: skip
    return rows


def plan() -> list[str]:
    """The experiments as a table: periods of 1 s until five standard deviations, by the noise of the estimate."""
    heads = ["experiment", "tells apart", *(f"periods, noise {r:g} times the signal" for r in NOISE_RATIOS)]
    rows = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for what, tells, d2 in experiments():
        ratios = [r if "locked" not in what else 1.0 for r in NOISE_RATIOS]
        periods = [max(FEWEST, ceil(DECIDED * r**2 / d2)) for r in ratios]
        rows.append(f"| {what} | {tells} | " + " | ".join(f"> {MOST}" if n > MOST else f"{n}" for n in periods) + " |")
    return rows


def delay_by_noise(ratio: float, periods: int = 20, rate: int = 20_000) -> tuple[float, float]:
    """Delay (s) and its standard error where white noise in the estimate, ratio times the signal, is all there is."""
    lines = harmonic_range(1, int(TOP))
    probe = np.tile(synthesise(sphs(lines, rate, 50e-6), rate), periods)
    estimate = probe + ratio * probe.std() * np.random.default_rng(0).standard_normal(probe.size)
    found = dynamic_calibration(probe, estimate, rate, 1.0, lines, periods)
    return found.delay, found.delay_se


def record(folder: Path, rig: Rig, coupling: float, seed: int = 0) -> Path:
    """The rig with a probe mount that resonates at 75 Hz, recorded; the campaign does not know of it."""
    mount = effect("sensor_resonance", frequency=DIP, damping_ratio=DAMPING, coupling=coupling)
    recordings = []
    for plan in diagnosis_campaign(rig, rig.gains, mount, seed):
        data = simulated_recording(plan.experiment, simulate_records([plan.experiment])[0])
        recordings.append((plan.name, plan.role, data, plan.experiment))
    return write_campaign(folder, rig.name, {}, recordings)


def picture() -> Figure:
    """Published features with what they may be off by, and what explains them, on to 1 kHz."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    f = np.geomspace(1, 1000, 2000)
    names = ["sensor_resonance", *(f"{name} + sensor_resonance" for name in LAGS)]
    for c in (c for c in candidates() if c.name in names):
        p, chi2 = fit(c)
        h = c.response(f, p)
        style = {"lw": 1.2, "label": f"{c.name}: χ² {chi2:.1f}"}
        upper.semilogx(f, 20 * np.log10(abs(h / h[0])), **style)
        lower.semilogx(f, np.degrees(np.unwrap(np.angle(h / h[0]))), **style)
    marks = {"color": "#222222", "capsize": 4, "ls": "", "marker": "o", "zorder": 5}
    flat = np.array([2, 5, 10, 20, 40, DIP, 110, TOP])
    upper.errorbar(flat, np.zeros(flat.size), FEATURES["level at 150 Hz"][1], label="published", **marks)
    lower.errorbar([TOP], [FEATURES["phase at 150 Hz"][0]], [FEATURES["phase at 150 Hz"][1]], **marks)
    lower.axvspan(DIP - 3, DIP + 3, color="#222222", alpha=0.15, label="published dip, of unknown size")
    upper.set(ylim=(-10, 3), ylabel="|estimate / probe| in dB")
    lower.set(ylim=(-120, 10), ylabel="phase in degrees", xlabel="frequency in Hz")
    upper.legend(loc="lower left", fontsize=8)
    lower.legend(handles=[lower.patches[0]], loc="lower left", fontsize=8)
    for axes in (upper, lower):
        axes.axvline(TOP, color="#999999", ls=":")
        axes.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description="What explains the self-sensing calibration, and what would confirm it."
    )
    parser.add_argument("--out", type=Path, default=Path("calibration_dip.png"))
    out = parser.parse_args().out
    print("\n".join([*table(), "", *plan(), ""]))
    for ratio in NOISE_RATIOS:
        delay, error = delay_by_noise(ratio)
        print(f"noise {ratio:g} times the signal, 20 periods: delay {1e6 * delay:+.0f} +- {1e6 * error:.0f} µs")
    with TemporaryDirectory() as folder:
        found = diagnose(record(Path(folder), load_rig("eframe"), COUPLING))
    print(sentence(found))
    picture().savefig(out, dpi=110, metadata={"Software": None})
    print(out)
