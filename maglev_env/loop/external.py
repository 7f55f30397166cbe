"""What acts from outside the loop."""

from collections.abc import Mapping

from maglev_env.loop.card import EffectCard, Parameter, phase

EFFECTS: Mapping[str, EffectCard] = {
    "unbalance": EffectCard(
        "external",
        {"moment": Parameter("kg m", 0.0, 1.0), "phase": phase()},
        "a force m e Omega^2 at the speed of rotation",
        "displacement at two speeds",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `sim2real.tones`",
    ),
}
