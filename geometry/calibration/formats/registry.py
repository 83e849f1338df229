"""Finding, recognising and reading of calibration files, and writing of our own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from muybridge.errors import CalibrationError, OutputError, parsing
from muybridge.files import replacing
from muybridge.geometry.calibration.formats.colmap import colmap_files, is_colmap_file, read_colmap
from muybridge.geometry.calibration.formats.common import Calibration, Malformed, check_plausible
from muybridge.geometry.calibration.formats.easymocap import easymocap_sibling
from muybridge.geometry.calibration.formats.native import native_text
from muybridge.geometry.calibration.formats.opencv import is_one_camera, read_opencv_files
from muybridge.geometry.calibration.formats.table import KNOWN_FORMATS, looks_like, recognise
from muybridge.geometry.calibration.gravity import tilt_notes
from muybridge.geometry.cameras.group import CameraGroup

_KNOWN = "known formats: " + ", ".join(KNOWN_FORMATS)
# Calibrations of the largest rigs have some 100 KB; the limit avoids reading a video that is mistaken for one.
_MAX_BYTES = 16 * 2**20
_LOOKED_AT = 2**20
_ONE_CAMERA_FILES = ("OpenCV YAML", "OpenCV XML")


def load_calibration(path: Path) -> CameraGroup:
    """Load the cameras of a calibration file of any known format; see `read_calibration`."""
    return read_calibration(path).cameras


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file of any known format, recognised by its content.

    Args:
        path: a file; or, for a COLMAP model, its folder or one of its files; or a folder of OpenCV YAML files with one
            camera each.

    Returns:
        The cameras (metres, world to camera), the format's name and notes on assumptions.

    Raises:
        CalibrationError: the file cannot be read, is of no known format, or is damaged; the message contains the file,
            what is wrong (line, camera, field) and what would be valid.
    """
    path = Path(path)
    with parsing(path, CalibrationError, "a calibration"):
        calibration = _read(path)
        try:
            check_plausible(calibration.cameras)
        except Malformed as error:
            raise CalibrationError(f"{path}: {error}") from None
    return replace(calibration, notes=(*calibration.notes, *tilt_notes(calibration.cameras)))


def _read(path: Path) -> Calibration:
    if not path.exists():
        raise CalibrationError(f"{path}: there is no such calibration file; {_KNOWN}")
    model = colmap_files(path if path.is_dir() else path.parent)
    if path.is_dir() and model is None:
        files = _one_camera_each(_candidates(path)[0])
        if not files:
            raise CalibrationError(
                f"{path}: the folder holds no COLMAP model (cameras and images, .bin or .txt), nor OpenCV YAML or "
                f"XML of one camera each; name a file; {_KNOWN}"
            )
        try:
            return read_opencv_files(files)
        except Malformed as error:
            raise CalibrationError(f"{path}: damaged or incomplete OpenCV calibration: {error}") from None
    if model and (path.is_dir() or is_colmap_file(path)):
        try:
            return read_colmap(*model)
        except Malformed as error:
            raise CalibrationError(f"{model[0].parent}: damaged COLMAP model: {error}") from None
    text = _text(path)
    found = recognise(text)
    if found is None or found.read is None:
        hint = ""
        if is_colmap_file(path):
            hint = " (of a COLMAP model both cameras and images are needed, in one folder)"
        with path.open("rb") as file:
            words = looks_like(file.read(_LOOKED_AT))
        hint = hint or (f": it looks like {words}" if words else "")
        raise CalibrationError(f"{path}: not a calibration file of a known format{hint}; {_KNOWN}")
    try:
        return found.read(text or "", path)
    except Malformed as error:
        raise CalibrationError(f"{path}: damaged or incomplete {found.name} calibration: {error}") from None


def _text(path: Path) -> str | None:
    """The text of a file; None if it is binary or too large for a calibration."""
    if not path.is_file() or path.stat().st_size > _MAX_BYTES:
        return None
    data = path.read_bytes()
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or data[:4] == b"<\0?\0":  # Motive's XML
        return data.decode("utf-16" if data[:1] != b"<" else "utf-16-le", errors="replace")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if not data.lstrip().startswith(b"<?xml"):
            return None
        text = data.decode("latin-1")  # older XML exports; only names could differ
    return None if "\0" in text else text


def find_calibration(session_dir: Path) -> Path:
    """Find the calibration of a session folder.

    That is `calibration.toml` in it; else the only file of a known format directly in its folder `calibration` (a
    COLMAP model, which consists of several files, counts as one and is returned as that folder, as do OpenCV files
    of one camera each); else the only one directly in the session folder, where other programs write theirs.

    Raises:
        CalibrationError: none, or several, whose names the message lists.
    """
    session_dir = Path(session_dir)
    own = session_dir / "calibration.toml"
    if own.is_file():
        return own
    expected = (
        f"put calibration.toml into {session_dir}, or one file of a known format into "
        f"{session_dir / 'calibration'}; {_KNOWN}"
    )
    folders = [f for f in (session_dir / "calibration", session_dir) if f.is_dir()]
    listed = ""
    for folder in folders:
        try:
            found, others = _candidates(folder)
        except OSError as error:
            raise CalibrationError(
                f"{folder}: cannot be read: {error.strerror or error}; {expected}", remedy="calibration_path"
            ) from None
        if len(found) > 1 and _one_camera_each(found):
            return folder
        if len(found) > 1:
            names = ", ".join(p.name if p != folder else "a COLMAP model" for p in found)
            raise CalibrationError(
                f"{folder}: several calibrations ({names}); leave one there", remedy="calibration_path"
            )
        if found:
            return found[0]
        if others and folder != session_dir:
            listed = f" ({', '.join(others[:5])}{', ...' if len(others) > 5 else ''} is of none)"
    if len(folders) < 2:
        raise CalibrationError(
            f"{session_dir}: no calibration; {expected}", remedy="no_calibration", session=session_dir
        )
    raise CalibrationError(
        f"{folders[0]}: no calibration file of a known format{listed}; {expected}",
        remedy="no_calibration", session=session_dir,
    )  # fmt: skip


def _candidates(folder: Path) -> tuple[list[Path], list[str]]:
    """Calibrations directly in a folder, and the names of its other files."""
    found: list[Path] = []
    others: list[str] = []
    has_model = colmap_files(folder) is not None
    if has_model:
        found.append(folder)
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or not path.is_file() or (has_model and is_colmap_file(path)):
            continue
        sibling = easymocap_sibling(path)
        if sibling is not None and sibling in found:
            continue  # the second file of a pair
        if recognise(_text(path)):
            found.append(path)
        else:
            others.append(path.name)
    return found, others


def _one_camera_each(found: Sequence[Path]) -> dict[str, str]:
    """The texts by file stem, if all files are OpenCV YAML with one camera each."""
    texts: dict[str, str] = {}
    for path in found:
        text = _text(path) if path.is_file() else None
        known = recognise(text)
        if text is None or known is None or known.name not in _ONE_CAMERA_FILES or not is_one_camera(text):
            return {}
        texts[path.stem] = text
    return texts


def save_calibration(cameras: CameraGroup, path: Path) -> None:
    """Write cameras as our own TOML, which reads back to the same bits.

    The file is written under a temporary name and renamed, so that an aborted run leaves no partial file.

    Raises:
        OutputError: the file cannot be written.
        ValueError: a camera's name cannot be written as UTF-8.
    """
    path = Path(path)
    text = native_text(cameras).encode("utf-8")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: cannot be written: No such file or directory; choose a folder that exists")
    with replacing(path) as temporary:
        temporary.write_bytes(text)
