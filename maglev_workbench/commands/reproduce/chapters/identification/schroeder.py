"""Appendix A: the Schroeder-phased harmonic sequence, its power and its crest factor."""

import numpy as np

from estimation.multisine.low_crest import low_crest
from estimation.multisine.sphs import crest_factor, random_phase, schroeder_phases, sphs, synthesise
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row
from maglev_workbench.page import COLOURS, styled

LINES = np.arange(1, 251)
SAMPLES = 20000  # a period of 1 s at 20 kHz
DRAWS = 25  # of random phases


def by_the_letter(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Phases (n,) by the recursion A.3 and one period (SAMPLES,) by A.2, both term by term, of power shares (n,)."""
    phases = np.zeros(len(share))
    for i in range(1, len(share)):
        phases[i] = phases[i - 1] - 2 * np.pi * share[:i].sum()
    t = np.arange(SAMPLES) / SAMPLES
    signal = sum(
        np.sqrt(p / 2) * np.cos(2 * np.pi * n * t + phase) for n, p, phase in zip(LINES, share, phases, strict=True)
    )
    return phases, signal


def run(seed: int) -> Outcome:
    """Power by A.2, phases by A.3, and crest factors (peak over rms) of 250 flat lines."""
    share = np.full(len(LINES), 1 / len(LINES))
    phases, literal = by_the_letter(share)
    turned = np.angle(np.exp(1j * (phases - schroeder_phases(share))))
    flat, best = sphs(LINES, SAMPLES), low_crest(LINES, SAMPLES, seed=seed)
    drawn = [random_phase(LINES, SAMPLES, DRAWS * seed + i) for i in range(DRAWS)]
    waves = [synthesise(m, SAMPLES) for m in (flat, best, drawn[0])]
    random = [crest_factor(synthesise(m, SAMPLES)) for m in drawn]
    hundred = crest_factor(synthesise(sphs(LINES[:100], SAMPLES), SAMPLES))
    lowest = round(crest_factor(waves[1]), 2)  # what an optimiser finds differs among machines beyond that
    rows = (
        Row("total power of a signal by A.2", 1.0, float(np.mean(literal**2)), "", 0.01,
            "A.1 makes the shares sum to 1; amplitudes sqrt(P/2) give a quarter of that as mean square, sqrt(2P) would "
            "give 1. Without effect on the results: every signal is scaled to its peak.", kind="consequence"),
        Row("largest difference of our phases from A.3", "the recursion A.3", float(np.abs(turned).max()), "rad", None,
            "The sum of the recursion; equal to rounding.", means=(0, 1e-9), kind="consequence"),
        Row("crest factor, lines 1 to 250", "lowest possible peak", crest_factor(waves[0]), "", None,
            "Peak over rms. Low, not the lowest possible: see the optimised phases.", means=(1, lowest),
            kind="prediction"),
        Row("crest factor, lines 1 to 100", "lowest possible peak", hundred, "", None, ""),
        Row("crest factor, phases optimised", None, crest_factor(waves[1]), "", None,
            "At the same peak every line carries more force, by the ratio of the crest factors."),
        Row(f"crest factor, random phases, least of {DRAWS}", None, min(random), "", None, ""),
        Row(f"crest factor, random phases, median of {DRAWS}", None, float(np.median(random)), "", None,
            "Twice the peak for the same power; but several draws show nonlinear distortion, which one Schroeder "
            "sequence cannot."),
    )  # fmt: skip
    return Outcome(rows, (("250 lines at the same peak", _figure(waves)),))


def _figure(waves):
    from plotly.graph_objects import Figure

    figure = Figure()
    names = ("Schroeder phases", "optimised phases", "random phases")
    for wave, name, colour in zip(waves, names, COLOURS, strict=True):
        shown = wave[: SAMPLES // 4 : 4]
        figure.add_scatter(
            x=np.arange(len(shown)) * 4 / SAMPLES, y=shown, name=name, line={"color": colour, "width": 1}
        )
    figure.update_xaxes(title_text="time in s").update_yaxes(title_text="signal over its peak")
    return styled(figure, 380)


ITEM = Item("sphs", "The excitation and its crest factor", "Appendix A, eq A.1-A.3", run)
