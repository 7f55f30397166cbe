"""Case study: the 75 Hz dip and the 30 degrees at 150 Hz of a self-sensing calibration; what explains them, what would
confirm it.

    python examples/calibration_dip.py --out docs/calibration_dip.png
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from maglev_env.campaign_writer import write_campaign
from maglev_env.effects import effect
from maglev_env.protocols import diagnosis_campaign
from maglev_env.recording import simulated_recording
from maglev_env.rig import Rig, load_rig
from maglev_env.simulate import simulate_records
from sim2real.diagnosis import Diagnosis, diagnose
from sim2real.report import sentence

DIP, TOP = 75.0, 150.0  # Hz, as published
DAMPING = 0.03  # of the resonance: the published text does not tell its width
# Readings of the published text, with what they may be off by: dB, degrees, degrees, dB.
FEATURES = {
    "level at 150 Hz": (0.0, 0.5),
    "phase at 150 Hz": (-30.0, 3.0),
    "dip": (3.0, 1.0),  # its size is not published: at least so much, to be seen
    "level around 75 Hz": (0.0, 0.5),
}
# Per line and period of 1 s: estimator noise as large as its signal, white up to 10 kHz, over the lines to 150 Hz; a
# probe of 0.5 um against 50 um.
ESTIMATE_NOISE, PROBE_NOISE = np.sqrt(TOP / 1e4), 0.01 * np.sqrt(TOP / 1e4)
DECIDED = 25.0  # squared separation: five standard deviations

Response = Callable[[np.ndarray, np.ndarray], np.ndarray]


def mode(f: np.ndarray, size: float, at: float = DIP) -> np.ndarray:
    """Motion of a mount in units of the displacement that drives it, by (k / m) / (k / m - w^2 + ...)."""
    return size / (1 - (f / at) ** 2 + 2j * DAMPING * f / at)


# Estimate over probe. On the probe's side an effect divides, so that a slow probe makes the estimate lead.
LAGS: Mapping[str, tuple[Response, float]] = {
    "delay": (lambda f, p: np.exp(-2j * np.pi * f * p[0]), 3e-4),
    "one pole": (lambda f, p: 1 / (1 + 2j * np.pi * f * p[0]), 3e-4),
    "two equal poles": (lambda f, p: 1 / (1 + 2j * np.pi * f * p[0]) ** 2, 2e-4),
    "second-order low-pass": (lambda f, p: 1 / (1 + 2**0.5 * (2j * np.pi * f * p[0]) - (2 * np.pi * f * p[0]) ** 2), 3e-4),
    "eddy current, order 1/2": (lambda f, p: 1 / (1 + np.sqrt(2j * np.pi * f * p[0])), 3e-4),
}  # fmt: skip


@dataclass(frozen=True)
class Candidate:
    """What may turn the estimate against the probe: response at (frequencies Hz, parameters), where a fit starts."""

    name: str
    response: Response
    start: tuple[float, ...]


def candidates() -> list[Candidate]:
    """Effects of the probe, of the estimator, and the probe's resonance beside each lag of the estimator."""
    probe = {
        "sensor_gain": (lambda f, p: np.full(f.shape, 1 / (1 + p[0])), 0.1),
        "sensor_lag": (lambda f, p: 1 + 2j * np.pi * f * abs(p[0]), 1e-4),
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
        cells += [f"{level:+.2f} dB", f"{phase:+.1f}°", f"{max(dip, 0.0):.1f}°", f"{around:.2f} dB"]
        rows.append("| " + " | ".join(cells + [f"{db:+.1f} dB, {turn:+.0f}°" for db, turn in beyond]) + " |")
    return rows


def separation(truth: np.ndarray, rival: Callable[[np.ndarray], np.ndarray], start: np.ndarray, sd: float) -> float:
    """Squared distance per period, in the noise sd of a line, from a response (n,) to the rival's nearest."""
    def off(u: np.ndarray) -> np.ndarray:
        d = (rival(u * start) - truth) * np.sqrt(2) / sd
        return np.concatenate([d.real, d.imag])

    return 2 * float(least_squares(off, np.ones(start.size)).cost)


def experiments() -> list[tuple[str, str, float]]:
    """What to do, what it tells apart, and periods of 1 s until that is decided at a noise-to-signal ratio of 1."""
    published = np.arange(1.0, TOP + 1)
    fitted = {c.name: (c, fit(c)[0]) for c in candidates()}
    rows = []
    for top in (150.0, 400.0, 1000.0):
        f = np.arange(1.0, top + 1)
        sd = ESTIMATE_NOISE * np.sqrt(top / TOP)  # one displacement, shared by more lines
        for one, other in (("delay", "second-order low-pass"), ("delay", "one pole")):
            (a, p), (b, q) = (fitted[f"{name} + sensor_resonance"] for name in (one, other))
            d2 = separation(a.response(f, p), lambda u, b=b, f=f: b.response(f, u), q, sd)
            rows.append((f"calibrate up to {top:g} Hz", f"{one} or {other}", DECIDED / d2))
    size = fitted["delay + sensor_resonance"][1][1]
    changes = {"plate twice as stiff": 2**0.5, "plate of 1.5 times the mass": 1.5**-0.5, "another probe": None}
    for what, moved in changes.items():
        after = np.zeros(published.size) if moved is None else mode(published, size * moved**-2, DIP * moved)
        truth = np.concatenate([1 / (1 - mode(published, size)), 1 / (1 - after)])
        # The rival sits on the estimator's side: before and after the same.
        d2 = separation(truth, lambda u: np.tile(1 + mode(published, u[0]), 2), np.array([size]), ESTIMATE_NOISE)
        rows.append((f"{what}, before and after", "mode of the probe's plate or of the magnets", DECIDED / d2))
    locked = separation(mode(published, size), lambda u: u[0] * published, np.array([size]), PROBE_NOISE)
    rows.append(("target locked, magnets driven: the probe alone", "does the plate move", DECIDED / locked))
    return rows


def record(folder: Path, rig: Rig, coupling: float, seed: int = 0) -> Path:
    """The rig with a probe mount that resonates at 75 Hz, recorded by the diagnosis protocol; the campaign does not know."""
    mount = effect("sensor_resonance", frequency=DIP, damping_ratio=DAMPING, coupling=coupling)
    recordings = []
    for plan in diagnosis_campaign(rig, rig.gains, mount, seed):
        data = simulated_recording(plan.experiment, simulate_records([plan.experiment])[0])
        recordings.append((plan.name, plan.role, data, plan.experiment))
    return write_campaign(folder, rig.name, {}, recordings)
