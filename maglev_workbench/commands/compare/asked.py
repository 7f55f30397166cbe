"""Options of `maglev compare`: methods, budgets, and the check of their combinations."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from maglev_env.task.task import Task
from maglev_workbench.console import console
from tuning.comparison.compare import check_policy
from tuning.methods import LEARNED, METHODS, method_of

if TYPE_CHECKING:
    from tuning.learned.policy import HistoryPolicy

OWN = ("twin", "cases", "budgets", "processes", "seed", "out", "docs", "json_file")  # options of --twin
TWIN_BUDGET = 60
STRONG = ("quadratic@preset", "quadratic@rule", "cma-es@preset")  # in every comparison, beside the tuners as they are


def check_options(twin: bool, given: Sequence[str]) -> None:
    """Check the combination of options of `maglev compare`.

    Args:
        twin: whether --twin was given.
        given: parameter names of all options on the command line.

    Raises:
        ValueError: An option has no meaning with --twin, or without it.
    """
    if twin and (other := [name for name in given if name not in OWN]):
        shown = "METHOD" if other[0] == "methods" else f"--{other[0]}"
        raise ValueError(
            f"{shown} makes no sense with --twin: rigs, effects and protocol are those of the sealed set, and one "
            "tuner works on all three simulators; leave it out"
        )
    if not twin and (other := [name for name in given if name in ("cases", "processes")]):
        raise ValueError(f"--{other[0]} goes with --twin only; leave it out, or name an opened set by --twin")


def default_methods(task: Task, policy: "HistoryPolicy | None") -> list[str]:
    """All tuners that take any budget and are installed, and STRONG; the learned one only if a policy fits the task."""
    methods = [*(name for name, method in METHODS.items() if method.longest is None), *STRONG]
    for name in tuple(methods):
        try:
            method_of(name).check_installed()
        except ModuleNotFoundError as error:
            console.print(f"without {name}: {error}")
            methods.remove(name)
    try:
        check_policy(task, methods, policy)
    except (ValueError, ModuleNotFoundError) as error:
        if policy is not None:
            raise
        console.print(f"without {LEARNED}: {error}")
        methods.remove(LEARNED)
    return methods


def twin_budgets(text: str | None) -> tuple[int, int]:
    """Experiments on each simulator and on the twin, from "60" (the same for all), "300,60", or None for TWIN_BUDGET.

    Raises:
        ValueError: The text has another form.
    """
    try:
        numbers = [int(part) for part in text.split(",")] if text is not None else [TWIN_BUDGET]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or min(numbers) < 1:
        raise ValueError(
            f"--budgets {text!r}: with --twin give one number of experiments, or simulators,twin as 300,60"
        )
    return numbers[0], numbers[-1]


def parse_budgets(text: str) -> tuple[int, ...]:
    """Numbers of experiments from a text such as 10,30.

    Raises:
        ValueError: The text has another form.
    """
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"--budgets {text!r}: give whole numbers of experiments, as 10,30") from None
