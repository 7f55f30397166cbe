"""Section 4.4.3: impulses on the levitated platform, with a mallet."""

import numpy as np

from estimation.bands import sliding_bands
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapter_figures import by_frequency
from maglev_workbench.commands.reproduce.chapters.shaker import (
    SWITCHING,
    Shaker,
    least_squares_bands,
    simulated,
    with_noise,
)
from maglev_workbench.commands.reproduce.item import Item, Outcome, Row

TOP = 200  # Hz
PEAKS = np.geomspace(2.0, 200.0, 21)  # N
LIGHT = 4.0  # N
NEAR = np.array([[14.0, 24.0]])  # Hz, around the mode


def run(seed: int) -> Outcome:
    """Blows of growing size with 100 mV of noise; then the platform identified from a light one and from SPHS."""
    rig = with_noise(load_rig("eframe"), SWITCHING)
    fell = np.array([_falls(rig, peak, seed) for peak in PEAKS])
    borne = float(PEAKS[: int(fell.argmax()) if fell.any() else len(PEAKS)][-1])
    blow = Shaker(TOP, LIGHT, kind="impulse")
    struck = simulated([rig], blow, [seed]).statistics
    shaken = simulated([rig], Shaker(TOP, 0.7), [seed]).statistics
    bands = sliding_bands(struck.frequency, 10.0, 8.0)
    by_blow, by_sphs = (least_squares_bands(s, NEAR, rig.mass) for s in (struck, shaken))
    pole = np.log(np.abs(closed_loop_poles(Experiment(rig, rig.gains, ()))).max()) * rig.control_rate
    velocity = _momentum(borne) / rig.mass
    rows = (
        Row(f"touchdowns under a blow of {1e3 * _momentum(LIGHT):.0f} mN s", "robust", float(_falls(rig, LIGHT, seed)),
            "", None, "Not compared: the mallet's blow is not published. With the 100 mV of noise that 4.4.3 reports."),
        Row("greatest blow that it bears", None, 1e3 * _momentum(borne), "mN s", None,
            f"{borne:.0f} N at the peak, {1e3 / TOP:.0f} ms wide: the platform starts with {1e3 * velocity:.0f} mm/s. "
            "A mallet of 100 g at 1 m/s has 100 mN s."),
        Row("slowest decay of the loop", None, float(-1 / pole), "s", None,
            "Time constant of its right-most pole: what a blow leaves is gone after a tenth of a second."),
        Row("stiffness, 14-24 Hz, by the blow over that by SPHS", None,
            float(by_blow.stiffness[0, 0] / by_sphs.stiffness[0, 0]), "", None,
            "The same estimator: a blow excites the lines as SPHS does, with a crest factor of 20 instead of 1.7."),
        Row("noise of the response by the blow over that by SPHS of the same peak", None,
            _noise(struck, LIGHT) / _noise(shaken, 0.7), "", None,
            "At the same peak a blow puts less force into every line: SPHS is the better test signal (Appendix A)."),
    )  # fmt: skip
    curves = [
        (name, least_squares_bands(s, bands, rig.mass).stiffness[0] * 1e-3)
        for name, s in ((f"blow of {LIGHT:g} N", struck), ("SPHS of 0.7 N", shaken))
    ]
    figure = by_frequency(bands.mean(axis=1), curves, "stiffness in kN/m")
    note = "A periodic blow is an excitation of every command: `maglev simulate --rig eframe --excite force=1:200@4 \
--kind impulse`. Blows that were recorded once are kind 'recorded'."
    return Outcome(rows, (("Stiffness by a blow and by SPHS", figure),), (note,))


def _momentum(peak: float) -> float:
    """Area of the blow (N s): its lines are in phase and as large."""
    return peak / (2 * TOP)


def _falls(rig: Rig, peak: float, seed: int) -> bool:
    drive = Excitation("impulse", "force", 1.0, tuple(range(1, TOP + 1)), float(peak))
    result = simulate_statistics([Experiment(rig, rig.gains, (drive,), 2, 1, seed=seed)])
    return not np.isnan(result.touchdown_time).all()


def _noise(statistics, peak: float) -> float:
    """Root mean square of the noise of G over the lines, times the peak of the force."""
    noise = statistics.cross("displacement", "displacement")[0].real / np.abs(statistics.amplitude("force")[0]) ** 2
    return peak * float(np.sqrt(noise.mean()))


ITEM = Item("mallet", "A mallet on the levitated platform", "Section 4.4.3", run)
