"""Section 4.3: averaging over five periods (Figure 4.6), and which estimates are significant (Figure 4.8)."""

import numpy as np

from estimation.bands import sliding_bands
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.chapters.shaker import (
    SWITCHING,
    Shaker,
    least_squares_bands,
    receptance,
    simulated,
    with_noise,
)
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row

DRAWS = 24
PERIODS = (2, 5, 20)
SHAKER = Shaker(200, 0.7)


def run(seed: int) -> Outcome:
    """Records of the platform with 100 mV of noise, averaged over 2, 5 and 20 periods."""
    rig = with_noise(load_rig("eframe"), SWITCHING)
    seeds = [DRAWS * seed + i for i in range(DRAWS)]
    scatter, spread, share = {}, {}, {}
    for periods in PERIODS:
        shaker = Shaker(SHAKER.last, SHAKER.amplitude, periods=periods)
        statistics = simulated([rig] * DRAWS, shaker, seeds).statistics
        bands = sliding_bands(statistics.frequency, 10.0, 8.0)
        fits = least_squares_bands(statistics, bands, rig.mass)
        scatter[periods] = receptance(statistics).std(axis=0, ddof=1)
        spread[periods] = fits.stiffness.std(axis=0, ddof=1) / np.abs(fits.stiffness.mean(axis=0))
        share[periods] = fits.stiffness_significant.mean(axis=0), fits.damping_significant.mean(axis=0)
    centre = bands.mean(axis=1)
    middle = (centre > 15) & (centre < 60)
    sure, unsure = share[5]
    rows = (
        Row("scatter of the response, 5 periods over 20", None, float(np.median(scatter[5] / scatter[20])), "", None,
            "2 by statistics: averaging of n periods divides white noise by sqrt(n), which Figure 4.6 shows."),
        Row("scatter of the stiffness with five periods, 15-60 Hz", "adequate", float(np.median(spread[5][middle])), "",
            None, f"Relative, median of the bands; with two periods it is {np.median(spread[2][middle]):.3f}. Not "
            "compared: the force is assumed, and the text gives no limit."),
        Row("the same at 150 Hz", "adequate", float(spread[5][np.abs(centre - 150).argmin()]), "", None,
            "The scatter falls with averaging; the bias of eq 4.13 under noise hardly does."),
        Row("stiffnesses that eq 4.22 calls significant, share", None, float(sure.mean()), "", None,
            "Of all bands and records, at 95 %. Figure 4.8 shows the text's; its words give no share."),
        Row("dampings that it calls significant, share", None, float(unsure.mean()), "", None,
            "The text calls none insignificant here, and all of the radial rig's (5.3.1)."),
    )  # fmt: skip
    plots = (
        ("Relative scatter of the stiffness", by_frequency(
            centre, [(f"{n} periods", spread[n]) for n in PERIODS], "scatter", log=True)),
        ("Share of records in which a coefficient is significant (Figure 4.8)", by_frequency(
            centre, (("stiffness", sure), ("damping", unsure)), "share")),
    )  # fmt: skip
    return Outcome(rows, plots)


ITEM = Item("averaging", "Five periods, and what is significant", "Section 4.3, Figures 4.6 and 4.8", run)
