"""The data files that `maglev new` is pointed at, and the campaign's folder."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from maglev_env.recordings.files import SAVE_AS, SUFFIXES, atomic_file
from maglev_env.rig.rig_file import PRESETS

JOINED = "_joined"  # how the name of a file ends that holds the columns of several


def data_files(sources: Sequence[Path]) -> list[Path]:
    """The data files among files and folders, in order.

    Args:
        sources: files, and folders whose data files (not those of folders below) are taken, also those of a kind
            that is not read, which are to be named.

    Raises:
        FileNotFoundError: a source does not exist.
        ValueError: a folder holds no data file.
    """
    found: list[Path] = []
    for source in sources:
        if not source.exists():
            raise FileNotFoundError(f"{source} does not exist; name data files or a folder of them")
        if source.is_dir():
            inside = sorted(p for p in source.iterdir() if p.is_file() and p.suffix.lower() in (*SUFFIXES, *SAVE_AS))
            inside = [p for p in inside if not _of_parts(p, inside)]
            # Beside data of another kind, it is more often settings or results.
            inside = [p for p in inside if p.suffix.lower() != ".json"] or inside
            if not inside:
                raise ValueError(f"{source} holds no data file ({', '.join(SUFFIXES)})")
            found += inside
        else:
            found.append(source)
    return list(dict.fromkeys(found))


def _of_parts(file: Path, files: Sequence[Path]) -> bool:
    """Whether a file was joined before from others that are still there."""
    run = file.stem.removesuffix(JOINED)
    sources = [p for p in files if p != file and not p.stem.endswith(JOINED)]
    return run != file.stem and any(p.stem.startswith(run) or run.startswith(f"{p.stem}_") for p in sources)


def campaign_folder(files: Sequence[Path], out: Path | None) -> Path:
    """The folder of the campaign: `out`, else that of the files. ValueError where they lie in several."""
    if out is not None:
        return out
    folders = {f.resolve().parent for f in files}
    if len(folders) > 1:
        raise ValueError("the files lie in several folders; name the campaign's folder: --out FOLDER")
    return files[0].parent


def rig_beside(rig: str, folder: Path, replaced: Path | None = None) -> str:
    """A rig as campaign.toml names it: a preset, or a TOML in the folder, to which one from elsewhere is copied.

    Args:
        rig: as the user names it.
        folder: of the campaign.
        replaced: a skeleton in the folder in whose place it may be copied; None: none.

    Raises:
        ValueError: another file of that name is there.
    """
    if rig in PRESETS:
        return rig
    if replaced is not None and replaced.name == Path(rig).name and replaced.resolve() != Path(rig).resolve():
        _copy(Path(rig), replaced)
    inside, _ = bring([Path(rig)], folder)
    return inside[0].resolve().relative_to(folder.resolve()).as_posix()


def bring(files: Sequence[Path], folder: Path) -> tuple[list[Path], list[Path]]:
    """The files as they lie in the folder, and those that were copied there.

    Raises:
        ValueError: a different file of the same name is there already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    inside, copied = [], []
    for file in files:
        if file.resolve().is_relative_to(folder.resolve()):
            inside.append(file)
            continue
        target = folder / file.name
        if target.exists():
            if target.read_bytes() != file.read_bytes():
                raise ValueError(f"{target} exists and is not {file}; choose another --out")
        else:
            _copy(file, target)
            copied.append(target)
        inside.append(target)
    return inside, copied


def _copy(file: Path, target: Path) -> None:
    with file.open("rb") as data, atomic_file(target) as written:
        shutil.copyfileobj(data, written)
