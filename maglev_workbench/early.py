"""What is wrong with the options of a command, told before the imports that take longer than these checks do.

Each check is the one that the command makes, too, and so says the same.
"""

from collections.abc import Callable, Mapping
from typing import Any

from maglev_workbench.presets import PRESETS, is_rotor


def require_valid(options: Mapping[str, Any]) -> None:
    """Check what was given of a command's options, by name.

    Raises:
        ValueError: One of them is not valid.
        OSError: A file that one names cannot be read.
    """
    for name, check in _CHECKS.items():
        if options.get(name) not in (None, [], ()):
            check(options)


def _effects(options: Mapping[str, Any]) -> None:
    from maglev_env.loop.effect import parse_effects

    parse_effects(options["effect"])


def _rig(options: Mapping[str, Any]) -> None:
    if options["rig"] in PRESETS["rig"] or is_rotor(options["rig"]):
        return
    from maglev_env.rig.rig_file import load_rig

    load_rig(options["rig"])


def _goal(options: Mapping[str, Any]) -> None:
    from maglev_env.design.goals import goal_text
    from maglev_env.rig.goal import NAMED, parse_goal

    text = goal_text(options["goal"])
    # A rotor has quantities of its own.
    if text.strip() not in NAMED and not is_rotor(str(options.get("rig"))):
        parse_goal(text)


def _controller(options: Mapping[str, Any]) -> None:
    rig = options.get("rig")
    if not isinstance(rig, str) or is_rotor(rig):
        return
    from maglev_env.design.controllers import with_controller
    from maglev_env.design.defaults import with_defaults
    from maglev_env.rig.rig_file import load_rig

    with_controller(with_defaults(load_rig(rig)), options["controller"])


def _tuned(options: Mapping[str, Any]) -> None:
    from maglev_env.task.gain_box import parse_tuned

    parse_tuned(options["tuned"])


def _scheduler(options: Mapping[str, Any]) -> None:
    from maglev_lanes.schedule import scheduler_of

    scheduler_of(options["scheduler"])


_CHECKS: dict[str, Callable[[Mapping[str, Any]], None]] = {
    "effect": _effects,
    "rig": _rig,
    "goal": _goal,
    "controller": _controller,
    "tuned": _tuned,
    "scheduler": _scheduler,
}
