"""Conditions of recordings that never repeat: short runs of a loop whose rig is known to its tolerances."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy

from maglev_env.channels import SHOWN_BY, Place
from maglev_env.experiment import Experiment
from maglev_env.loop.axes import suffixes
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation
from maglev_workbench.commands.coverage.benches import BENCHES, Bench, Real, real
from maglev_workbench.commands.coverage.counts import Coverage, Interval, counted

if TYPE_CHECKING:
    import xarray as xr

    from sim2real.coefficients import Coefficient
    from sim2real.recorded.open_record import OpenRecord
    from sim2real.recorded.records import Record

SAMPLES = 20_000  # of a recording: 1 s at 20 kHz, 20 s of a ball at 1 kHz
SUBSTEPS = 5  # integration steps per control sample; the estimate's own simulation has one
STEPS = 8  # of the set point in a recording
CHIRP = (20.0, SAMPLES / 50)  # its ends, in periods of the recording: up to 1/50 of the control rate
SINE = SAMPLES / 400  # periods in the recording
LOUD = 0.5  # rms of the noise, of the current that the proportional gain asks for at the bench's travel

# One axis of an excitation, in multiples of the bench's travel or of the current that its proportional gain asks for
# there, over time in recordings.
Wave = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def _steps(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Set points of a person, who types round numbers."""
    levels = np.append(0.0, np.round(rng.uniform(-1, 1, STEPS), 1))
    return levels[np.searchsorted(np.sort(rng.uniform(size=STEPS)), time)]


def _chirp(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return scipy.signal.chirp(time, CHIRP[0], 1.0, CHIRP[1], "logarithmic", rng.uniform(0, 360))


def _noise(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return LOUD * rng.standard_normal(time.size)


def _sine(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.sin(2 * np.pi * (SINE * time + rng.uniform()))


# What happens on a bench: in words, where it acts, and its wave.
KINDS: Mapping[str, tuple[str, Place, Wave]] = {
    "steps": ("set-point steps", "reference", _steps),
    "chirp": ("a chirp on the command", "current", _chirp),
    "noise": ("white noise on the command, stored nowhere", "current", _noise),
    "sine": ("a set point that is one sine", "reference", _sine),
    "hover": ("nothing but noise", "reference", lambda time, rng: np.zeros_like(time)),
}


@dataclass(frozen=True)
class Aperiodic:
    """One kind of recording without a period, of one bench.

    Displacement, command and current are recorded, and the gains are known. The campaign is written and read as that
    of a user. The truth is the linearisation of the rig that is drawn.

    Args:
        bench: name of what is recorded.
        kind: name of its excitation.
    """

    bench: str
    kind: str

    @property
    def title(self) -> str:
        return f"{self.bench}, {KINDS[self.kind][0]}"

    def drawn(self, seed: int, draw: int) -> dict[str, Interval | None]:
        """Interval by coefficient; None where the recording does not bound it, and nothing where it is refused."""
        from sim2real.pooled import pooled

        # Conditions share no draws: a probe that is off would otherwise show in all of them.
        bench, rng = BENCHES[self.bench], np.random.default_rng([seed, draw, *(self.bench + self.kind).encode()])
        true = real(bench.rig, rng)
        _, at, wave = KINDS[self.kind]
        recorded = record(bench, true, at, wave, rng, (seed, draw))
        try:
            found = pooled(read(bench, {self.kind: recorded}))
        except ValueError:
            return {}
        return {c.name: _interval(c, true.truth[c.name]) for c in found.coefficients}

    def counted(self, drawn: Sequence[Mapping[str, Interval | None]]) -> tuple[Coverage, ...]:
        """Counts of each coefficient."""
        names = dict.fromkeys(name for one in drawn for name in one)
        return tuple(counted(name, [one.get(name) for one in drawn]) for name in names)


def record(
    bench: Bench, true: Real, at: Place, wave: Wave, rng: np.random.Generator, seed: tuple[int, ...]
) -> tuple["xr.Dataset", Experiment]:
    """A recording of a bench as it is, and the experiment that its engineer knows to be its cause.

    Args:
        bench: as its engineer describes it.
        true: as it is.
        at: where it is excited.
        wave: of each axis.
        rng: of the excitation and the noise of the current.
        seed: of the noise of the displacement.

    Raises:
        ValueError: the rotor touches down.
    """
    import xarray as xr

    from maglev_env.kernel.blocks import prepared
    from maglev_env.kernel.driven import Drive
    from maglev_env.kernel.replay import replayed

    rig, shape = bench.rig, (true.rig.axes, SAMPLES)
    assert isinstance(rig.gains, Gains)
    size = bench.travel if at == "reference" else bench.travel * rig.gains.kp
    waves = {place: np.zeros(shape) for place in SHOWN_BY}
    waves[at] = size * np.array([wave(np.arange(SAMPLES) / SAMPLES, rng) for _ in range(rig.axes)])
    e = Experiment(true.rig, rig.gains, (Excitation("none"),), effects=true.effects, seed=seed)
    displacement, current, command = replayed(prepared([e], SUBSTEPS), [Drive(e, waves)], threads=1)[0][0]
    if not np.isfinite(displacement).all():
        raise ValueError(f"the rotor of {rig.name} touches down under {at}; make the travel of the bench smaller")
    current = current + rig.noise.current * rng.standard_normal(shape)
    measured = {"displacement": displacement, "command": command + true.current, "current": current + true.current}
    columns = {
        name + end: ("time", own)
        for name, both in measured.items()
        for end, own in zip(suffixes(rig.axes), both, strict=True)
    }
    time = np.arange(SAMPLES) / rig.control_rate
    return xr.Dataset(columns, {"time": time}, {"sample_rate": rig.control_rate}), e


def read(bench: Bench, recorded: Mapping[str, tuple["xr.Dataset", Experiment]]) -> tuple["Record | OpenRecord", ...]:
    """Recordings by name as a user's campaign has them, written to a folder and read back."""
    from maglev_env.recordings.campaign_writer import write_campaign
    from sim2real.recorded.records import read_records

    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "nominal.toml"
        source.write_text(bench.toml)
        written = [(name, "fit", *one) for name, one in recorded.items()]
        return read_records(write_campaign(Path(folder) / "campaign", str(source), {}, written).parent)[1]


def _interval(c: "Coefficient", truth: float) -> Interval | None:
    return Interval(*c.interval, truth, (c.value - truth) / c.se) if c.identified else None


APERIODIC: Mapping[str, Aperiodic] = {f"{bench}_{kind}": Aperiodic(bench, kind) for bench in BENCHES for kind in KINDS}
