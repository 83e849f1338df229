"""The page of `muybridge view`: its data decode to what Python has, and it stands alone."""

import base64
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError, MuybridgeError, OutputError
from muybridge.geometry.roles import find_roles
from muybridge.infer.commands.motion.view import view
from muybridge.infer.viewer import read_scene, render_page
from muybridge.infer.viewer.page import read_asset
from muybridge.motion.character import Mesh, pose_mesh, read_character
from muybridge.motion.contacts.find import find_contacts
from muybridge.motion.editing import scale
from muybridge.motion.formats.registry import read_file, write_file
from muybridge.motion.take import Take
from tests.geometry.roles.bodies import human
from tests.motion.retargeting.test_retarget import moving
from tests.paths import SHARED

MOST_BYTES = 400_000


def array(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def places(packed: dict, shape: tuple[int, ...]) -> np.ndarray:
    return np.array(packed["offset"]) + packed["step"] * array(packed["data"], "<i2").reshape(shape)


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    skeleton, _ = human(np.random.default_rng(0)).build(None, 1.0, np.random.default_rng(0))
    path = tmp_path / "walk.bvh"
    write_file(path, Take(motion=moving(skeleton, 0, 8, size=0.1)))
    return path


def embedded(page: str) -> dict:
    found = re.search(r'<script type="application/json" data-part="data">(.*?)</script>', page, re.S)
    assert found is not None
    return json.loads(found[1])


def test_places_and_turns_decode_to_the_motion(walk: Path) -> None:
    motion = read_file(walk).motion
    assert motion is not None
    packed = embedded(render_page([read_scene(walk)]))["takes"][0]
    shape = motion.quat_wxyz.shape[:2]
    there = places(packed["places"], (*shape, 3))
    assert np.abs(there - motion.joint_positions_world()).max() <= 0.51 * packed["places"]["step"] < 1e-4
    turns = Rotation.from_quat(array(packed["turns"], "<i2").reshape(-1, 4)).as_matrix()
    assert np.abs(turns - motion.forward()[..., :3, :3].reshape(-1, 3, 3)).max() < 2e-4
    assert packed["parents"] == list(motion.skeleton.parents)


def skinned(packed: dict, mesh: dict, frame: int) -> np.ndarray:
    """What the vertex shader computes."""
    shape = (packed["frames"], len(packed["names"]))
    used = mesh["used"]
    world = np.tile(np.eye(4), (len(used), 1, 1))
    world[:, :3, :3] = Rotation.from_quat(array(packed["turns"], "<i2").reshape(*shape, 4)[frame, used]).as_matrix()
    world[:, :3, 3] = places(packed["places"], (*shape, 3))[frame, used]
    rows = np.tile(np.eye(4), (len(used), 1, 1))
    rows[:, :3] = array(mesh["bind"], "<f4").reshape(-1, 3, 4)
    joints = array(mesh["joints"], "<u2").reshape(-1, mesh["width"])
    weights = array(mesh["weights"], "<u2").reshape(-1, mesh["width"]) / 65535
    points = np.c_[places(mesh["positions"], (mesh["count"], 3)), np.ones(mesh["count"])]
    return np.einsum("vk,vkij,vj->vi", weights, (world @ rows)[joints], points)[:, :3]


def test_meshes_decode_to_the_vertices_of_python() -> None:
    path = SHARED / "data" / "characters" / "kaykit_knight.glb"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    character, packed = read_character(path), read_scene(path).packed
    world = character.motion.forward()[[20]]
    assert len(packed["meshes"]) == len(character.meshes) > 0
    for mesh, shown in zip(character.meshes, packed["meshes"], strict=True):
        assert isinstance(mesh, Mesh)
        assert np.abs(skinned(packed, shown, 20) - pose_mesh(mesh, world)[0]).max() < 1e-3


def test_page_is_small_and_asks_for_nothing_elsewhere(walk: Path) -> None:
    scene = read_scene(walk)
    page = render_page([scene])
    assert len(page) - len(json.dumps(scene.packed)) < MOST_BYTES
    for name in ("page.html", "component.html", "viewer.css", "maths.js", "drawing.js", "viewer.js"):
        assert not re.search(r"https?://|\bfetch\(|@import|<link rel=.style|src=", read_asset(name))


def test_names_cannot_close_the_script(walk: Path) -> None:
    scene = read_scene(walk)
    scene.packed["name"] = "</script><b>@@data@@"
    page = render_page([scene])
    assert "</script><b>" not in page
    assert embedded(page)["takes"][0]["name"] == "</script><b>@@data@@"


def test_command_writes_beside_the_file_and_replaces_its_own_page_alone(walk: Path) -> None:
    page = walk.with_suffix(".html")
    assert view((walk,), no_open=True) == 0
    assert view((walk, walk), side_by_side=True, no_open=True) == 0
    assert embedded(page.read_text())["apart"] is True
    page.write_text("mine")
    with pytest.raises(OutputError, match="was not made by muybridge"):
        view((walk,), no_open=True)
    assert page.read_text() == "mine"
    assert view((walk,), no_open=True, overwrite=True) == 0
    assert embedded(page.read_text())["takes"][0]["name"] == "walk.bvh"


@pytest.mark.parametrize(
    "name, content, what",
    [
        ("a.bvh", b"no", "a.bvh"),
        ("a.glb", b"\0" * 30, "a.glb"),
        ("a.xyz", b"", "cannot be read by its suffix"),
        ("a.trc", b"", "a.trc"),
        ("a.csv", b"frame,time,a_x,a_y,a_z\n1,0.0,,,\n2,0.1,,,\n", "a.csv"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, name: str, content: bytes, what: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MuybridgeError, match=what) as caught:
        view((tmp_path / name,), no_open=True)
    assert "\n" not in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_one_pose_is_no_single_frame(walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = read_file(walk).motion
    assert motion is not None
    path = tmp_path / "pose.glb"
    write_file(path, Take(motion=motion.select([0])))
    assert view((path,), no_open=True) == 0
    assert "pose.glb: one pose, without animation" in capsys.readouterr().out


def test_files_of_other_units_are_told(walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = read_file(walk).motion
    assert motion is not None
    path = tmp_path / "large.glb"
    write_file(path, Take(motion=scale(motion, 100.0)))
    assert view((walk, path), no_open=True) == 0
    assert f"`muybridge edit {shlex.quote(str(path))} scale 0.01 large_scaled.glb`" in capsys.readouterr().err
    assert view((walk, walk), no_open=True) == 0
    assert not capsys.readouterr().err


def test_joint_angles_of_a_robot_are_no_points(tmp_path: Path) -> None:
    path = tmp_path / "robot.csv"
    path.write_text("time,root_x,root_y,root_z,root_qw,root_qx,root_qy,root_qz,knee\n0,0,0,1,1,0,0,0,0.5\n")
    with pytest.raises(FormatError, match="joint angles of a robot"):
        view((path,), no_open=True)


def test_options_that_no_file_can_use_are_refused(walk: Path) -> None:
    with pytest.raises(FormatError, match="clip"):
        view((walk,), clip="1", no_open=True)
    with pytest.raises(MuybridgeError, match="no file to show"):
        view(())


def test_contacts_are_those_of_python(walk: Path) -> None:
    motion = read_file(walk).motion
    assert motion is not None
    found = find_contacts(motion, roles=find_roles(motion.skeleton).roles)
    packed = read_scene(walk).packed["contacts"]
    assert np.array_equal(array(packed["stands"], "u1").reshape(-1, 2, 2), found.contact)


@pytest.mark.slow
def test_browser_draws_the_page_without_an_error(walk: Path, tmp_path: Path) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is absent")
    page = tmp_path / "page.html"
    view((walk, walk), out=page, side_by_side=True, no_open=True)
    done = subprocess.run(
        [chromium, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=1000",
         "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=120, check=True)  # fmt: skip
    assert 'data-state="ready"' in done.stdout
    assert "CONSOLE" not in done.stderr
