"""What recordings at gains of a rig that differs from the nominal one would show, without making them."""

from dataclasses import replace

import numpy as np

from maglev_env.design.defaults import with_defaults
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.experiment import protocol_experiment
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect
from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.protocol import env_protocol
from tuning.campaign.gain_set import GainSet, Response

LOADED = with_defaults(load_rig("hmb_free"))
RIG = replace(LOADED, protocol=env_protocol(LOADED, "quick"))
PRESET = RIG.gains
TRUTH = {"mass": 1.012, "actuator_gain": 0.85, "negative_stiffness": 1.2, "amplifier_time_constant": 1.1}
DELAY = 4e-5


def true_rig(**effects):
    return replace(scaled_rig(RIG, TRUTH), effects={**effect("delay", DELAY), **effects})


def gain_set(rig, gains=PRESET, noise=2e-3, seed=0, name="run1.npz"):
    """What a recording at gains shows, exactly but for relative noise on each line."""
    e, rng = protocol_experiment(rig, gains), np.random.default_rng(seed)
    force, injected = (lines_at(e.excitations, place) * e.fundamental for place in ("force", "current"))

    def curve(frequency, value):
        noisy = value * (1 + noise / np.sqrt(2) * (rng.standard_normal((2, value.size)).T @ [1, 1j]))
        return Response(frequency, noisy, (noise * np.abs(value)) ** 2)

    x = force / rig.control_rate
    shaken, loop = loop_response(e, force), loop_response(e, injected)
    statistics = force_statistics(expected_statistics(e, lines_at(e.excitations, "force")), e)
    return GainSet(
        gains, (name,), curve(force, shaken.receptance / (np.sinc(x) * np.exp(-1j * np.pi * x))),
        curve(injected, loop.sensitivity), curve(injected, loop.plant), (statistics,), 2e-5, 0.05, None,
    )  # fmt: skip
