"""Conditions of x-y rigs: the eight coefficients from two experiments whose excitations are at right angles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimation.xy.planar import PlanarEstimate
from maglev_env.evaluation.identification_planar import PlanarIdentification, identify_planar
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig import Noise, Rig
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.coverage.counts import Coverage, counted, interval
from maglev_workbench.commands.coverage.disturbed import QUIET, Disturbed, of_power

BANDS = (40.0, 110.0)  # Hz: the bands nearest to these are counted
DIRECTIONS = (0.0, 90.0)
ENTRIES = {"xx": (0, 0), "xy": (0, 1), "yx": (1, 0), "yy": (1, 1)}


@dataclass(frozen=True)
class Crossed:
    """One kind of x-y experiment; the truth is the mean of what the same draws give without noise.

    Args:
        title: in words.
        rig: name of a preset.
        amplitude: factor of the amplitude of the protocol's force.
        bench: what disturbs the recordings as noise does.
        periods: that are kept; None for those of the protocol.
    """

    title: str
    rig: str = "hmb_radial"
    amplitude: float = 1.0
    bench: Disturbed = QUIET
    periods: int | None = None

    @property
    def nominal(self) -> Rig:
        """The rig that the estimate is told."""
        return load_rig(self.rig)

    def experiments(self, seed: int, draw: int) -> tuple[Experiment, ...]:
        """The experiments of one draw, one for each direction."""
        first = protocol_experiment(self.nominal)
        (force,) = (e for e in first.excitations if e.at == "force")
        size = force.amplitude * self.amplitude
        return tuple(
            replace(
                first,
                excitations=(
                    of_power(
                        replace(force, kind="multisine", seed=1000 * seed + 2 * draw + i, direction=direction),
                        size,
                        self.nominal,
                    ),
                ),
                periods=self.periods or first.periods,
                seed=(seed, draw, i),
            )
            for i, direction in enumerate(DIRECTIONS)
        )

    def drawn(self, seed: int, draw: int) -> tuple[PlanarIdentification, PlanarIdentification]:
        """What is identified of one draw, with its noise and without."""
        noisy = self.experiments(seed, draw)
        clean = [replace(e, rig=replace(e.rig, noise=Noise())) for e in noisy]
        return self._identified(noisy, self.bench), self._identified(clean, QUIET)

    def counted(self, drawn: Sequence[tuple[PlanarIdentification, PlanarIdentification]]) -> tuple[Coverage, ...]:
        """Counts of the eight coefficients in some bands."""
        middles = drawn[0][0].bands.mean(axis=1)
        rows = []
        for name in ("stiffness", "damping"):
            for entry, (i, j) in ENTRIES.items():
                for at in BANDS:
                    band = int(abs(middles - at).argmin())

                    def of(found: PlanarEstimate, what: str, place: tuple[int, int, int] = (band, i, j)) -> float:
                        return float(getattr(found, what)[place])

                    truth = float(np.mean([of(clean.estimate, name) for _, clean in drawn]))
                    ends = [(of(n.estimate, f"{name}_low"), of(n.estimate, f"{name}_high")) for n, _ in drawn]
                    given = [interval(*end, truth) if np.isfinite(end).all() else None for end in ends]
                    rows.append(counted(f"{name} {entry} at {at:.0f} Hz", given))
        return tuple(rows)

    def _identified(self, experiments: Sequence[Experiment], bench: Disturbed) -> PlanarIdentification:
        signals = [
            RecordedSignals(
                dict(bench.channels(e)), e.rig.control_rate, e.excitations, e.rig.control_rate, e.gains, axes=2
            )
            for e in experiments
        ]
        return identify_planar(signals, self.nominal, self.nominal.mass, band_overlap=0.0)


CROSSED: Mapping[str, Crossed] = {
    "crossed": Crossed("x-y: the preset hmb_radial, pushed along x, then y"),
    "crossed_large": Crossed("the same with three times the force", amplitude=3.0),
    "crossed_bent": Crossed("the same with ten times the force, which the magnets' law bends", amplitude=10.0),
    "crossed_turning": Crossed("the same with a rotor at 6,000 to 8,000 rpm", bench=Disturbed(turning=True)),
    "crossed_three_periods": Crossed("x-y: the preset hmb_radial, three periods", periods=3),
}
