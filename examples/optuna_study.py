"""An Optuna study on the public interface: gain sets asked for together are scored as one batch."""

from dataclasses import replace

import optuna

from maglev_env import evaluate, load_rig, protocol_experiment
from maglev_env.loop.effect import effect


def run(trials: int = 96, batch: int = 16, seed: int = 0) -> optuna.Study:
    """TPE on kp, ki and kd of the free rotor under a slow controller; the value of a trial is its score."""
    rig, slow = load_rig("hmb_free"), effect("delay", 1e-4)
    space = {name: optuna.distributions.FloatDistribution(*ends, log=True) for name, ends in rig.bounds.items()}
    sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    study.enqueue_trial({name: getattr(rig.gains, name) for name in space})  # what levitates already
    while len(study.trials) < trials:
        asked = [study.ask(space) for _ in range(batch)]
        gains = [replace(rig.gains, **trial.params) for trial in asked]
        found = evaluate([protocol_experiment(rig, g, slow, seed=t.number) for g, t in zip(gains, asked, strict=True)])
        for trial, score, peak in zip(asked, found.score, found.margins["peak_sensitivity"], strict=True):
            trial.set_user_attr("peak_sensitivity", float(peak))
            study.tell(trial, float(score))
    return study


if __name__ == "__main__":
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    best = run().best_trial
    print(f"score {best.value:.3f}, peak sensitivity {best.user_attrs['peak_sensitivity']:.2f}: {best.params}")
