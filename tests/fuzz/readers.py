"""Every reader of files from outside, with a small good file to damage and what must hold of whatever is read."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from muybridge.geometry.calibration.formats.export import EXPORT_FORMATS, export_calibration
from muybridge.geometry.calibration.formats.registry import read_calibration
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.geometry.sync.clocks import Clock
from muybridge.infer.labelling.corrections import read_corrections
from muybridge.infer.pipelines.calibration.board import read_board
from muybridge.infer.pipelines.calibration.known_points import read_points
from muybridge.infer.pipelines.sync import write_sync
from muybridge.infer.runtime.stages import StageStore
from muybridge.infer.session.sync_file import read_sync
from muybridge.infer.session.timestamps import paired_by_time
from muybridge.models.keypoints.external import load_card, shipped_cards
from muybridge.models.keypoints.metadata import keypoint_card
from muybridge.models.pseudo_labels import PseudoLabels, load_pseudo_labels, save_pseudo_labels
from muybridge.motion.character.character import Character
from muybridge.motion.character.read import read_character
from muybridge.motion.formats.points.c3d import Analog, C3DTake, Event, write_c3d
from muybridge.motion.formats.points.world import FARTHEST
from muybridge.motion.formats.registry import ReadOptions, read_file, readable, write_file
from muybridge.motion.formats.skeletal.mot import write_mot
from muybridge.motion.take import Take
from muybridge.npz import load_npz
from tests.fuzz.mutators import Kind
from tests.geometry.calibration.format_texts import caliscope_text, opencv_text, pose2sim_text, qualisys_text, rig
from tests.motion.character.test_characters import rig_file
from tests.motion.character.test_fbx_characters import character_file
from tests.motion.formats.test_fbx_text import text_file
from tests.motion.formats.test_gltf_packed import QUATERNIONS, packed_file
from tests.motion.formats.test_layouts import TABLES
from tests.motion.formats.test_mot import make_motion
from tests.rigs import ring_of_cameras


@dataclass(frozen=True)
class Reader:
    """One reader.

    Attributes:
        kind: of damage.
        write: makes the good files in a folder, and returns the one to damage.
        read: from the path of the damaged file.
        check: of what was read.
    """

    kind: Kind
    write: Callable[[Path], Path]
    read: Callable[[Path], Any]
    check: Callable[[Any], None] = lambda _: None


def a_walk() -> Points3D:
    """Four points over five frames, one of them missing once."""
    xyz = np.random.default_rng(0).normal(0, 1, (5, 4, 3))
    xyz[1, 1] = np.nan
    none = (0, 5, 4)
    names = LandmarkSet("c3d", ("LASI", "RASI", "SACR", "C7"), ())
    return Points3D(names, xyz, np.full((5, 4, 3, 3), np.nan), np.empty(none), np.empty(none, bool), 100.0)


def a_motion() -> Motion:
    """Four joints over three frames."""
    rng = np.random.default_rng(1)
    skeleton = Skeleton(
        ("hips", "spine", "head", "leg"), (-1, 0, 1, 0),
        np.array([[0, 0, 0], [0, 0, 0.2], [0, 0, 0.3], [0.1, 0, 0]]),
        np.array([[np.nan] * 3, [np.nan] * 3, [0, 0, 0.2], [0, 0, -0.8]]),
        (2,) * 4, np.full((4, 3), -np.inf), np.full((4, 3), np.inf),
    )  # fmt: skip
    return Motion(skeleton, 50.0, rng.normal(0, 1, (3, 3)), quat_from_matrix(exp_so3(rng.normal(0, 1, (3, 4, 3)))))


def sound_take(take: Take) -> None:
    """Finite or missing, within a room, with a frame rate and rotations."""
    xyz = take.positions.points_world
    known = np.isfinite(xyz)
    assert xyz.shape[1:] == (len(take.positions.landmarks), 3) and 0 < take.fps < np.inf and np.isfinite(take.start)
    assert (known.any(-1) == known.all(-1)).all() and not np.isinf(xyz).any()
    assert np.abs(xyz[known]).max(initial=0) <= FARTHEST
    if take.motion is not None:
        assert known.all() and np.isfinite(take.motion.skeleton.offsets).all()
        np.testing.assert_allclose(np.linalg.norm(take.motion.quat_wxyz, axis=-1), 1, atol=1e-6)
    if take.c3d is not None:
        assert all(np.isfinite(e.time) for e in take.c3d.events)


def sound_rig(calibration: Any) -> None:
    """Cameras with finite parameters, within a room."""
    for camera in calibration.cameras:
        assert 0 < camera.width < 1e6 and 0 < camera.height < 1e6
        assert np.isfinite(camera.camera_matrix).all() and np.isfinite(camera.params).all()
    centers = calibration.cameras.centers_world
    assert np.isfinite(centers).all() and np.abs(centers).max() <= FARTHEST


def _take_file(suffix: str) -> Reader:
    kinds: dict[str, Kind] = {".c3d": "binary", ".fbx": "binary", ".npz": "zip", ".parquet": "binary", ".glb": "glb"}
    source = {".vrm": ".glb", ".vrma": ".glb", ".sto": ".mot", ".tsv": ".csv", ".txt": ".csv"}.get(suffix, suffix)

    def write(folder: Path) -> Path:
        path = folder / f"good{source}"
        if suffix == ".gltf":
            return _gltf(folder)
        if source == ".c3d":
            analog = Analog(("Fz",), ("N",), 200.0, np.arange(10.0)[:, None])
            write_c3d(path, C3DTake(a_walk(), 5, (Event("Foot Strike", 0.1, "Left"),), analog))
        elif source == ".mot":
            write_mot(path, make_motion(4))
        else:
            write_file(path, Take(motion=a_motion()) if source in (".bvh", ".amc", ".glb", ".fbx") else
                       Take(points=a_walk()))  # fmt: skip
        if suffix == ".tsv":
            path.write_text(path.read_text().replace(",", "\t"))
        return path.rename(folder / f"good{suffix}") if source != suffix else path

    return Reader(kinds.get(source, "text"), write, read_file, sound_take)


def _table(name: str) -> Reader:
    """A table as a program writes it; those that state no frame rate are told one."""
    file, text = TABLES[name]
    options = ReadOptions(fps=50.0 if name.startswith(("deeplabcut", "anipose")) else None)
    return Reader("text", _text(file, text()), lambda path: read_file(path, options), sound_take)


def _gltf(folder: Path) -> Path:
    """The JSON of a GLB with its numbers in a file beside it."""
    write_file(folder / "good.glb", Take(motion=a_motion()))
    data = (folder / "good.glb").read_bytes()
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    document["buffers"][0]["uri"] = "numbers.bin"
    (folder / "numbers.bin").write_bytes(data[28 + size :])
    (folder / "good.gltf").write_text(json.dumps(document))
    return folder / "good.gltf"


def _asf(folder: Path) -> Path:
    write_file(folder / "motion.amc", Take(motion=a_motion()))
    return (folder / "motion.asf").rename(folder / "good.asf")


def _read_asf(path: Path) -> Take:
    for other in path.parent.glob("*.asf"):
        if other != path:
            other.unlink()
    return read_file(path.with_name("motion.amc"))


def _text(name: str, text: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text(text, encoding="utf-8")
        return folder / name

    return write


def _exported(how: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        cameras = ring_of_cameras(["a", "b"], height=[1.5, 1.6], angles=[0.4, 2.5], size=(640, 480), model="PINHOLE",
                                  params=[(500.0, 500.0, 320.0, 240.0)] * 2)  # fmt: skip
        return sorted(export_calibration(cameras, folder / "rig", how))[0]

    return write


def _sync(folder: Path) -> Path:
    clocks = tuple(Clock(k / 7, k * 1e-5, 1e-3, 1e-6, 1.0) for k in range(3))
    result = SimpleNamespace(clocks=clocks, methods=("sound",) * 3)
    write_sync(folder / "sync.toml", ("a", "b", "c"), result)  # type: ignore[arg-type]
    return folder / "sync.toml"


def _sound_clocks(clocks: tuple[Clock, ...]) -> None:
    for clock in clocks:
        assert np.isfinite([clock.offset, clock.drift, clock.offset_sd]).all() and abs(clock.drift) < 0.5


_STAMPS = "sync_index,cam_id,frame_time\n" + "".join(
    f"{t},{c},{100 + t / 30 + c / 1000:.4f}\n" for t in range(6) for c in range(2)
)
_VIDEOS = [SimpleNamespace(path=Path(f"cam_{c}.mp4"), frames=6) for c in range(2)]


def _sound_stamps(found: tuple[Any, ...]) -> None:
    fps, frames, late, _ = found
    assert 0 < fps < np.inf and ((frames >= 0) & (frames < 6)).all() and np.isfinite(late).all()


def _stage(folder: Path) -> Path:
    arrays = {"points": np.arange(12.0).reshape(4, 3), "names": np.array(["a", "bc"])}
    StageStore(folder).save("good", "key", arrays, {"count": 3}, 1.5)
    return folder / "good.npz"


def _read_stage(path: Path) -> Any:
    return StageStore(path.parent).load(path.stem, "key")


def _sound_stage(found: Any) -> None:
    if found is not None:  # else it is computed again
        assert set(found.arrays) <= {"points", "names"} and isinstance(found.facts, dict)
        assert np.isfinite(found.seconds) or found.seconds != found.seconds


def _card(folder: Path) -> Path:
    return Path(shutil.copy(shipped_cards()["rtmpose-coco17"], folder / "card.toml"))


def _sound_card(card: Any) -> None:
    assert 0 < card.width * card.height <= 2048**2
    assert np.isfinite(
        [card.split_ratio, card.softmax_scale, card.white, *card.mean, *card.std, card.box_padding]
    ).all()


_METADATA = {
    "muybridge_kind": "keypoints", "version": "0.0.1", "landmark_set": "three",
    "names": '["nose", "left_a", "right_a"]',
    "input_size": "128", "stride": "4", "box_padding": "1.25",
    "variance": '{"scale": 1.5, "floor_px2": 0.25, "knots": [[1.0, 2.0], [3.0, 4.0]], "landmarks": [1, 2, 3]}',
}  # fmt: skip


def _read_metadata(path: Path) -> Any:
    lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
    return keypoint_card(dict(line.partition("=")[::2] for line in lines), path)


def _pseudo_labels(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    labels = PseudoLabels(
        rng.integers(0, 255, (2, 8, 8, 4), dtype=np.uint8), rng.random((2, 3, 2), dtype=np.float32),
        np.ones((2, 3), bool), np.zeros(2, bool), 1.25, {"session": "s"},
    )  # fmt: skip
    save_pseudo_labels(folder / "good.npz", labels)
    return folder / "good.npz"


_CORRECTIONS = "# frames from to\n100-250 LWRA LWRB\n410 *12 RTOE\nall C7 T10\n300-320 LTOE delete\n"
_KNOWN_POINTS = "camera,x,y,z,u,v\n" + "".join(f"a,{k},{k * 2},0.5,{100 + k},{200 - k}\n" for k in range(4))
_BOARD = 'columns = 4\nrows = 5\nsquare_size_override_cm = 5.4\ndictionary = "DICT_4X4_100"\ninverted = true\n'


def _sound_character(character: Character) -> None:
    """Finite meshes whose triangles and weights refer to what there is, and a motion as of any file."""
    sound_take(Take(motion=character.motion))
    for mesh in character.meshes:
        assert np.isfinite(mesh.positions).all() and 0 <= mesh.triangles.min(initial=0)
        assert mesh.triangles.max(initial=-1) < len(mesh.positions) and mesh.joints.shape == mesh.weights.shape
        assert mesh.joints.min(initial=0) >= 0 and mesh.joints.max(initial=0) < len(character.skeleton)
        assert all(m.offsets.shape == mesh.positions.shape for m in mesh.morphs)


def _text_fbx(folder: Path) -> Path:
    return text_file(character_file(folder / "binary.fbx"), folder / "good.fbx")


READERS: dict[str, Reader] = {
    **{suffix: _take_file(suffix) for suffix in readable()},
    **{f"table {name}": _table(name) for name in TABLES},
    "character glTF": Reader("glb", lambda f: rig_file(f / "good.glb", {}), read_character, _sound_character),
    "character FBX": Reader("binary", lambda f: character_file(f / "good.fbx"), read_character, _sound_character),
    "character FBX text": Reader("text", _text_fbx, read_character, _sound_character),
    "packed glTF": Reader("glb", lambda f: packed_file(f / "good.glb", QUATERNIONS), read_file, sound_take),
    ".asf": Reader("text", _asf, _read_asf, sound_take),
    **{f"calibration {how}": Reader("text", _exported(how), read_calibration, sound_rig) for how in EXPORT_FORMATS},
    "calibration qualisys": Reader("text", _text("rig.txt", qualisys_text(rig())), read_calibration, sound_rig),
    "calibration pose2sim": Reader("text", _text("rig.toml", pose2sim_text(rig())), read_calibration, sound_rig),
    "calibration caliscope": Reader("text", _text("rig.toml", caliscope_text(rig())), read_calibration, sound_rig),
    "calibration opencv maps": Reader("text", _text("rig.yml", opencv_text(rig())), read_calibration, sound_rig),
    "sync.toml": Reader("text", _sync, lambda p: read_sync(p, ("a", "b", "c")), _sound_clocks),
    "timestamps": Reader("text", _text("t.csv", _STAMPS), lambda p: paired_by_time(p, _VIDEOS), _sound_stamps),
    "stage": Reader("zip", _stage, _read_stage, _sound_stage),
    "npz": Reader("zip", _stage, load_npz),
    "model card": Reader("text", _card, load_card, _sound_card),
    "metadata": Reader("text", _text("m.txt", "\n".join("=".join(i) for i in _METADATA.items())), _read_metadata),
    "pseudo-labels": Reader("zip", _pseudo_labels, load_pseudo_labels),
    "corrections": Reader("text", _text("c.txt", _CORRECTIONS), read_corrections),
    "known points": Reader("text", _text("p.csv", _KNOWN_POINTS), read_points),
    "board": Reader("text", _text("b.toml", _BOARD), read_board),
}
