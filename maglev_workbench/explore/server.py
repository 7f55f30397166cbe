"""The local server of the page: on this machine only, and only for who knows its address."""

import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from secrets import token_urlsafe
from threading import Thread
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from maglev_env.design.goals import goal_of
from maglev_env.evaluation.identification import Identification
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import Controllers
from maglev_env.rig.goal import ENGINEER
from maglev_env.rig.rig import Rig
from maglev_workbench.explore.copied import Source, copies
from maglev_workbench.explore.curves import loop_curves
from maglev_workbench.explore.goal_bars import bars, linear_row, requirement_words, shown_goal, simulated_goal
from maglev_workbench.explore.guard import Guard, posted_setting
from maglev_workbench.explore.identified import Run, identified, other_process, run_here
from maglev_workbench.explore.inputs import effect_inputs, gain_inputs
from maglev_workbench.explore.panels import (
    as_data,
    csv_text,
    event_curves,
    identified_curves,
    model_curves,
    panels_data,
)
from maglev_workbench.explore.quantities import UNIT_SYSTEMS, shown
from maglev_workbench.explore.setting import Setting, setting_from
from maglev_workbench.explore.sweep_map import QUANTITIES, SweepMap
from maglev_workbench.explore.words import Sentence, answer, identified_answer

ASSETS = Path(__file__).parent / "assets"
HOST = "127.0.0.1"


@dataclass(frozen=True)
class Measured:
    """What one recording of a campaign shows of one axis.

    Args:
        name: of the recording.
        axis: of the rig.
        gains: under which it was recorded.
        found: what was identified.
    """

    name: str
    axis: int
    gains: Controllers | None
    found: Identification


@dataclass(frozen=True)
class Explored:
    """What the page is about.

    Args:
        rig: with gains and protocol.
        controllers: at the start.
        source: where the rig comes from.
        title: of the page.
        measured: recordings to compare with.
        swept: gain sets to choose from; the page begins with `controllers` all the same.
        diagnosed: effects that a diagnosis found, which the rig has, by name with their parameters.
    """

    rig: Rig
    controllers: Controllers
    source: Source
    title: str
    measured: tuple[Measured, ...] = ()
    swept: SweepMap | None = None
    diagnosed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def application(explored: Explored, token: str, host: str, run: Run = run_here) -> ASGIApp:
    """The page and its answers, for requests to this host with this token at the start of their path.

    Args:
        explored: what the page is about.
        token: first part of every path.
        host: with port, as the browser sends it.
        run: calls what simulates experiments.
    """
    goal = shown_goal(explored.rig)

    def answered(work: Callable[[Setting, Mapping[str, Any]], dict[str, Any]]) -> Callable[..., Any]:
        """A handler of POST: what the work gives, or the sentence that says what is wrong with the setting."""

        async def handle(request: Request) -> Response:
            data = await posted_setting(request)
            return JSONResponse(await run_in_threadpool(said, data))

        def said(data: Mapping[str, Any]) -> dict[str, Any]:
            try:
                return work(setting_from(data, explored.rig, explored.controllers), data)
            except (ValueError, ArithmeticError) as error:
                return {"error": str(error)}

        return handle

    def curves(setting: Setting, _: Mapping[str, Any]) -> dict[str, Any]:
        found = loop_curves(setting.experiment, setting.axis)
        return {
            "words": _words(answer(found, setting)),
            "curves": as_data(model_curves(found), setting.units),
            "goal": [asdict(one) for one in bars(goal, linear_row(found), found, setting.units)],
        }

    def experiment(setting: Setting, _: Mapping[str, Any]) -> dict[str, Any]:
        found = run(identified, setting.experiment, setting.axis)
        words = identified_answer(found, setting)
        return {"words": _words(words), "curves": as_data(identified_curves(found), setting.units)}

    def test(setting: Setting, _: Mapping[str, Any]) -> dict[str, Any]:
        found = run(simulated_goal, setting.experiment, goal, setting.axis)
        reached = [asdict(one) for one in bars(goal, found.row, units=setting.units)]
        return {"goal": reached, "curves": as_data(event_curves(found), setting.units)}

    def measured(setting: Setting, _: Mapping[str, Any]) -> dict[str, Any]:
        rows = [
            {"name": m.name, "curves": as_data(identified_curves(m.found), setting.units)}
            for m in explored.measured
            if m.axis == setting.axis
        ]
        return {"recordings": rows}

    def copied(setting: Setting, _: Mapping[str, Any]) -> dict[str, Any]:
        return dict(copies(setting.experiment, explored.rig, explored.source))

    def table(setting: Setting, _: Mapping[str, Any]) -> dict[str, Any]:
        model = loop_curves(setting.experiment, setting.axis)
        layers = {"model": model_curves(model)}
        if model.stable:
            layers["identified"] = identified_curves(run(identified, setting.experiment, setting.axis))
            layers["tested"] = event_curves(run(simulated_goal, setting.experiment, goal, setting.axis))
        layers |= {m.name: identified_curves(m.found) for m in explored.measured if m.axis == setting.axis}
        return {"csv": csv_text(layers, setting.units)}

    async def start(request: Request) -> Response:
        return JSONResponse(page_data(explored))

    posts = {
        "curves": curves, "experiment": experiment, "test": test, "measured": measured, "copies": copied, "csv": table
    }  # fmt: skip
    routes = [
        Route("/start", start),
        *(Route(f"/{name}", answered(work), methods=["POST"]) for name, work in posts.items()),
        Route("/", _page),
        Mount("/", StaticFiles(directory=ASSETS)),
    ]
    inside = Starlette(routes=[Route(f"/{token}", _with_slash), Mount(f"/{token}", routes=routes)])
    return Guard(inside, token, host)


def page_data(explored: Explored) -> dict[str, Any]:
    """Everything that the page needs once: sliders, units, panels and recordings."""
    rig = explored.rig
    units = {
        system: {unit: shown(unit, system) for unit in _units(explored)} for system in UNIT_SYSTEMS
    }  # factor from SI and name
    return {
        "rig": rig.name,
        "title": explored.title,
        "axes": AXES[: rig.axes] if rig.axes == 2 else [],
        "gains": [[asdict(i) for i in gain_inputs(rig, explored.controllers, axis)] for axis in range(rig.axes)],
        "effects": [asdict(one) for one in effect_inputs(rig)],
        "units": units,
        "goal": {"text": rig.target.goal if goal_of(rig) else ENGINEER, "requirements": _requirements(rig)},
        "map": asdict(explored.swept) if explored.swept else None,
        "diagnosed": {name: dict(values) for name, values in explored.diagnosed.items()},
        "panels": {system: panels_data(rig, system) for system in UNIT_SYSTEMS},
        "recordings": [
            {
                "name": m.name,
                "axis": m.axis,
                "gains": {i.name: i.value for i in gain_inputs(rig, m.gains, m.axis)} if m.gains is not None else None,
            }
            for m in explored.measured
        ],
    }


def _units(explored: Explored) -> set[str]:
    inputs = [i for one in effect_inputs(explored.rig) for i in one.inputs]
    for axis in range(explored.rig.axes):
        inputs += gain_inputs(explored.rig, explored.controllers, axis)
    return {i.unit for i in inputs} | set(QUANTITIES.values())


def _requirements(rig: Rig) -> list[dict[str, Any]]:
    return [
        {"name": one.name, "words": {system: requirement_words(one, system) for system in UNIT_SYSTEMS}}
        for one in shown_goal(rig).requirements
    ]


def _words(sentences: list[Sentence]) -> list[dict[str, str]]:
    return [asdict(one) for one in sentences]


async def _page(request: Request) -> Response:
    return Response((ASSETS / "explore.html").read_bytes(), media_type="text/html")


async def _with_slash(request: Request) -> Response:
    return RedirectResponse(f"{request.url.path}/")


def serve(explored: Explored, port: int, say: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C.

    Args:
        explored: what the page is about.
        port: 0: a free one.
        say: is given the address once the server listens.

    Raises:
        ValueError: The port is taken, or the gains at the start are not valid.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    with listening:
        try:
            listening.bind((HOST, port))
        except OSError as error:
            raise ValueError(
                f"--port {port} cannot be used ({error.strerror}); choose another, or leave it out"
            ) from None
        listening.listen()
        host, token = f"{HOST}:{listening.getsockname()[1]}", token_urlsafe(24)
        loop_curves(
            setting_from({}, explored.rig, explored.controllers).experiment, 0
        )  # refuses before any page is shown
        with other_process() as run:
            Thread(target=_prepare, args=(explored, run), daemon=True).start()
            say(f"http://{host}/{token}/")
            # Without a log of requests, which would have the token in it.
            config = uvicorn.Config(
                application(explored, token, host, run), log_level="warning", access_log=False,
                server_header=False, timeout_graceful_shutdown=1,
            )  # fmt: skip
            uvicorn.Server(config).run(sockets=[listening])


def _prepare(explored: Explored, run: Run) -> None:
    """Compile what the first experiment needs while the user looks at the curves."""
    with suppress(ValueError):  # the page says it when it asks for the experiment
        run(identified, setting_from({}, explored.rig, explored.controllers).experiment, 0)
