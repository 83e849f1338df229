"""Find the videos of a session folder."""

import contextlib
import json
from collections import Counter
from pathlib import Path

from muybridge.errors import SessionError
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.session.chapters import VIDEO_SUFFIXES, camera_videos, recorded_order
from muybridge.infer.session.pairing import in_order, natural_key, numbered_otherwise, pair_by_name
from muybridge.infer.session.probe import is_video
from muybridge.infer.session.timestamps import TIMESTAMPS

# Small copies that action cameras and drones write beside their videos.
PROXY_SUFFIXES = frozenset((".lrv", ".lrf", ".thm"))


# Folders for a session's videos (other programs use other names); the first that exists is used, otherwise the session
# folder itself.
VIDEO_FOLDERS = ("videos", "synchronized_videos", "videos-raw", "recordings")


# A results folder has this file, and overlays whose names begin so.
MANIFEST_PLACE = ("work", "manifest.json")
OVERLAY = "overlay_"


# Folders in which other programs keep one folder of images per camera.
IMAGE_FOLDERS = ("images", "imgs", "frames")


IMAGE_SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"))


def find_videos(path: Path) -> tuple[list[Path], list[str]]:
    """The videos of a session in natural order, and notices about other files among them.

    A video is a file, or the folder of a camera that has one of its own (see `camera_videos`).

    Raises:
        SessionError: no such folder, no `videos/` in it, no video there, two files of one name, or a results folder.
    """
    layout = "a session is a folder with `videos/` (one file per camera) and a calibration"
    if not path.is_dir():
        what = "is a file" if path.exists() else "does not exist"
        raise SessionError(f"{path} {what}; {layout}")
    if is_results(path):
        session = session_of_results(path)
        which = f", {session}" if session is not None else ", which has the folder `videos`"
        raise SessionError(f"{path} is a results folder; name the session's folder{which}")
    folder = video_folder(path)
    if folder == path and not any(p.is_file() and p.suffix.lower() in VIDEO_SUFFIXES for p in path.iterdir()):
        hint = _images_hint(next((f for f in (path / name for name in IMAGE_FOLDERS) if f.is_dir()), path))
        raise SessionError(
            f"{path} has no folder `videos`: put the videos into {path / 'videos'}, one file per camera{hint}"
        )
    found: list[Path] = []
    ignored: list[str] = []
    for entry in sorted(folder.iterdir(), key=lambda p: natural_key(p.name)):
        if entry.name.startswith("."):
            continue
        kind = entry.suffix.lower()
        if entry.is_file() and (kind in VIDEO_SUFFIXES or (kind not in PROXY_SUFFIXES and is_video(entry))):
            found.append(entry)
        elif entry.name not in TIMESTAMPS:
            ignored.append(entry.name)
    own = {f"{OVERLAY}{f.stem}" for f in found}
    ignored += [f.name for f in found if f.stem in own]
    found = [f for f in found if f.stem not in own]
    cameras = [] if found or folder == path else [f for f in _folders(folder) if camera_videos(f)]
    if cameras:
        held = ", ".join(_in_order(f) for f in cameras)
        beside = [name for name in ignored if name not in {f.name for f in cameras}]
        notices = [f"{folder} has a folder per camera, whose video was read: {held}"]
        return cameras, notices + ([f"{folder} also holds {', '.join(beside)}; ignored"] if beside else [])
    if not found:
        others = f" (it has {', '.join(ignored[:5])}, which are not videos, or are small copies)" if ignored else ""
        raise SessionError(f"{folder} holds no videos{others}: put one video per camera there{_images_hint(folder)}")
    twice = [stem for stem, n in Counter(f.stem.lower() for f in found).items() if n > 1]
    if twice:
        names = ", ".join(f.name for f in found if f.stem.lower() == twice[0])
        raise SessionError(f"{folder} has more than one video named {twice[0]} ({names}): keep one file per camera")
    if folder == path:  # beside the calibration and whatever else a session has
        return found, [f"{path} has no folder `videos`: the videos in the folder itself are used"]
    return found, [f"{folder} also holds {', '.join(ignored)}: not videos, or small copies; ignored"] if ignored else []


def _in_order(folder: Path) -> str:
    """A camera's files as they are read, such as `cam1/GX01.MP4 + GX02.MP4`."""
    return f"{folder.name}/{' + '.join(p.name for p in recorded_order(folder, camera_videos(folder)))}"


def is_results(path: Path) -> bool:
    """Whether a folder has results of muybridge."""
    return path.joinpath(*MANIFEST_PLACE).is_file()


def session_of_results(path: Path) -> Path | None:
    """The session that a results folder belongs to: the folder it is in, or the one it says; None where neither is."""
    above = path.resolve().parent
    with contextlib.suppress(OSError, ValueError, AttributeError):
        said = json.loads(path.joinpath(*MANIFEST_PLACE).read_text(encoding="utf-8")).get("of")
        if isinstance(said, str) and said and Path(said).is_dir():
            return Path(said)
    return above if any((above / name).is_dir() for name in VIDEO_FOLDERS) else None


def _folders(folder: Path) -> list[Path]:
    found = (f for f in folder.iterdir() if f.is_dir() and not f.name.startswith(".") and not is_results(f))
    return sorted(found, key=lambda f: natural_key(f.name))


def _images_hint(folder: Path) -> str:
    """How to make videos of a folder's images, where it holds one folder of images per camera; otherwise empty."""
    for camera in sorted((f for f in folder.iterdir() if f.is_dir()), key=lambda f: natural_key(f.name)):
        kinds = Counter(f.suffix for f in camera.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES)
        kind, count = kinds.most_common(1)[0] if kinds else ("", 0)
        if count > 1:
            return (
                f"; {folder} has folders of images: make a video of each at the cameras' frame rate, such as `ffmpeg "
                f"-framerate 30 -pattern_type glob -i '{camera}/*{kind}' -c:v mjpeg -q:v 2 videos/{camera.name}.mkv`"
            )
    return ""


def video_folder(path: Path) -> Path:
    """The folder of a session's videos."""
    return next((path / name for name in VIDEO_FOLDERS if (path / name).is_dir()), path)


def select_cameras(
    group: CameraGroup, files: list[Path], names: tuple[str, ...], calibration: Path
) -> tuple[CameraGroup, list[Path]]:
    """Only the named cameras and, where videos pair with cameras by name, only their videos."""
    unknown = [n for n in names if n not in group.names]
    if unknown:
        raise SessionError(
            f"{calibration} has no camera {', '.join(unknown)}; --cameras may name {', '.join(group.names)}"
        )
    names = tuple(dict.fromkeys(names))
    if len(names) < 2:
        raise SessionError(f"--cameras names {names[0]} alone: motion needs at least two cameras that see the person")
    stems = [f.stem for f in files]
    if counted := numbered_otherwise(stems, group.names):
        raise SessionError(f"{calibration}: cameras and videos are numbered differently; {in_order(counted)}")
    pairs = pair_by_name(stems, group.names)
    kept = [files[pairs[n]] for n in names if n in pairs]
    return group.select(names), kept if kept else files
