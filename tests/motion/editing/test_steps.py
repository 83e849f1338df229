"""The table of steps: words to steps, and steps on takes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.motion.editing import STEPS, Step, edit_take, parse_steps, reduce_keys
from muybridge.motion.editing.arguments import Frames
from muybridge.motion.formats import write_file
from muybridge.motion.formats.points.c3d import C3DTake, Event
from muybridge.motion.take import Take
from tests.motion.editing.clips import CLIPS, FPS, points, walk

# Each step with arguments that can be done with the walk.
EXAMPLES = {
    "trim": "0.5 1.5", "resample": "30", "mirror": "", "loop": "0.5 1.6", "in-place": "", "root-motion": "",
    "turn": "90", "move": "1 0 5cm", "floor": "", "plant": "", "smooth": "6", "reduce": "2", "rename": "mixamo",
    "scale": "120%", "bands": "1 1 1.5 0.5 keep",
    "timewarp": "0.5=0.8 1=1.2", "warp": "{keys} 0.5", "reach": "left_hand 0.5 {place}",
}  # fmt: skip


def _example(step: Step, folder: Path, motion: Motion) -> list[str]:
    """The step's words, with the file of a pose and a place that a hand can reach."""
    words = EXAMPLES[step.name]
    if "{keys}" in words:
        write_file(folder / "pose.glb", Take(motion=motion.select([10])))
    place = motion.joint_positions_world()[round(0.5 * FPS), motion.skeleton.index("left_hand")] + [0.0, -0.1, 0.05]
    shown = " ".join(f"{v:.3f}" for v in place)
    return [step.name, *words.format(keys=folder / "pose.glb", place=shown).split()]


def _values(text: str) -> list[tuple[str, dict[str, object]]]:
    return [(call.step.name, call.values) for call in parse_steps(text.split())]


def test_words_become_steps() -> None:
    found = _values("trim 0.5 3.2 in-place loop travel=keep turn -90 origin move 1 -.5 2cm move start=origin")
    assert [name for name, _ in found] == ["trim", "in-place", "loop", "turn", "move", "move"]
    assert found[0][1] == {"start": 0.5, "end": 3.2}
    assert found[1][1] == {"smoothing": 0.3, "turning": "keep"}
    assert found[2][1] == {"shortest": None, "longest": None, "travel": "keep"}
    assert found[3][1] == {"angle": pytest.approx(-np.pi / 2), "about": "origin"}
    assert found[4][1] == {"x": 1.0, "y": -0.5, "z": pytest.approx(0.02), "start": "here"}
    assert found[5][1]["start"] == "origin"


def test_units_follow_numbers() -> None:
    found = _values("trim 12f 1500ms reduce 2 reduce 1cm 0.01rad smooth 6Hz resample 30fps scale 50% in-place remove")
    assert found[0][1] == {"start": Frames(12.0), "end": 1.5}
    assert found[1][1] == {"tolerance": pytest.approx(2e-3), "angle": pytest.approx(np.radians(0.5))}
    assert found[2][1] == {"tolerance": pytest.approx(1e-2), "angle": 0.01}
    assert (found[3][1]["cutoff"], found[4][1]["fps"], found[5][1]["factor"]) == (6.0, 30.0, 0.5)
    assert found[6][1] == {"smoothing": 0.3, "turning": "remove"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no step to do; the steps are trim"),
        ("trimm 0 1", "did you mean 'trim'"),
        ("in_place", "did you mean 'in-place'"),
        ("trim", r"step 1, trim: start is missing: it takes START \[END\]"),
        ("trim 0 1 2", "'2' is one argument too many"),
        ("mirror trim 0 x", "step 2, trim: end is a number in seconds"),
        ("trim 0 1 mirorr", "if a step was meant, it is 'mirror'"),
        ("trim 0 5deg", "end is a number in seconds"),
        ("scale 2m", "factor is a number"),
        ("move 1e999", "too large"),
        ("rename mixmo", "did you mean 'mixamo'"),
        ("turn 90 about=start about=start", "given twice"),
        ("loop keep keep", "not 'keep'|too many"),
        ("turn 90 abuot=start", "did you mean 'about'"),
        ("smooth gausian", "did you mean 'gaussian'"),
        ("resample nan", "not 'nan'"),
        ("mirror z", "plane is start, x or y"),
    ],
)
def test_words_that_are_no_steps(text: str, words: str) -> None:
    with pytest.raises(MuybridgeError, match=words) as caught:
        parse_steps(text.split())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("step", STEPS.values(), ids=list(STEPS))
@pytest.mark.parametrize("clip", CLIPS)
def test_every_step_on_every_skeleton(step: Step, clip: str, tmp_path: Path) -> None:
    motion = CLIPS[clip]().select(slice(0, 100))
    take, notes = edit_take(Take(motion=motion), parse_steps(_example(step, tmp_path, motion)))
    assert take.motion is not None and take.motion is not motion
    assert np.isfinite(take.motion.joint_positions_world()).all()
    assert len(notes) == 1 and notes[0].startswith(f"step 1, {step.name}") and "\n" not in notes[0]


@pytest.mark.parametrize("step", STEPS.values(), ids=list(STEPS))
def test_every_step_on_points(step: Step, tmp_path: Path) -> None:
    take = Take(points=points(140))
    calls = parse_steps(_example(step, tmp_path, walk(40)))
    if step.points:
        edited, _ = edit_take(take, calls)
        assert edited.points is not None and np.isfinite(edited.points.points_world).any()
    else:
        with pytest.raises(MuybridgeError, match=f"step 1, {step.name}.*needs a motion, not points"):
            edit_take(take, calls)


def test_every_step_and_parameter_is_explained() -> None:
    for step in STEPS.values():
        assert step.text and step.usage.startswith(step.name)
        for parameter in step.parameters:
            assert parameter.text, (step.name, parameter.name)
            assert parameter.required == (
                f"[{parameter.name.upper()}]" not in step.usage and "[" not in parameter.label
            )


def test_steps_follow_each_other() -> None:
    take, notes = edit_take(Take(motion=walk()), parse_steps("trim 12f 132f resample 30 scale 2".split()))
    assert take.motion is not None and take.motion.fps == 30.0 and len(take.motion) == 60
    assert take.start == pytest.approx(12 / FPS)
    assert "120" in notes[0] and "60 to 30 frames/s, 120 to 60 frames" in notes[1]


def test_keys_are_of_the_last_step_alone() -> None:
    reduced, _ = edit_take(Take(motion=walk()), parse_steps(["reduce"]))
    assert reduced.keys is not None and reduced.keys.count == reduce_keys(walk()).keys.count
    again, _ = edit_take(reduced, parse_steps(["mirror"]))
    assert again.keys is None


def test_what_else_a_c3d_holds_is_left_out() -> None:
    cloud = points()
    take = Take(points=cloud, c3d=C3DTake(cloud, events=(Event("Foot Strike", 0.2),)))
    edited, notes = edit_take(take, parse_steps(["trim", "0.2"]))
    assert edited.c3d is None and "events" in notes[0]


def test_errors_name_the_step() -> None:
    with pytest.raises(MuybridgeError, match=r"^step 2, trim 0 9: the clip ends at 3.3"):
        edit_take(Take(motion=walk()), parse_steps("mirror trim 0 9".split()))


def test_what_cannot_be_edited_is_refused() -> None:
    motion = walk(20)
    bad = motion.root_positions_world.copy()
    bad[7, 1] = np.nan
    for take, words in (
        (Take(motion=motion.select(slice(0, 0))), "empty"),
        (Take(motion=replace(motion, root_positions_world=bad)), "NaN.* frame 8"),
        (Take(motion=replace(motion, fps=0.0)), "frame rate of 0"),
        (Take(points=replace(points(), points_world=points().points_world * np.nan)), "every point"),
    ):
        with pytest.raises(MuybridgeError, match=words):
            edit_take(take, parse_steps(["mirror"]))


def test_profiles_of_the_table_are_all_there() -> None:
    assert STEPS["rename"].parameters[0].choices == tuple(PROFILES)
