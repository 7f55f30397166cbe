"""`maglev new`: from data files of unknown origin to a commented campaign.toml."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, friendly, require_choice, require_folder

app = typer.Typer()


@app.command(epilog="Example: maglev new run.mat")
@friendly
def new(
    source: Annotated[
        list[Path], typer.Argument(help="Data files (.mat .csv .txt .npz .h5 ...), or a folder of them.")
    ],
    rate: Annotated[float | None, typer.Option(help="Sample rate, Hz, where a file does not tell it.")] = None,
    mass: Annotated[float | None, typer.Option(help="Moving mass, kg.")] = None,
    rig: Annotated[
        str | None, typer.Option(help="Preset or rig TOML of the rig; without it a rig.toml skeleton is written.")
    ] = None,
    magnet: Annotated[str | None, typer.Option(help="Magnet kind of the rig.toml skeleton.")] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(metavar="COLUMN=CHANNEL", help="What a column is: displacement, force, ..., unused; repeat."),
    ] = None,
    scale: Annotated[
        list[str] | None,
        typer.Option(metavar="COLUMN=VALUE", help="SI value of one of a column's units (m per V, per count); repeat."),
    ] = None,
    zero: Annotated[
        list[str] | None,
        typer.Option(metavar="COLUMN=READING", help="Reading of a column at which its SI value is 0; repeat."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite campaign.toml, and a rig.toml skeleton that nobody wrote into.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the campaign; files outside it are copied (default: the files').")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Guess what data files hold, and write a commented campaign.toml that `maglev check` takes."""
    from dataclasses import replace
    from importlib.metadata import version
    from math import inf

    from rich.table import Table

    from maglev_env.loop.magnets.kinds import MAGNETS
    from maglev_env.recordings.files import write_text_atomic
    from maglev_env.recordings.formats.json_data import plain
    from maglev_env.recordings.guess.agreed import agreed, like_most, one_clock, one_rotor, without_motion
    from maglev_env.recordings.guess.evidence import LIKELY
    from maglev_env.recordings.guess.of_the_rig import perhaps_of_the_rig
    from maglev_env.recordings.guess.parts import parts_of
    from maglev_env.recordings.guess.recording import guess_recording
    from maglev_env.recordings.guess.suspended import below_the_magnet
    from maglev_env.recordings.guess.verified import verified
    from maglev_env.rig.rig_file import PRESETS, load_rig
    from maglev_workbench.commands.new import questions
    from maglev_workbench.commands.new.answer import HEAD, answer_of, rows
    from maglev_workbench.commands.new.campaign_text import campaign_text
    from maglev_workbench.commands.new.files import bring, campaign_folder, data_files, rig_beside
    from maglev_workbench.commands.new.joined import run_of_rasters, runs_of_parts, split_into_runs, write_joined
    from maglev_workbench.commands.new.rig_text import fault_of, is_filled_in, is_untouched, rig_text
    from maglev_workbench.commands.new.stated import (
        Stated,
        StatedColumns,
        channels_of,
        check_columns,
        guess_with,
        scales_of,
        values_of,
    )
    from maglev_workbench.console import console, marked, write_json

    told = StatedColumns(channels_of(channel or ()), scales_of(scale or ()), values_of("--zero", zero or ()))
    for name, value in (("--rate", rate), ("--mass", mass)):
        if value is not None and not 0 < value < inf:
            raise ValueError(f"{name} {value} must be positive and finite")
    if rig is not None:
        load_rig(rig)
    if magnet is not None:
        require_choice(magnet, MAGNETS, "--magnet")
    files = data_files(source)
    folder = campaign_folder(files, out)
    require_folder(folder)
    if (folder / "campaign.toml").exists() and not force:
        raise ValueError(f"{folder / 'campaign.toml'} exists; choose another --out, or overwrite it with --force")
    stated, guesses, refused = Stated(rate, mass, rig, magnet), [], {}
    asking, joined_runs = questions.interactive(), []
    files, several = split_into_runs(files, folder)
    for i, file in enumerate(files):
        try:
            guess = guess_with(file, rate, told)
            if asking and guess.rate.value is None and (asked := questions.ask_rate(file.name)):
                guess = guess_with(file, asked, told)
            if (run := run_of_rasters(file, guess)) is not None:
                files[i] = file = write_joined(run, folder)
                joined_runs.append(run)
                guess = guess_with(file, None, told)  # it has a clock, that of the slowest
                guess = replace(guess, notes=(f"written from parts: {run.why}", *guess.notes))
            if not guess.channels:
                raise ValueError(
                    f"{file}: no column is known by name or behaviour: {', '.join(guess.labels)}; say which is what, "
                    f"such as --channel {guess.labels[-1]}=displacement"
                )
            guesses.append(questions.ask_units(guess) if asking else guess)
        except ValueError as error:
            refused[file] = str(error)
    if not guesses:
        raise ValueError(next(iter(refused.values())))
    named_guesses = dict(zip([f for f in files if f not in refused], guesses, strict=True))
    still = without_motion(named_guesses)
    runs = runs_of_parts({f: g for f, g in named_guesses.items() if f not in still}, still) if still else []
    for run in runs:
        path = write_joined(run, folder)
        joined = guess_with(path, None, told)
        named_guesses = {f: g for f, g in named_guesses.items() if f not in run.parts} | {
            path: replace(joined, notes=(f"written from parts: {run.why}", *joined.notes))
        }
    files = [*named_guesses, *refused]
    guesses = list(named_guesses.values())
    check_columns(guesses, told)
    for file, guess in without_motion(named_guesses).items():
        guesses.remove(guess)
        refused[file] = (
            f"{file}: holds neither displacement nor acceleration, and a recording is one file: copy its columns "
            f"({', '.join(guess.channels)}) into the file that holds the displacement, at the same rate"
        )
    read = [f for f in files if f not in refused]
    guesses = [
        guess
        if columns is None and clock == guess.rate
        else replace(
            guess_recording(file, rate=clock.value, columns=columns or guess.columns), rate=clock, notes=guess.notes
        )
        for file, guess, columns, clock in zip(read, guesses, like_most(guesses), one_clock(guesses), strict=True)
    ]
    stated = questions.ask_rig(stated) if asking else stated
    inside, copied = bring(read, folder)
    own = folder / "rig.toml"
    untouched = own if force and is_untouched(own) else None
    stated = replace(stated, rig=None if rig is None else rig_beside(rig, folder, untouched))
    names = [f.resolve().relative_to(folder.resolve()).as_posix() for f in inside]
    named = one_rotor([replace(g, file=name) for g, name in zip(guesses, names, strict=True)])
    guesses = agreed([verified(part, folder) for guess in named for part in parts_of(guess, folder)])
    if stated.rig is not None:
        known_rig = load_rig(stated.rig if stated.rig in PRESETS else folder / stated.rig)
        guesses = [below_the_magnet(perhaps_of_the_rig(g, known_rig), known_rig, folder) for g in guesses]

    known = next((g for g in guesses if g.gains or g.form), None)
    if stated.rig is None and (untouched is not None or not own.exists()):
        hangs = all(g.rotor.value == "suspended" and g.rotor.confidence >= LIKELY for g in guesses)
        driven = any({"current", "command", "current_x", "command_x"} & g.channels.keys() for g in guesses)
        gains, rate = (known.gains or known.form, known.rate.value) if known else (None, None)
        axes = 2 if any("displacement_y" in g.channels for g in guesses) else 1
        text = rig_text(stated, gains, rate, hangs, driven, axes)
        write_text_atomic(own, text)
    write_text_atomic(folder / "campaign.toml", campaign_text(guesses, stated))
    fault = "" if stated.rig is not None or is_untouched(own) else fault_of(own)
    answer = answer_of(guesses, refused, stated, stated.rig is None, is_filled_in(own), fault)
    write_json(
        json_file,
        {
            "schema": "maglev-new/1",
            "version": version("maglev-workbench"),
            "answer": answer.sentence,
            "edit": list(answer.edit),
            "confirm": list(answer.confirm),
            "campaign": str(folder / "campaign.toml"),
            "recordings": [{"file": g.file, "guesses": plain(g.guesses), "notes": list(g.notes)} for g in guesses],
            "left_out": [{"file": str(f), "reason": r} for f, r in refused.items()],
        },
    )
    console.print(answer.sentence, style="bold")
    table = Table(*HEAD)
    for row in rows(guesses):
        table.add_row(*row)
    console.print(table)
    for run in (*several, *joined_runs, *runs):
        console.print(f"{run.why}: {run.name}")
    for text in (*answer.alarms, *(f"left out: {message}" for message in refused.values())):
        console.print(marked("  !", text))
    if copied:
        console.print(f"{len(copied)} file(s) copied to {folder}")
    for heading, points in (("edit", answer.edit), ("confirm", answer.confirm)):
        for i, point in enumerate(points):
            console.print(f"{heading if i == 0 else '':7} {i + 1}. {point}")
    console.print(f"The evidence of every guess stands in {folder / 'campaign.toml'}.", soft_wrap=True)
    console.print(f"next  maglev check {folder}", soft_wrap=True)
