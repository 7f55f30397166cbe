"""The scalar environment; its docstring specifies all environments of rigs."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from inspect import signature
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium import logger, spaces
from gymnasium.error import InvalidAction

from maglev_env.task.task import Tuning, infos, make_task, rewards

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from maglev_env.envs.pictures.frames import History


class RigEnv(gym.Env[np.ndarray, np.ndarray]):
    """Tune the controller of a magnetically levitated rotor; one step is one simulated identification experiment.

    ## Action space
    `Box(-1, 1, (k,), float32)`, one element per gain in `tuned`, mapped into its bounds; logarithmically where they
    differ fivefold or more. An action outside the box is clipped, with a warning.
    With `move` an action is a step instead: it moves the gains tried last by up to that share of the box.

    | gain | unit | bounds |
    |---|---|---|
    | kp | A/m | `bounds`, else the rig's |
    | ki | A/m | likewise |
    | kd | A s/m | likewise |
    | td, ti | s | likewise, else 0.3 to 3 times the rig's |
    | those of filters and of other controllers | | docs/controllers.md |

    ## Observation space
    `Box(-1, 1, (size,), float32)`; `env.unwrapped.observation_names` names every element. k*, c*: target stiffness and
    damping of the nominal rig.

    | elements | quantity | -1 | 0 | 1 |
    |---|---|---|---|---|
    | 5 + 5 | stiffness k, damping c per band, maximum likelihood | -20 k*, c* | 0 | 20 k*, c* (asinh) |
    | 5 + 5 | their standard errors over k*, c* | 1e-4 | | 10 or unknown (logarithm) |
    | 2 | k, c in the target band over the episode's target | 1/5 or negative | 1 | 5 (logarithm) |
    | 1 | peak sensitivity | 20 or more | | 1 (logarithm) |
    | 1 | upper gain margin | 1 | | 20 or no crossing (logarithm) |
    | 1 | phase margin | 0 deg | 45 deg | 90 deg or no crossing |
    | 1 | disk margin | 0 | 0.5 | 1 |
    | 1 | peak displacement over clearance | 1e-3 | | 1 (logarithm) |
    | 1 | rms current over its limit | 1e-3 | | 10 (logarithm) |
    | k | the gains just tried, as the action that gives them | | | |
    | 1 | experiments left over the budget | none | half | all |
    | 2 | target k, c over k*, c*, with `draw_target` | 1/5 | 1 | 5 (logarithm) |
    | r | with a `goal`: each of its quantities against its limit | missed 5 times | at it | met 5 times (logarithm) |

    After a touchdown the estimates are 0, standard errors and levels 1, and margins -1.

    ## Reward
    The score of the experiment (see `evaluation.score`), in [0, 1]; 0 for an unstable loop; -1 for a touchdown.

    ## Start
    A rig is drawn around the nominal one, and with `draw_target` also a target. The first observation is that of an
    experiment half-way between the rig's preset gains and a random point of the box, which does not count against the
    budget.

    ## End
    Truncated after `budget` experiments. Terminated by a touchdown if `terminate_on_touchdown`.

    ## Info
    The gains tried and the results of the experiment, in SI: stiffness and damping in the target band with 95 % bounds
    and per band with standard errors, margins, peak_displacement (m), current_rms (A), touchdown_time (s), pole_radius,
    feasible, axis (the worse one, 0 or 1), score and its terms (`term_*`), with a `goal` what it measures
    (`required_*`, with `_low` and `_high` of 95 %), and where a sharp resonance lies between the injection lines the
    margins that the linearised loop has there (`between_lines_*`). Unknown values, such as an estimate after a
    touchdown, are left out.

    ## Arguments
    - `rig`: preset name, path of a rig TOML, or a `Rig`; `with_defaults` fills in what its TOML does not give.
    - `tuned`: gains to tune, by default kp, ki, kd and those of filters. `bounds`: {gain: (low, high)} instead of the
      rig's.
    - `randomization`: "none", "tolerances" (the rig's data-sheet uncertainty) or "wide" (its [randomization], else 0.75
      to 1.35 times every parameter that has a tolerance). `draw_target`: draw k* and c* too, 0.8 to 1.5 times.
    - `effects`: any of `maglev effects`, {name: {parameter: value}} or {name: value}, unknown to the agent.
    - `protocol`: "full" (the rig's SPHS protocol) or "quick" (an eighth of the time, two to five times the error).
    - `move`: None, or the share of the box (0 .. 2) by which an action can move the gains tried last.
    - `sensor`: "probe", or "self_sensing" by the rig's own coils and an estimator designed for the nominal rig; the
      score then includes the error of the estimated gap, and the info has this error and the lost phase margin.
    - `goal`: what the score is of: None (the rig's [target], of the presets "match"), "match", "engineer", the path of
      a text file or requirements, see docs/goals.md. Requirements add elements to the observation.
    - `controller`: None (the rig's), or "pid" with filters such as "pid + notch 650", see docs/controllers.md.
    - `budget`: experiments per episode. `render_mode`: "rgb_array" or "human".

    On an x-y rig both axes have the same gains, and all results are those of the worse axis.

    ## Versions
    - v0: first.
    """

    make_task: Callable[..., Tuning] = staticmethod(make_task)
    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 2}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode = {render_mode!r}; use one of {self.metadata['render_modes']}")
        check_arguments(arguments, self.make_task)
        self.task: Tuning = self.make_task(**arguments)
        self.render_mode = render_mode
        self.action_space, self.observation_space = spaces_of(self.task)
        self._canvas = None
        self._episode, self._count, self._history, self._ended = None, 0, [], False

    @staticmethod
    def picture(task: Any, episode: Any, history: "History") -> "Figure":
        """The figure that `render` draws of an episode.

        Args:
            task: that of the environment.
            episode: one of its episodes.
            history: (action (k,), info) of its experiments so far, oldest first, the start included.
        """
        from maglev_env.envs.pictures.episode import episode_figure

        return episode_figure(task, episode, history)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of each element of the observation."""
        return self.task.layout.names

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Draw an episode and make its first experiment; there are no options."""
        super().reset(seed=seed)
        with all_or_nothing(self, _STATE, [self.np_random]):
            self._episode, self._count, self._history = self.task.draw(self.np_random), 0, []
            self._ended = False
            observation, _, info, _ = self._measure(self._episode.start)
        return observation, info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One experiment at the gains of an action."""
        if self._episode is None:
            raise gym.error.ResetNeeded("call reset before the first step")
        if self._ended:
            raise gym.error.ResetNeeded("the episode has ended: call reset before the next step")
        checked = checked_actions(np.asarray(action)[None], self.action_space, 1)[0]
        with all_or_nothing(self, _STATE):
            self._count += 1
            observation, reward, info, down = self._measure(self.task.tried(self._history[-1][0], checked))
            terminated = bool(down and self.task.terminate_on_touchdown)
            truncated = self._count >= self.task.budget
            self._ended = terminated or truncated
        return observation, reward, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """The last experiment and the gains tried so far: RGB (height, width, 3) uint8, or in a window."""
        if self.render_mode is None:
            logger.warn("render needs render_mode='rgb_array' or 'human' when the environment is made")
            return None
        if self._episode is None:
            raise gym.error.ResetNeeded("call reset before render")
        from maglev_env.envs.pictures.window import draw_frame, show

        frame = draw_frame(self.picture(self.task, self._episode, self._history))
        if self.render_mode == "rgb_array":
            return frame
        self._canvas = show(frame, self._canvas)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._canvas is not None:
            from maglev_env.envs.pictures.window import hide

            hide(self._canvas)
            self._canvas = None

    def _measure(self, action: np.ndarray) -> tuple[np.ndarray, float, dict, bool]:
        found, observations = self.task.measure([self._episode], action[None], [self._count], 1)
        info = infos(self.task, found, action[None])[0]
        self._history.append((action, dict(info)))
        if self.render_mode == "human":
            self.render()
        return observations[0], float(rewards(found)[0]), info, bool(np.isfinite(found.touchdown_time[0]))


_STATE = ("_episode", "_count", "_history", "_ended")  # what a step changes


@contextmanager
def all_or_nothing(env: object, names: Iterable[str], rngs: Iterable[np.random.Generator] = ()) -> Iterator[None]:
    """Put attributes and random generators back where what follows ends in an error or an interruption.

    A step that was interrupted then uses up neither budget nor noise. Of a list its items are kept as they are.
    """
    before = {name: copy(getattr(env, name)) for name in names}
    states = [(rng, rng.bit_generator.state) for rng in rngs]
    try:
        yield
    except BaseException:
        for name, value in before.items():
            setattr(env, name, value)
        for rng, state in states:
            rng.bit_generator.state = state
        raise


def check_arguments(arguments: Mapping[str, Any], make_task: Callable[..., Tuning]) -> None:
    """Raise TypeError for the first argument that an environment does not know; the message lists those it knows."""
    known = list(signature(make_task).parameters)
    for name in arguments:
        if name not in known:
            raise TypeError(f"unknown argument {name!r} of the environment; it has {', '.join(known)}, render_mode")


def spaces_of(task: Tuning) -> tuple[spaces.Box, spaces.Box]:
    """Action and observation space of one environment."""
    action = spaces.Box(-1.0, 1.0, (len(task.box.names),), np.float32)
    return action, spaces.Box(-1.0, 1.0, (len(task.layout.names),), np.float32)


def checked_actions(actions: np.ndarray, space: spaces.Space, n: int, ignored: np.ndarray | None = None) -> np.ndarray:
    """Actions (n, k) as float64, clipped into the box with a warning; 0 where they are ignored, (n,) bool.

    Raises:
        InvalidAction: The shape is wrong, or a value is not a finite number; the message says which.
    """
    shape = space.shape or ()
    try:
        if np.iscomplexobj(actions):
            raise TypeError("complex numbers")
        checked = np.array(actions, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidAction(f"action: {error}; give numbers of shape {shape}") from error
    if checked.shape != (n, *shape):
        raise InvalidAction(f"action has the shape {checked.shape[1:]}, not {shape}: one element per gain")
    if ignored is not None:
        checked[ignored] = 0.0
    if not np.isfinite(checked).all():
        raise InvalidAction("action holds nan or infinite values; give numbers in [-1, 1]")
    if (np.abs(checked) > 1).any():
        logger.warn("action outside the box [-1, 1]: clipped")
    return np.clip(checked, -1.0, 1.0)
