"""The results folder: checked before any work; files in it that muybridge did not write are kept.

`work/manifest.json` has the digest of every file that was written here. A file that is not in it, or that was changed
since, belongs to somebody else and is replaced only with `overwrite` (see `muybridge.infer.results.ownership`).
"""

import json
import logging
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from muybridge.errors import OutputError
from muybridge.files import remove_abandoned, replacing
from muybridge.infer.results.ownership import make_writable, refuse_root
from muybridge.infer.runtime.digests import file_digest
from muybridge.infer.session.discover import MANIFEST_PLACE, VIDEO_FOLDERS, is_results

_log = logging.getLogger(__name__)
WORK, MANIFEST = MANIFEST_PLACE
_REMEMBERED = 2  # digests per file: a run killed between manifest and rename leaves the earlier file in place


class OutputFolder:
    """A folder for one session's results."""

    def __init__(self, path: Path):
        """Use `open_output`, which checks the folder first."""
        self.path = path
        self.work = path / WORK
        self._written, self.of = _read_manifest(self.work / MANIFEST)
        self._lock = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all files that were ever written here."""
        return tuple(self._written)

    def owns(self, name: str) -> bool:
        """Whether the file of this name is unchanged since muybridge wrote it."""
        known = self._written.get(name, [])
        return bool(known) and (self.path / name).is_file() and file_digest(self.path / name) in known

    def write(self, name: str, write: Callable[[Path], object]) -> Path:
        """Let `write` make the file `name` in a temporary folder, then move it into place.

        Raises:
            OutputError: the folder cannot be written or is full.
        """
        path = self.path / name
        with replacing(path, self.work) as temporary:
            write(temporary)
            digest = file_digest(temporary)
            with self._lock:
                # What others wrote into the folder meanwhile, such as the character of a run.
                self._written = {**_read_manifest(self.work / MANIFEST)[0], **self._written}
                self._written[name] = [digest, *self._written.get(name, [])][:_REMEMBERED]
                _write_manifest(self.work, self.of, self._written)
        _log.info("wrote %s", path)
        return path

    def retire(self, names: Iterable[str]) -> None:
        """Remove results of earlier runs that this one does not have; files changed by others stay."""
        for name in names:
            if self.owns(name):
                (self.path / name).unlink()

    def write_text(self, name: str, text: str) -> Path:
        """Write a text file (UTF-8)."""
        return self.write(name, lambda path: _write_text(path, text))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def is_ours(path: Path) -> bool:
    """Whether a folder has results of muybridge."""
    return is_results(path)


def open_output(
    path: Path, names: Sequence[str], inputs: Iterable[Path], overwrite: bool = False, session: Path | None = None
) -> OutputFolder:
    """Check that results can go to a folder, and make it.

    Args:
        path: the results folder; made if missing.
        names: files that will be written there.
        inputs: files that the run reads; results cannot go into their folders.
        overwrite: replace files of these names that muybridge did not write, or wrote of another session.
        session: that the results belong to; results of another session are not replaced. None where that is irrelevant.

    Raises:
        OutputError: the folder belongs to the input, cannot be written, or holds such files.
    """
    refuse_root(path)
    place = path.resolve()
    elsewhere = "other_folder" if session is None else "session_results"
    if any((path / name).is_dir() for name in VIDEO_FOLDERS):
        raise OutputError(f"{path} is a session's own folder, which takes no results", remedy=elsewhere)
    if any(_inside(place, folder) for folder in {i.resolve().parent for i in inputs}):
        raise OutputError(f"{path} is the folder of the input, which takes no results", remedy=elsewhere)
    if place.exists() and not place.is_dir():
        raise OutputError(f"{path} is a file, and results need a folder", remedy="other_folder")
    if _foreign_work(path / WORK):
        raise OutputError(f"{path / WORK} was not made by muybridge", remedy="move_folder")
    make_writable(path / WORK)
    if not is_ours(path):
        _write_manifest(path / WORK, "", {})
    output = OutputFolder(path)
    foreign = [n for n in names if (path / n).exists() and not output.owns(n)]
    directories = [n for n in foreign if (path / n).is_dir()]
    if directories or (foreign and not overwrite):
        raise OutputError(
            f"{path} already has {', '.join(directories or foreign)}, changed or made by something else",
            remedy="move_folder" if directories else "foreign_files",
        )
    if session is not None and session.resolve() not in place.parents:  # a session may be moved with its results
        of = str(session.resolve())
        if output.of not in ("", of) and not overwrite and any(output.owns(name) for name in output.names):
            raise OutputError(f"{path} has the results of {output.of}", remedy="other_session")
        output.of = of
    remove_abandoned(path / WORK)
    return output


def _inside(place: Path, folder: Path) -> bool:
    """Whether results at `place` would lie among the inputs in `folder`.

    A folder of its own below a session (the default) is fine; below `videos/` or `calibration/` it is not.
    """
    if place == folder:
        return True
    return folder.name in (*VIDEO_FOLDERS, "calibration") and folder in place.parents


def _foreign_work(work: Path) -> bool:
    if not work.exists():
        return False
    return not work.is_dir() or (any(work.iterdir()) and not (work / MANIFEST).is_file())


def _write_manifest(work: Path, of: str, files: Mapping[str, Sequence[str]]) -> None:
    text = json.dumps({"written_by": "muybridge", "of": of, "files": files}, indent=1)
    with replacing(work / MANIFEST) as temporary:
        _write_text(temporary, text)


def _read_manifest(path: Path) -> tuple[dict[str, list[str]], str]:
    """The digests of every file, and the session that the results belong to."""
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        files = {str(name): [str(d) for d in digests] for name, digests in manifest["files"].items()}
        return files, str(manifest.get("of", ""))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}, ""
