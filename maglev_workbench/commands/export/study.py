"""A study of `maglev tune` in a storage of Optuna, for its dashboard and its plots."""

import json
from pathlib import Path
from typing import Any

SCHEMA = "maglev-tune/1"
MADE_BY = "made by"  # attribute of the studies that are written here, and may be written again


def add_study(folder: Path, path: Path) -> str:
    """Add the experiments of a study to an Optuna storage, under its folder's name; one written before is replaced.

    Parameters are gains in SI within the tuner's bounds, the value is the score. What was identified, touchdowns and
    requirements are attributes of the trials, in SI.

    Args:
        folder: Of `maglev tune`.
        path: SQLite file of the storage, which is made where there is none.

    Returns:
        What was written, in a sentence.

    Raises:
        ValueError: The folder holds no finished study, or the file is no storage or has another study of this name.
    """
    data = _tuned(folder)
    import optuna
    from sqlalchemy.exc import SQLAlchemyError

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    box = {n: optuna.distributions.FloatDistribution(lo, hi, log=log) for n, (lo, hi, log) in data["box"].items()}
    trials = [
        optuna.trial.create_trial(
            params={n: min(max(one["gains"][n], range_.low), range_.high) for n, range_ in box.items()},
            distributions=box,
            value=one["score"],
            user_attrs=_attributes(one),
        )
        for one in data["experiments"]
    ]
    name = folder.resolve().name
    try:
        storage = optuna.storages.RDBStorage(f"sqlite:///{path.resolve()}")
        if name in optuna.get_all_study_names(storage):
            if MADE_BY not in optuna.load_study(study_name=name, storage=storage).user_attrs:
                raise ValueError(f"--out {path} has a study {name} of another origin; rename the folder, or that study")
            optuna.delete_study(study_name=name, storage=storage)
        study = optuna.create_study(storage=storage, study_name=name, direction="maximize")
        study.set_user_attr(MADE_BY, f"maglev-workbench {data['version']}, {data['made_by']['method']}")
        study.add_trials(trials)
    except (SQLAlchemyError, RuntimeError) as error:  # the latter: of another version of Optuna
        raise ValueError(f"--out {path} is no storage of Optuna that can be written to ({_first(error)})") from None
    return f"study {name}: {len(trials)} experiments, best score {max(one['score'] for one in data['experiments']):.3f}"


def _tuned(folder: Path) -> dict[str, Any]:
    file = folder / "tune.json"
    if not file.is_file():
        raise ValueError(f"{folder}: there is no tune.json; name the folder of a finished maglev tune")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        raise ValueError(f"{file} is not the tune.json of maglev tune") from None
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise ValueError(f"{file} is not of schema {SCHEMA}")
    if "box" not in data:
        raise ValueError(f"{file} is of an earlier version, which did not keep the bounds of the gains; tune again")
    return data


def _attributes(experiment: dict[str, Any]) -> dict[str, Any]:
    """What an experiment gave beside its score; of a requirement the value, which is None where it is not known."""
    required = {name: one["value"] for name, one in experiment.get("requirements", {}).items()}
    return {"touchdown": experiment["touchdown"], **experiment["identified"], **required}


def _first(error: Exception) -> str:
    return str(error).partition("\n")[0]
