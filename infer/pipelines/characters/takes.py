"""Which files are takes: files of motion, folders of them, sessions and results folders; and the takes' names."""

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from muybridge.errors import MuybridgeError
from muybridge.infer.results.names import DEFAULT_OUT, MOST_PEOPLE, MOTION_BVH, of_person
from muybridge.infer.session.chapters import VIDEO_SUFFIXES
from muybridge.infer.session.discover import VIDEO_FOLDERS, is_results, session_of_results
from muybridge.motion.formats.registry import can_use, motion_formats

_PERSON_OF = {of_person(MOTION_BVH, n): n for n in range(1, MOST_PEOPLE + 1)}
_MOST_NAMES = 8


@dataclass(frozen=True)
class Takes:
    """Files of motion that paths name.

    Attributes:
        files: each once.
        notices: what was passed over, one sentence each.
    """

    files: tuple[Path, ...]
    notices: tuple[str, ...] = ()


def find_takes(paths: Sequence[Path], but: Path | None = None) -> Takes:
    """The files of motion that paths name: files, folders of files, session and results folders.

    A results folder has a take for every person that `muybridge run` wrote. Of files of one name in one folder, which
    hold the same take in several formats, the first format of the registry is taken.

    Args:
        paths: what the user named.
        but: a file that is no take where a folder holds it, such as the character itself.

    Raises:
        MuybridgeError: a path is not there, or a folder holds no motion.
    """
    files: list[Path] = []
    notices: list[str] = []
    for path in paths:
        if not path.exists():
            raise MuybridgeError(f"{path}: no such file or folder; name takes, or folders of them")
        if path.is_file():
            files.append(path)
            continue
        results = next((f for f in (path, path / DEFAULT_OUT) if f.is_dir() and is_results(f)), None)
        if results is not None:
            found = [results / name for name in _PERSON_OF if (results / name).is_file()]
        else:
            found, passed = _files_of_motion(path, but)
            notices += passed
        if not found:
            if _has_videos(path):
                raise MuybridgeError(f"{path}: holds videos, of which no motion was made yet", remedy="run_session",
                                     path=shlex.quote(str(path)))  # fmt: skip
            raise MuybridgeError(f"{path}: holds no motion; valid are files of {', '.join(motion_formats())}")
        files.extend(found)
    return Takes(tuple(dict.fromkeys(files)), tuple(notices))


def takes_of(paths: Sequence[Path], clip: str | None, but: Path | None = None) -> Takes:
    """The takes that a user named.

    Args:
        paths: files of motion, folders of them, session and results folders.
        clip: the animation to read.
        but: as of `find_takes`.

    Raises:
        MuybridgeError: there is none, or none of them holds animations that `clip` could name.
    """
    takes = find_takes(paths, but)
    if not takes.files:
        raise MuybridgeError("no take is named; name files of motion, folders of them, or session folders")
    if clip is not None and not any(can_use(file, "clip") for file in takes.files):
        raise MuybridgeError("none of the takes is of a format that holds several animations", remedy="option_unused",
                             option="take-clip")  # fmt: skip
    return takes


def person_of(take: Path) -> int | None:
    """The number of the person whose motion a file of a results folder is; None of other files."""
    number = _PERSON_OF.get(take.name)
    return number if number is not None and is_results(take.resolve().parent) else None


def take_names(takes: Sequence[Path]) -> list[str]:
    """What each take is called: after its file, or its folder too where several files have one name.

    A motion of a results folder is called after the session, and the person where the takes are of several.
    """
    stems = [take.stem for take in takes]
    of_session = [take.resolve().parent if person_of(take) is not None else None for take in takes]
    out = []
    for take, stem, results in zip(takes, stems, of_session, strict=True):
        number = person_of(take)
        if results is None:
            out.append(stem if stems.count(stem) == 1 else f"{take.resolve().parent.name}_{stem}")
            continue
        folder = session_of_results(results) or (results.parent if results.name == DEFAULT_OUT else results)
        session = folder.name
        out.append(session if number == 1 and of_session.count(results) == 1 else f"{session}_person_{number}")
    return out


def clip_names(takes: Sequence[Path], wanted: str | None, taken: Iterable[str]) -> list[str]:
    """A name for each take's clip, no two the same.

    Args:
        takes: their files.
        wanted: by the user, for all of them; None for `take_names`.
        taken: clips that there are already.

    Raises:
        MuybridgeError: the wanted name is taken.
    """
    used = set(taken)
    if wanted is not None and wanted in used:
        listed = sorted(used)
        clips = ", ".join(listed[:_MOST_NAMES]) + (", ..." if len(listed) > _MOST_NAMES else "")
        raise MuybridgeError(f"there is a clip {wanted!r} already; its clips are {clips}", remedy="other_name")
    return _numbered([wanted] * len(takes) if wanted is not None else take_names(takes), used)


def person_clip_names(people: Iterable[int], taken: Iterable[str]) -> list[str]:
    """A name for the clip of each person of a results folder, by number."""
    return _numbered([f"person_{number}" for number in people], set(taken))


def _numbered(names: Sequence[str], used: set[str]) -> list[str]:
    """The names, with a number behind those that are used already."""
    out = []
    for base in names:
        name, k = base, 2
        while name in used:
            name, k = f"{base}_{k}", k + 1
        used.add(name)
        out.append(name)
    return out


def _has_videos(folder: Path) -> bool:
    """Whether a folder, or one for the videos of a session within it, holds videos by their names."""
    places = [place for place in (folder, *(folder / name for name in VIDEO_FOLDERS)) if place.is_dir()]
    return any(file.suffix.lower() in VIDEO_SUFFIXES for place in places for file in place.iterdir())


def _files_of_motion(folder: Path, but: Path | None) -> tuple[list[Path], list[str]]:
    """The takes of a folder in the order of their names, and notices about those in a further format."""
    order = {suffix: k for k, suffix in enumerate(motion_formats())}
    found = [f for f in folder.iterdir() if f.suffix.lower() in order and f.is_file()]
    if but is not None:
        found = [f for f in found if f.resolve() != but.resolve()]
    by_stem: dict[str, list[Path]] = {}
    for file in sorted(found, key=lambda f: (f.stem, order[f.suffix.lower()], f.name)):
        by_stem.setdefault(file.stem, []).append(file)
    notices = [
        f"{folder}: {', '.join(f.name for f in others)} passed over, since {first.name} has the same name; to take "
        "another one, name the file itself"
        for first, *others in by_stem.values() if others
    ]  # fmt: skip
    return [files[0] for files in by_stem.values()], notices
