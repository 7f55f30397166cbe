"""`maglev tune --rig pump`: both controllers of a rotor are tuned to a goal over its speeds, and then checked."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from shlex import quote
from time import perf_counter

import numpy as np

from maglev_env.design.goals import goal_text
from maglev_env.recordings.formats.json_data import plain
from maglev_env.rig.goal import ENGINEER, MATCH
from maglev_env.rotor.requirements import evaluate_goal
from maglev_env.rotor.rotor import load_rotor
from maglev_env.task.gain_box import parse_tuned
from maglev_env.task.pump_episodes import RotorEpisode
from maglev_env.task.pump_goal import SPEEDS, RotorGoalTask, make_rotor_goal_task
from maglev_lanes.schedule import workers
from maglev_workbench.commands.runup.asked import check_reach, parse_speeds, with_rejection
from maglev_workbench.commands.runup.report import run_up_json
from maglev_workbench.commands.runup.study import report
from maglev_workbench.commands.tune.report import tune_json, tune_page, tune_tables
from maglev_workbench.commands.tune.rotor_report import check_lines, found_json, sections, terminal_table
from maglev_workbench.console import console, progress_bar, write_json
from maglev_workbench.goal_label import goal_label
from maglev_workbench.options import require_apart, require_folder
from maglev_workbench.page import write_page
from tuning.methods import METHODS, make_tuner
from tuning.study.recommendation import recommend
from tuning.study.study import JOURNAL, SPEC, run_study

METHOD, BUDGET, BATCH = "nelder-mead", 400, 8
ONE_AXIS = ("model", "rule", "learned")  # tuners that are made for one axis
MEANT = ("rig", "method", "budget", "batch", "tuned", "goal", "speeds", "rejection", "seed", "threads", "scheduler")
MEANT += ("out", "json_file")  # options that have a meaning for a rotor
CHECKED = 500.0  # rpm between the speeds of the run-up that checks what is recommended
REPEATS, ROTORS, CANDIDATES = 3, 16, 6


def run(
    source: str,
    method: str | None,
    budget: int | None,
    batch: int | None,
    tuned: Sequence[str],
    goal: str | None,
    speeds: str | None,
    rejection: float | None,
    seed: int,
    threads: int | None,
    scheduler: str | None,
    out: Path | None,
    json_file: Path | None,
    named: Sequence[str],
) -> None:
    """Tune a rotor and check the result; the options are those of `maglev tune`, named those on the command line.

    Raises:
        ValueError: An option has no meaning for a rotor or is not valid.
    """
    if extra := [name for name in named if name not in MEANT]:
        raise ValueError(f"{', '.join(f'--{name}' for name in extra)}: not for a rotor, which is tuned by its PID "
                         "gains, read by its probes")  # fmt: skip
    method, budget, batch = method or METHOD, budget or BUDGET, batch or BATCH
    if method in ONE_AXIS or "@" in method:
        others = ", ".join(name for name in METHODS if name not in ONE_AXIS)
        raise ValueError(f"--method {method} is made for one axis; tune a rotor by one of {others}")
    text = goal_text(ENGINEER if goal is None else goal)
    if text.strip() == MATCH:
        raise ValueError(f"--goal {MATCH} is for rigs of one axis; give a rotor requirements, or {ENGINEER}")
    names, bounds = parse_tuned(tuned)
    ladder = np.array(SPEEDS, float) if speeds is None else parse_speeds(speeds)
    rotor = with_rejection(load_rotor(source), rejection)
    task = make_rotor_goal_task(rotor, text, names, bounds, ladder.tolist(), budget=budget)
    check_reach(task.rotor, ladder)
    episode = RotorEpisode(task.rotor, task.preset, seed)
    tuner = make_tuner(method, task, episode, seed, budget)
    folder = out or Path(f"tune-{task.name}-{method}{goal_label(goal)}")
    require_folder(folder)
    require_apart(json_file, folder, (SPEC, JOURNAL))
    made_by = {
        "method": method, "seed": seed, "rotor": plain(asdict(task.rotor)), "speeds": ladder.tolist(),
        "tuned": list(task.box.names), "goal": task.layout.goal.text, "steps": budget if method == "grid" else None,
        **({"bounds": plain(bounds)} if bounds else {}),
    }  # fmt: skip
    started = perf_counter()
    with workers(scheduler, threads) as spread, progress_bar() as bar:
        line = bar.add_task(f"tune {task.name} by {method}", total=budget)
        found = run_study(
            folder, task, episode, tuner, made_by, budget, batch, threads, lambda n, _: bar.advance(line, n), spread
        )
    advice = recommend(task, episode, found.trials, seed, CANDIDATES, REPEATS, ROTORS)
    data = tune_json(task, found, advice, made_by, 0.0)
    more, tables = [], []
    if advice.chosen is not None:
        chosen = task.at(task.rotor, advice.chosen.point)
        judged = evaluate_goal([chosen, task.rotor], task.layout.goal, ladder, (seed, 0), threads)
        top = float(abs(ladder).max())
        checked = report(chosen, np.unique([*np.arange(0.0, top, CHECKED), top]), seed, threads)
        data |= {"by_speed": found_json(judged.found[0]), "run_up": run_up_json(checked)}
        more = sections(task.layout.goal, judged.found, checked)
        tables = [terminal_table(task.layout.goal, judged.found[0]), *check_lines(checked)]
    data["seconds"] = perf_counter() - started
    page = folder / "tune.html"
    made = {"Rotor": f"{task.name}, {task.rotor.body.mass:g} kg, axis {task.rig.name}"}
    write_page(page, tune_page(task, found, advice, data, more, made), [folder / "tune.json"])
    write_json(folder / "tune.json", data)
    write_json(json_file, data)
    for part in (*tune_tables(task, found, advice), *tables):
        console.print(part)
    if advice.chosen is not None:
        again = command(source, task, advice.chosen.point, rejection, top, seed)
        console.print(f"the same run-up: {again}", highlight=False, soft_wrap=True)  # in one line, to be pasted
    down = int(np.sum(found.trials.touchdown))
    reused = f", {found.reused} reused" if found.reused else ""
    console.print(f"{len(found.trials)} experiments, {down} touchdowns; {data['seconds']:.1f} s{reused}\npage  {page}")


def command(source: str, task: RotorGoalTask, point: np.ndarray, rejection: float | None, top: float, seed: int) -> str:
    """The command that runs the rotor up, to the top speed (rpm), with the gains of a point of the box."""
    values = dict(zip(task.box.names, map(float, task.box.gains(point)), strict=True))
    words = [f"maglev runup --rotor {quote(source)}", *([] if rejection is None else [f"--rejection {rejection!r}"])]
    words.append(f"--speeds 0:{repr(top).removesuffix('.0')}:{CHECKED:g} --seed {seed}")
    for name, value in values.items():
        gain, _, controller = name.partition("_")
        words.append(f"--gains {controller}.{gain}={value!r}")
    return " ".join(words)
