"""The environments of a spinning rotor; the docstring of the scalar one specifies both."""

from typing import TYPE_CHECKING, Any

from maglev_env.envs.single import RigEnv
from maglev_env.envs.vector import RigVectorEnv
from maglev_env.task.pump import make_rotor_task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from maglev_env.envs.pictures.frames import History


class PumpRotorEnv(RigEnv):
    """Tune both controllers of a free rotor in two magnetic bearings; one step is one run-up with identification.

    The rotor has five degrees of freedom, spins, is unbalanced and can touch down. At every speed of the ladder the
    simulation starts with the rotor at rest in the centre. At standstill and at the top speed, or at the
    next multiple of 500 rpm below it, it is identified with forward-rotating currents.

    ## Action space
    `Box(-1, 1, (k,), float32)`, one element per gain in `tuned` of the first controller and then of the second, mapped
    into its bounds; logarithmically where they differ fivefold or more. An action outside the box is clipped, with a
    warning. With `move` an action is a step instead: it moves the gains tried last by up to that share of the box.

    | control | controllers | action by default |
    |---|---|---|
    | "translation_tilt" | mean of both planes, half their difference | kp, ki, kd of one, then of the other |
    | "planes" | plane a, plane b | likewise |
    | "common" | the rotor's own kind, both with the same gains | kp, ki, kd |

    | gain | unit | bounds |
    |---|---|---|
    | kp | A/m | `bounds`, else the rotor's |
    | ki | A/m | likewise |
    | kd | A s/m | likewise |
    | td, ti | s | likewise, else 0.3 to 3 times the rotor's |

    ## Observation space
    `Box(-1, 1, (size,), float32)`; `env.unwrapped.observation_names` names every element. k*, c*: stiffness and damping
    of the mode at that speed that the nominal rotor's preset gains give without noise. Speeds first, then modes
    (translation, tilt) or controllers.

    | elements | quantity | -1 | 0 | 1 |
    |---|---|---|---|---|
    | 2 x 2 | stiffness k over k*, per speed and mode | 1/5 or negative | 1, unknown | 5 (logarithm) |
    | 2 x 2 | damping c over c* | likewise | | |
    | 2 x 2 + 2 x 2 | their standard errors over k*, c* | 1e-4 | | 10 or unknown (logarithm) |
    | 2 x 2 | peak sensitivity, per speed and controller | 20 or more, unknown | | 1 (logarithm) |
    | s | peak displacement over clearance, per speed of the ladder | 1e-3 | | 1 (logarithm) |
    | 1 | the largest rms coil current over its limit | 1e-3 | | 10 (logarithm) |
    | 1 | feasible | no | | yes |
    | k | the gains just tried, as the action that gives them | | | |
    | 1 | experiments left over the budget | none | half | all |

    "Unknown" above is the value after a touchdown; results at other speeds remain.

    ## Reward
    The score of the experiment in [0, 1] (`evaluation.score`; every term is that of the worst mode, controller, plane
    or speed); 0 for a loop that is unstable at standstill or at the top speed; -1 for a touchdown.

    ## Start
    A rotor is drawn around the nominal one. The first observation is that of an experiment half-way between the rotor's
    preset gains and a random point of the box, which does not count against the budget.

    ## End
    Truncated after `budget` experiments. Terminated by a touchdown if `terminate_on_touchdown`.

    ## Info
    Unknown values, such as an estimate after a touchdown, are left out.

    | key | meaning |
    |---|---|
    | kp_translation ... | gains tried, named by controller (kp ... with "common") |
    | stiffness_translation_0_rpm ... | also damping, both with `_se`: N/m, N s/m; tilt N m/rad, N m s/rad |
    | peak_sensitivity_tilt_0_rpm ... | and peak_frequency (Hz), by controller |
    | peak (s, 2) | largest displacement at the probe planes per speed, m |
    | once (s, 3) | amplitude at the speed of rotation at a, b and of an axial probe, m |
    | coil_rms (s, 4), copper_loss (s,) | A and W per speed |
    | peak_displacement, current_rms, peak_sensitivity | the largest: m, A |
    | displacement_zone, sensitivity_zone | "A" to "D", of ISO 14839-2 and -3 |
    | touchdown_time, touchdown_speed | s, and the lowest speed (rpm) at which it touched down |
    | pole_radius (2,) | of the linearised loop at standstill and at the top speed |
    | feasible, score, term_* | the score and its terms |

    ## Arguments
    - `rotor`: preset name, path of a rotor TOML, or a `Rotor`. `control`: see above.
    - `tuned`: gains to tune, of kp, ki, kd, td, ti. `bounds`: {gain: (low, high)} for both, instead of the rotor's.
    - `randomization`: "none", or "tolerances": the axis' data-sheet uncertainty (inertias go with the mass), and static
      and couple unbalance each times a factor drawn log-uniformly from `unbalance`, (0.5, 2) by default. The
      identification uses the drawn rotor's probes, actuators and mass.
    - `speeds`: the ladder, rpm; by default 0 to 14000 in steps of 1000. With 0 rpm alone the rotor is identified at
      standstill only, and the observation has half of the elements that are per speed.
    - `move`: None, or the share of the box (0 .. 2) by which an action can move the gains tried last.
    - `budget`: experiments per episode. `render_mode`: "rgb_array" or "human".

    ## Versions
    - v0: first.
    """

    make_task = staticmethod(make_rotor_task)

    @staticmethod
    def picture(task: Any, episode: Any, history: "History") -> "Figure":
        """The figure that `render` draws: the last experiment's run-up, and the scores of those so far."""
        from maglev_env.envs.pictures.pump import rotor_figure

        return rotor_figure(task, episode, history)


class PumpRotorVectorEnv(RigVectorEnv):
    """`num_envs` environments in one batch, with the results of `PumpRotorEnv` bit for bit.

    Args:
        num_envs: as of `RigVectorEnv`.
        render_mode: likewise.
        autoreset_mode: likewise.
        threads: likewise.
        arguments: as `PumpRotorEnv`.
    """

    make_task = staticmethod(make_rotor_task)
    picture = staticmethod(PumpRotorEnv.picture)
