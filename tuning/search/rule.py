"""The dissertation's rule (D eq 3.18 and 3.19): gains from the wanted stiffness and damping with an identified gain."""

import numpy as np

from maglev_env.loop.gains import controller_response, gain_values, of_axis, with_gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.task.episodes import Episode
from maglev_env.task.task import Task
from tuning.tuner import Trials


class DissertationRule:
    """Tries a safe start, then k_p = (k - k_yy) / k_yi and k_d = c / k_yi for the wanted stiffness k and damping c.

    k_yy is the nominal negative stiffness, and k_yi the actuator gain that explains the stiffness identified last
    (D 4.5). The rule is applied again after every experiment.
    """

    def __init__(self, task: Task, episode: Episode) -> None:
        """Set up for a rig; of the episode only its target and start are used.

        Raises:
            ValueError: The controller has no kp and kd.
        """
        if not {"kp", "kd"} <= gain_values(of_axis(task.rig.gains, 0)).keys():
            raise ValueError(f"method rule: it chooses kp and kd, which the controller of rig {task.name} has not")
        self._task, self._target = task, episode.target
        self._next = np.asarray(episode.start, float)

    def ask(self, n: int) -> np.ndarray:
        return self._next[None]

    def tell(self, trials: Trials) -> None:
        last = trials.info[-1]
        if trials.touchdown[-1] or not np.isfinite(last.get("stiffness", np.nan)):
            return
        rig, box = self._task.rig, self._task.box
        tried = {name: last[name] for name in box.names}
        gain, negative = linearise(force_law(rig))
        centre = np.exp(2j * np.pi * np.mean(rig.target.band) / rig.control_rate)
        c = controller_response(of_axis(with_gains(rig.gains, **tried), 0), np.array([centre]), 1 / rig.control_rate)[0]
        found = (last["stiffness"] - rig.support_stiffness - negative) / c.real
        gain = found if found > 0 else gain
        wanted = {
            "kp": (self._target.stiffness - rig.support_stiffness - negative) / gain,
            "kd": (self._target.damping - rig.support_damping) / gain,
        }
        preset = gain_values(of_axis(rig.gains, 0))
        self._next = box.actions([wanted.get(name, preset[name]) for name in box.names])
