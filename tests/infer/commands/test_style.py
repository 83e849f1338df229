"""The command `style`, and what it learned in the step `reach` of `edit`."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.infer.commands.motion.edit import edit
from muybridge.infer.commands.motion.style import style
from muybridge.infer.commands.remedies import error_line
from muybridge.motion.formats.registry import read_file, write_file
from muybridge.motion.style import load_style
from muybridge.motion.take import Take
from tests.motion.style.styles import ROLES, take


def written(path, motion):
    write_file(path, Take(motion=motion))
    return path


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("takes")
    return written(folder / "one.bvh", take(60.0)), written(folder / "two.glb", take(60.0, seed=1, stature=1.9))


def refused(function, *args, **options):
    with pytest.raises(MuybridgeError) as raised:
        function(*args, **options)
    line = error_line(raised.value)
    assert "\n" not in line
    return line


def test_a_style_is_learned_from_a_folder_and_used_by_reach(tmp_path, takes, capsys):
    path, out, plain = tmp_path / "mine.style", tmp_path / "out.bvh", tmp_path / "plain.bvh"
    assert style((takes[0].parent,), out=path, mirror=True) == 0
    said = capsys.readouterr()
    assert "example poses of 2 takes" in said.out and "two.glb moves another body" in said.err
    assert load_style(path).takes == ("one.bvh", "two.glb")
    assert style(takes, out=path) == 0, "a style is replaced without being asked"
    clip = written(tmp_path / "clip.bvh", take(-20.0, seed=3))
    motion = read_file(clip).motion
    place = motion.joint_positions_world()[120, ROLES["right_hand"]] + [0.0, -0.04, 0.04]
    words = ("reach", "right_hand", "2.0", *(f"{v:.5f}" for v in place))
    assert edit((str(clip), *words, f"style={path}", str(out))) == 0
    assert edit((str(clip), *words, str(plain))) == 0
    assert "reach" in capsys.readouterr().out
    hand, other = ROLES["right_hand"], ROLES["left_hand"]
    styled, bare = (read_file(p).motion.joint_positions_world()[120] for p in (out, plain))
    assert np.linalg.norm(styled[hand] - place) < 2e-3 and np.linalg.norm(bare[hand] - place) < 2e-3
    assert np.linalg.norm(styled[other] - bare[other]) > 0.1


def test_bad_input_is_refused_in_one_line(tmp_path, takes):
    path, one = tmp_path / "a.style", written(tmp_path / "single.bvh", take(0.0, 1))
    assert "single.bvh: has one frame" in refused(style, (one,), out=path)
    assert ".style" in refused(style, takes, out=tmp_path / "a.npz")
    assert "no such file" in refused(style, (tmp_path / "none.bvh",), out=path)
    assert "--examples" in refused(style, takes, out=path, examples=3)
    assert "--components" in refused(style, takes, out=path, components=0)
    motion = take(0.0)
    chain = replace(motion.skeleton, names=tuple(f"j{k}" for k in range(len(motion.skeleton))),
                    parents=tuple(range(-1, len(motion.skeleton) - 1)))  # fmt: skip
    snake = written(tmp_path / "snake.bvh", replace(motion, skeleton=chain))
    assert "snake.bvh: no joint was found for" in refused(style, (snake,), out=path)
    line = refused(style, (takes[0], snake), out=path)
    assert "snake.bvh: no joint was found for" in line and "--take-map" in line
    assert not path.exists()
    (tmp_path / "text.style").write_text("no style")
    words = ("reach", "right_hand", "2.0", "0", "0", "1")
    clip, out = str(takes[0]), str(tmp_path / "out.bvh")
    line = refused(edit, (clip, *words, f"style={tmp_path / 'text.style'}", out))
    assert "text.style: is no style" in line and "muybridge style TAKES" in line
    assert "not made by muybridge" in refused(style, takes, out=tmp_path / "text.style")
    assert style((takes[0],), out=path) == 0
    line = refused(edit, (str(snake), *words, str(path), out))
    assert "a.style: the style is of another skeleton" in line and "muybridge style FILE" in line
    assert "no such file" in refused(edit, (clip, *words, f"style={tmp_path / 'lost.style'}", out)).lower()
