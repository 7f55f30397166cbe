"""The controller's block: what lies between the reading and the command."""

from collections.abc import Mapping

from maglev_env.loop.card import EffectCard, Parameter

EFFECTS: Mapping[str, EffectCard] = {
    "delay": EffectCard(
        "controller",
        {"time": Parameter("s", 0.0, 1e-3, scale=1e-5, starts=(1e-5, 7.5e-5))},
        "computation and hold delay e^(-s T), 1 to 1.5 samples on real controllers",
        "command and current",
        ("magnets",),
    ),
}
