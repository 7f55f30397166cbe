"""Frames of an episode: what is drawn is what was measured and simulated; windows never crash."""

import os
import subprocess
import sys
import warnings
from dataclasses import replace
from itertools import pairwise
from types import ModuleType

import gymnasium
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backend_bases import FigureManagerBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex

from estimation.iso_14839 import iso_14839_3_zone
from maglev_env.envs.pictures.episode import RED, ZONES, episode_figure
from maglev_env.envs.pictures.window import draw_frame, hide, show
from maglev_env.experiment import without_noise
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.loop import loop_response
from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.target import Target
from maglev_env.task.task import infos, make_task

GOOD, OTHER, DOWN = (-0.3, -0.5, 0.6), (0.1, -0.5, 0.5), (-1.0, 1.0, -1.0)
FRAME = np.zeros((720, 960, 3), np.uint8)


def played(*actions, **arguments):
    """Task, episode and history of experiments at the given actions, the first of them the start."""
    task = make_task(**{"protocol": "quick"} | arguments)
    episode = task.draw(np.random.default_rng(1))
    history = []
    for count, action in enumerate(np.array(actions)):
        found, _ = task.measure([episode], action[None], [count], 1)
        history.append((action, infos(task, found, action[None])[0]))
    return task, episode, history


def panel(figure, label):
    return next(axes for axes in figure.axes if axes.get_label() == label)


def drawn(axes, label):
    """x and y of the line with a label."""
    return next(line for line in axes.lines if line.get_label() == label).get_data()


def marks(axes, colour, marker):
    found = [line for line in axes.lines if line.get_marker() == marker and to_hex(line.get_color()) == colour.lower()]
    return [line.get_xydata()[0] for line in found]


def texts(figure):
    return [t.get_text() for t in figure.texts] + [axes.get_title(loc="left") for axes in figure.axes]


def experiment_of(task, episode, history):
    return task.experiment(episode, task.box.gains(history[-1][0]), len(history) - 1)


@pytest.mark.parametrize("rig", ["hmb_free", "hmb_radial", "eframe"])
def test_a_frame_is_an_image_and_equal_inputs_give_equal_pixels(rig):
    task, episode, history = played(GOOD, OTHER, rig=rig)
    frame = draw_frame(episode_figure(task, episode, history))
    assert frame.shape == (720, 960, 3) and frame.dtype == np.uint8 and frame.flags.c_contiguous
    assert np.array_equal(frame, draw_frame(episode_figure(task, episode, history)))
    assert not np.array_equal(frame, draw_frame(episode_figure(task, episode, history[:1])))


def test_the_environment_renders_its_last_experiment_and_rendering_changes_nothing():
    seen = []
    for rendered in (True, False):
        env = gymnasium.make("maglev/HMBFree-v0", render_mode="rgb_array", protocol="quick")
        env.reset(seed=4)
        frames = [env.render()] if rendered else []
        infos_seen = []
        for action in (GOOD, DOWN):
            infos_seen.append(env.step(np.array(action, np.float32))[-1])
            frames += [env.render()] if rendered else []
        seen.append(infos_seen)
        if rendered:
            assert [f.shape for f in frames] == [(720, 960, 3)] * 3
            assert not any(np.array_equal(a, b) for a, b in pairwise(frames))
    assert [i["score"] for i in seen[0]] == [i["score"] for i in seen[1]]
    assert "touchdown_time" in seen[0][1]


def test_the_motion_is_the_beginning_of_the_experiment_that_was_measured():
    task, episode, history = played(GOOD, OTHER)
    e = experiment_of(task, episode, history)
    record = simulate_records([e])[0, 0]
    time, y = panel(episode_figure(task, episode, history), "motion").lines[0].get_data()
    assert np.array_equal(y, record[: len(y)] * 1e6) and len(y) == e.recorded_per_period
    assert time == pytest.approx(np.arange(len(y)) / 20000.0)


def test_an_orbit_is_the_beginning_of_the_experiment_within_a_round_bore():
    task, episode, history = played(GOOD, rig="hmb_radial")
    e = experiment_of(task, episode, history)
    record = simulate_records([e])[0, :2, : e.recorded_per_period] * 1e6
    figure = episode_figure(task, episode, history)
    axes = panel(figure, "motion")
    x, y = axes.lines[0].get_data()
    assert np.array_equal(x, record[0]) and np.array_equal(y, record[1])
    FigureCanvasAgg(figure).draw()
    (left, bottom), (right, top) = axes.transData.transform([[-100.0, -100.0], [100.0, 100.0]])
    assert right - left == pytest.approx(top - bottom, rel=1e-6)


@pytest.mark.parametrize("rig", ["hmb_free", "hmb_radial"])
def test_a_small_motion_is_magnified_by_the_factor_that_is_written(rig):
    axes = panel(episode_figure(*played(GOOD, rig=rig)), "motion")
    factor = int(next(t.get_text() for t in axes.texts if t.get_text().startswith("×"))[1:])
    whole, large = (np.ptp(line.get_ydata()) for line in axes.lines)
    assert factor > 1 and large == pytest.approx(factor * whole)


@pytest.mark.parametrize("rig", ["hmb_free", "hmb_radial"])
def test_a_touchdown_is_marked_at_the_wall_at_its_time_and_nothing_is_made_up(rig):
    task, episode, history = played(GOOD, DOWN, rig=rig)
    info = history[-1][1]
    figure = episode_figure(task, episode, history)
    motion = panel(figure, "motion")
    (mark,) = marks(motion, RED, "X")
    wall = task.rig.clearance * 1e6
    if rig == "hmb_free":
        assert mark[0] == pytest.approx(info["touchdown_time"]) and abs(mark[1]) == pytest.approx(wall)
    else:
        assert np.hypot(*mark) == pytest.approx(wall)
    assert np.linalg.norm(motion.lines[0].get_xydata()[-2, -task.rig.axes :]) < wall  # the last reading is inside
    assert "touchdown" in texts(figure) and any("touchdown after" in t for t in texts(figure))
    for name in ("stiffness", "damping"):
        assert not panel(figure, name).containers
        assert "no estimate" in [t.get_text() for t in panel(figure, name).texts]
    assert not marks(panel(figure, "sensitivity"), RED, "o")
    assert not np.array_equal(
        draw_frame(episode_figure(task, episode, history)), draw_frame(episode_figure(task, episode, history[:1]))
    )


def test_a_late_touchdown_is_simulated_to_its_end():
    # Lines of 5 Hz: 0.2 s per period; these gains let go in the second one.
    task, episode, history = played((0.8934, 0.2, -0.42))
    time = history[-1][1]["touchdown_time"]
    assert time > 0.2
    (mark,) = marks(panel(episode_figure(task, episode, history), "motion"), RED, "X")
    assert mark[0] == pytest.approx(time)


def test_a_touchdown_within_the_first_sample_is_drawn():
    light = replace(load_rig("eframe"), mass=1e-4, clearance=1e-7, target=Target((10.0, 25.0), 2e4, 80.0))
    task, episode, history = played(GOOD, rig=light)
    assert history[-1][1]["touchdown_time"] == 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_frame(episode_figure(task, episode, history))


@pytest.mark.parametrize("name, scale", [("stiffness", 1e-3), ("damping", 1.0)])
def test_bars_are_the_estimates_with_1_96_standard_errors_and_the_target_band_its_interval(name, scale):
    task, episode, history = played(GOOD, draw_target=True)
    info = history[-1][1]
    axes = panel(episode_figure(task, episode, history), name)
    bands, in_target = axes.containers
    points, _, (bars,) = bands
    assert points.get_ydata() == pytest.approx(info[f"band_{name}"] * scale)
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    half = 1.959964 * info[f"band_{name}_se"] * scale
    assert ends == pytest.approx(info[f"band_{name}"][:, None] * scale + np.outer(half, (-1, 1)))
    (segment,) = in_target[2][0].get_segments()
    assert segment[:, 1] == pytest.approx(np.array([info[f"{name}_low"], info[f"{name}_high"]]) * scale)
    assert segment[:, 0] == pytest.approx([90.0, 90.0])
    assert drawn(axes, "target")[1] == pytest.approx([getattr(episode.target, name) * scale] * 2)


def test_the_measured_peak_lies_on_the_curve_of_the_linearised_loop():
    task, episode, history = played(GOOD, OTHER)
    info = history[-1][1]
    axes = panel(episode_figure(task, episode, history), "sensitivity")
    frequency, curve = drawn(axes, "linearised loop")
    (mark,) = marks(axes, RED, "o")
    assert mark == pytest.approx([info["peak_frequency"], info["peak_sensitivity"]])
    assert np.interp(mark[0], frequency, curve) == pytest.approx(mark[1], rel=0.05)
    wrong = experiment_of(task, episode, history[:1])  # the gains of the start would miss it
    assert abs(np.abs(loop_response(wrong, mark[:1]).sensitivity[0]) - mark[1]) > 0.08 * mark[1]


def test_each_axis_has_its_sensitivity():
    stiffer = replace(load_rig("hmb_radial"), per_axis={"y": {"support_stiffness": 90e3}})
    task, episode, history = played(GOOD, rig=stiffer)
    axes = panel(episode_figure(task, episode, history), "sensitivity")
    e = without_noise(experiment_of(task, episode, history))
    for axis, name in enumerate("xy"):
        frequency, curve = drawn(axes, f"linearised loop {name}")
        assert curve == pytest.approx(np.abs(loop_response(e, frequency).sensitivity[:, axis, axis]))
    assert np.ptp([drawn(axes, f"linearised loop {name}")[1].max() for name in "xy"]) > 0.05


def test_a_peak_beyond_the_scale_points_out_of_it_with_its_value_in_words():
    task, episode, history = played((-0.9, -0.5, -0.9))
    action, info = history[-1]
    figure = episode_figure(task, episode, [(action, info | {"peak_sensitivity": 12.3, "peak_frequency": 70.0})])
    axes = panel(figure, "sensitivity")
    (mark,) = marks(axes, RED, "^")
    assert mark == pytest.approx([70.0, axes.get_ylim()[1]])
    assert any("12.3 at 70 Hz, zone D" in t for t in texts(figure))


def test_shaded_zones_are_those_of_the_standard_and_a_shaken_motion_has_none():
    task, episode, history = played(GOOD)
    figure = episode_figure(task, episode, history)

    def shaded(axes):
        boxes = [(p.get_bbox(), to_hex(p.get_facecolor()).upper()) for p in axes.patches]
        names = {colour: zone for zone, colour in ZONES.items()}
        return {names[colour]: sorted((abs(b.y0), abs(b.y1))) for b, colour in boxes if colour in names}

    of_peak, of_motion = shaded(panel(figure, "sensitivity")), shaded(panel(figure, "motion"))
    assert set(of_peak) == set("ABCD") and not of_motion
    assert not any("zone" in t for t in texts(figure) if t.startswith("Rotor"))
    for zone in "ABCD":
        for share in (1e-3, 1 - 1e-3):
            assert iso_14839_3_zone(np.interp(share, [0, 1], of_peak[zone])) == zone


def test_every_try_is_where_its_gains_are_coloured_by_its_score():
    task, episode, history = played(GOOD, OTHER, DOWN)
    axes = panel(episode_figure(task, episode, history), "tried")
    dots, crosses, ring = axes.collections
    gains = np.array([[info["kp"], info["kd"]] for _, info in history])
    assert np.array_equal(dots.get_offsets(), gains[:2]) and np.array_equal(crosses.get_offsets(), gains[2:])
    assert np.array_equal(ring.get_offsets(), gains[2:])
    assert dots.get_array().tolist() == [info["score"] for _, info in history[:2]]
    assert dots.get_clim() == (0, 1)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")  # kp spans a factor of 8, kd of 20
    best = max(info["score"] for _, info in history)
    assert f"best score {best:.3f}" in axes.get_title(loc="left")


def test_without_both_gains_the_score_is_drawn_against_the_experiment():
    task, episode, history = played((0.0,), (-0.2,), (0.5,), tuned=("kd",), rig="eframe")
    axes = panel(episode_figure(task, episode, history), "tried")
    scores = [info["score"] for _, info in history]
    assert np.array_equal(axes.collections[0].get_offsets(), np.column_stack([[0, 1, 2], scores]))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("experiment", "score")


def test_the_heading_says_where_the_episode_is_and_a_name_is_no_formula():
    named = replace(load_rig("hmb_free"), name="a$b_{$")
    task, episode, history = played(GOOD, OTHER, rig=named, budget=7)
    first, second = (texts(episode_figure(task, episode, history[:n])) for n in (1, 2))
    assert "a$b_{$: start, before 7 experiments" in first and "a$b_{$: experiment 1 of 7" in second
    assert f"score {history[1][1]['score']:.3f}" in second
    draw_frame(episode_figure(task, episode, history))


def test_an_unstable_loop_that_stays_up_is_said_to_be_unstable():
    task, episode, history = played(GOOD)
    action, info = history[-1]
    figure = episode_figure(task, episode, [(action, info | {"feasible": False, "score": 0.0, "pole_radius": 1.0001})])
    assert "unstable loop" in texts(figure)
    assert drawn(panel(figure, "sensitivity"), "linearised loop, unstable")
    assert "Tried so far: none scores" in texts(figure)


@pytest.mark.slow
def test_a_frame_needs_no_pyplot_no_display_and_leaves_the_settings_alone():
    code = (
        "import os, sys, gymnasium, maglev_env, matplotlib\n"
        "before = dict(matplotlib.rcParams)\n"
        "env = gymnasium.make('maglev/EFrame-v0', render_mode='rgb_array', protocol='quick')\n"
        "env.reset(seed=0); env.render(); env.close()\n"
        "assert 'maglev_env.envs.pictures.episode' in sys.modules\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert dict(matplotlib.rcParams) == before\n"
    )
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")} | {"MPLBACKEND": "TkAgg"}
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120, env=bare)


def test_without_a_screen_a_window_warns_once_and_stays_away():
    plt.switch_backend("agg")
    with pytest.warns(UserWarning, match="rgb_array"):
        window = show(FRAME, None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert show(FRAME, window) is window
        hide(window)
    assert not plt.get_fignums()


def test_the_human_environment_survives_without_a_screen():
    plt.switch_backend("agg")
    env = gymnasium.make("maglev/EFrame-v0", render_mode="human", protocol="quick")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env.reset(seed=0)
        env.step(np.zeros(3, np.float32))
        env.close()
        env.close()
    assert sum("shows nothing" in str(w.message) for w in caught) == 1


class _Manager(FigureManagerBase):
    shown = 0

    def show(self):
        type(self).shown += 1


class _Canvas(FigureCanvasAgg):
    manager_class = _Manager
    flushed = 0

    def flush_events(self):
        type(self).flushed += 1


@pytest.fixture
def screen(monkeypatch):
    """A backend whose windows are counted instead of seen."""
    backend = ModuleType("screen_of_a_test")
    backend.FigureCanvas, backend.FigureManager = _Canvas, _Manager
    monkeypatch.setitem(sys.modules, backend.__name__, backend)
    before = matplotlib.get_backend()
    plt.switch_backend(f"module://{backend.__name__}")
    _Manager.shown = _Canvas.flushed = 0
    yield
    plt.close("all")
    plt.switch_backend(before)


def test_a_window_opens_once_shows_every_frame_and_closes(screen):
    window = show(FRAME, None)
    assert show(FRAME + 7, window) is window
    assert (_Manager.shown, _Canvas.flushed, len(plt.get_fignums())) == (1, 2, 1)
    assert np.array_equal(window.image.get_array(), FRAME + 7)
    canvas = window.figure.canvas
    canvas.draw()
    assert np.array_equal(np.asarray(canvas.buffer_rgba())[..., :3], FRAME + 7)  # pixel for pixel
    hide(window)
    hide(window)
    assert not plt.get_fignums()


def test_a_window_closed_by_its_viewer_stays_closed(screen):
    window = show(FRAME, None)
    plt.close(window.figure)
    show(FRAME, window)
    show(FRAME, window)
    assert _Manager.shown == 1 and not plt.get_fignums()
