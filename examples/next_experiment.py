"""Does the proposed experiment decide? Rigs with one effect each, poorly recorded, and recorded again as proposed.

    python examples/next_experiment.py [COUNT]

Every rig is simulated with one effect and parameters off by their tolerances; one recording of few channels is
diagnosed. Where the answer is a class that holds the truth, the recording that the diagnosis asks for is simulated,
added to the campaign, and all is diagnosed again: it decides when the truth alone is named.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from maglev_env.design.protocols import diagnosis_campaign
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER, with_gains
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real import diagnose
from sim2real.compared.point import Point, experiment_at, tolerances

RIG = "hmb_free"
POOR = (("displacement", "force"), ("displacement", "injection"))  # channels of the first recording
EFFECTS = (
    effect("delay", 6e-5),
    effect("actuator_gain", 0.3),
    effect("sensor_lag", 6e-5),
    effect("sensor_gain", 0.12),
    effect("amplifier_lag", 1.2e-4),
    effect("negative_stiffness", 0.6),
    effect("eddy_current", 2500.0),
    effect("sensor_resonance", 90.0, damping_ratio=0.03, coupling=0.05),
    effect("mass", 0.15),
    effect("support_resonance", 140.0, damping_ratio=0.03, mass_ratio=0.05),
)


def cases():
    """(channels, effects, seed) without end."""
    for seed in range(1000):
        for effects in EFFECTS:
            for channels in POOR:
                yield channels, effects, seed


def true_experiment(rig: Rig, effects: Mapping, seed: int) -> Experiment:
    """A recording of a rig with effects, its parameters off by their tolerances, the loop injected and shaken."""
    rng = np.random.default_rng([seed, *map(ord, "".join(effects))])
    e = diagnosis_campaign(rig, rig.gains or NO_CONTROLLER, {}, seed)[0].experiment
    changes = {name: float(sigma * rng.standard_normal()) for name, sigma in tolerances(rig).items()}
    return experiment_at(replace(e, effects=effects), Point(effects, changes))


def carried_out(e: Experiment, change: Mapping[str, Any], seed: int) -> Experiment:
    """The recording that a proposal asks for."""
    e = replace(e, seed=(seed, 99))
    if factor := change.get("amplitude"):
        e = replace(e, excitations=tuple(replace(x, amplitude=factor * x.amplitude) for x in e.excitations))
    if offset := change.get("offset"):
        e = replace(e, offset=e.offset + offset)
    if factors := change.get("gains"):
        kp, kd = factors
        e = replace(e, gains=with_gains(e.gains, kp=kp * e.gains.kp, kd=kd * e.gains.kd))
    if new := change.get("excitation"):
        left = [replace(x, lines=tuple(n for n in x.lines if n not in new["lines"])) for x in e.excitations]
        drawn = {"fundamental": e.fundamental, "amplitude": new["peak"], "seed": 99}
        added = Excitation("multisine", new["at"], lines=tuple(new["lines"]), **drawn)
        e = replace(e, excitations=(*(x for x in left if x.lines), added))
    return e


def decided(
    channels: tuple[str, ...], effects: Mapping, seed: int
) -> tuple[str, tuple[str, ...], str, tuple[str, ...]]:
    """First verdict and cause, what was proposed ("" for nothing to decide), and the cause named then."""
    rig = load_rig(RIG)
    truth = true_experiment(rig, effects, seed)
    only = [x for x in truth.excitations if x.at == ("force" if "force" in channels else "current")]
    base = replace(truth, excitations=tuple(only))
    with TemporaryDirectory() as folder:
        rows = [("base", "fit", simulated_recording(base, simulate_records([base])[0])[list(channels)], base)]
        write_campaign(Path(folder) / "a", RIG, {}, rows)
        first = diagnose(Path(folder) / "a")
        (name,) = effects
        if (
            first.verdict != "ambiguous"
            or name not in first.cause
            or not (first.next_experiments and first.next_experiments.proposals)
        ):
            return first.verdict, first.cause, "", ()
        proposed = first.next_experiments.proposals[0]
        e = carried_out(base, proposed.change, seed)
        kept = list(channels) + proposed.change.get("channels", [])
        if "excitation" in proposed.change:
            kept += [{"force": "force", "current": "injection"}[proposed.change["excitation"]["at"]]]
        if "offset" in proposed.change:
            kept += ["reference"]
        dataset = simulated_recording(e, simulate_records([e])[0])
        rows.append(("next", "fit", dataset[[c for c in dict.fromkeys(kept) if c in dataset]], e))
        write_campaign(Path(folder) / "b", RIG, {}, rows)
        second = diagnose(Path(folder) / "b")
    return first.verdict, first.cause, proposed.what, second.cause if second.verdict == "explained" else ()


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    told = []
    for channels, effects, seed in islice(cases(), count):
        verdict, cause, proposed, named = decided(channels, effects, seed)
        (name,) = effects
        words = f"{name} by {'+'.join(channels)}: {verdict} {', '.join(cause)}"
        if proposed:
            told.append(named == (name,))
            words += f" -> {proposed} -> {', '.join(named) or 'still a class'}"
        print(words, flush=True)
    print(f"{sum(told)} of {len(told)} classes decided by the experiment that was proposed")


if __name__ == "__main__":
    main()
