"""Robots as simulators and ROS write them: worlds, loose links, macros, other suffixes, other units."""

import re
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError, MuybridgeError
from muybridge.motion.robots import Robot, find_link_roles, read_robot
from tests.motion.robots.humanoids import write_small, write_tall

_CAMERA = (
    '<link name="camera"/><joint name="loose" type="floating"><parent link="{root}"/><child link="camera"/></joint>'
)


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    return write_small(tmp_path)


def rewritten(path: Path, text: str, name: str | None = None) -> Path:
    out = path.with_name(name or f"odd{path.suffix}")
    out.write_text(text, encoding="utf-8")
    return out


def with_more(path: Path, more: str, name: str | None = None) -> Path:
    text = path.read_text(encoding="utf-8").replace("</robot>", f"{more}</robot>")
    return rewritten(path, text.format(root=read_robot(path).links[0]) if "{root}" in text else text, name)


def held(path: Path, base: str, height: float, root: str) -> Robot:
    """The robot below one more link, to which its root is fixed."""
    more = (f'<link name="{base}"/><joint name="base_joint" type="fixed"><parent link="{base}"/><child link="{root}"/>'
            f'<origin xyz="0 0 {height}"/></joint>')  # fmt: skip
    return read_robot(with_more(path, more))


def test_the_world_that_a_robot_is_fixed_to_is_no_link_of_it(urdf: Path) -> None:
    plain = read_robot(urdf)
    robot = held(urdf, "world", 1.0, plain.links[0])
    assert robot.links == plain.links and not robot.notices
    assert robot.places[0].tolist() == [0, 0, 1]


@pytest.mark.parametrize("height", [0.0, 0.4, 2.0])
def test_parts_are_found_below_a_frame_of_any_height(urdf: Path, height: float) -> None:
    plain = read_robot(urdf)
    robot = held(urdf, "base_footprint", height, plain.links[0])
    assert robot.links == ("base_footprint", *plain.links)
    assert find_link_roles(robot).table(robot) == find_link_roles(plain).table(plain)


def test_links_that_hang_from_no_joint_are_left_out_and_named(urdf: Path) -> None:
    robot = read_robot(with_more(urdf, _CAMERA))
    assert "camera" not in robot.links
    assert robot.notices == (f"links that no joint fixes to {robot.links[0]} are left out: camera",)
    assert "table" in read_robot(with_more(urdf, '<link name="table"/>')).notices[0]


def test_a_urdf_may_be_called_xml_or_xacro(urdf: Path) -> None:
    text, links = urdf.read_text(encoding="utf-8"), read_robot(urdf).links
    for name in ("robot.xml", "robot.xacro"):
        assert read_robot(rewritten(urdf, text, name)).links == links


def test_macros_are_refused_with_the_command_that_expands_them(urdf: Path) -> None:
    macro = with_more(urdf, '<xacro:property xmlns:xacro="http://ros.org/wiki/xacro" name="r" value="1"/>', "r.xacro")
    value = rewritten(urdf, re.sub(r'mass value="[^"]*"', 'mass value="${m}"', urdf.read_text(encoding="utf-8")))
    for path in (macro, value):
        with pytest.raises(FormatError, match=f"`xacro {path.name} > {path.stem}_expanded.urdf`"):
            read_robot(path)


def test_what_is_not_read_is_not_called_damaged(urdf: Path, tmp_path: Path) -> None:
    planar = rewritten(urdf, urdf.read_text(encoding="utf-8").replace('"revolute"', '"planar"', 1))
    tall = write_tall(tmp_path)
    ball = rewritten(
        tall, tall.read_text(encoding="utf-8").replace('<joint name="waist"', '<joint type="ball" name="waist"')
    )
    for path, kind in ((planar, "planar"), (ball, "ball")):
        with pytest.raises(FormatError, match=f"is of the type '{kind}'.*replace the joint") as caught:
            read_robot(path)
        assert "damaged" not in str(caught.value)


@pytest.mark.parametrize(
    "text, message",
    [
        ('<robot name="r"/>', "there is no link"),
        ('<robot name="r"><link name="a"/><link name="a"/></robot>', "two links are called 'a'"),
        ('<mujoco><include file="lost.xml"/><worldbody/></mujoco>', "lost.xml: cannot be read"),
    ],
)
def test_the_message_names_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / f"robot{'.urdf' if 'robot' in text else '.xml'}"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        read_robot(path)


def test_a_robot_in_millimetres_is_refused_with_the_unit(urdf: Path) -> None:
    def longer(match: re.Match[str]) -> str:
        return f'xyz="{" ".join(str(1000 * v) for v in np.array(match[1].split(), float))}"'

    text = re.sub(r'<origin xyz="([^"]*)"', lambda m: "<origin " + longer(m), urdf.read_text(encoding="utf-8"))
    with pytest.raises(MuybridgeError, match="metres; its lengths seem to be millimetres"):
        read_robot(rewritten(urdf, text))
