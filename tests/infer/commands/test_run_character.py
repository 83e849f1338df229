"""The character of a run: its file in the results folder, and what the report shows of it."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError, OutputError
from muybridge.infer.commands.motion.run_character import CharacterOfRun, read_run_character
from muybridge.infer.results.names import MOST_PEOPLE, MOTION_BVH, of_person
from muybridge.infer.results.run import Run
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.character import read_character
from muybridge.motion.formats.registry import read_file
from tests.geometry.roles.bodies import four_legged, human
from tests.infer.commands.test_retarget import body_file


@pytest.fixture
def hero(tmp_path: Path) -> Path:
    return body_file(tmp_path / "hero.glb", human(np.random.default_rng(1), spine=4, legs=0.8), 1)


def started(folder: Path, character: CharacterOfRun, *takes: Path) -> Run:
    """A run that has written everyone's motion."""
    names = [of_person(MOTION_BVH, n) for n in range(1, MOST_PEOPLE + 1)]
    run = Run("videos", folder, (*names, *character.names), [character.path], False, Progress(quiet=True))
    for name, take in zip(names, takes, strict=False):
        motion = read_file(take).motion
        assert motion is not None
        run.write_motion([name], motion)
    return run


def test_the_results_get_the_character_and_the_report_its_clip(tmp_path: Path, hero: Path) -> None:
    take = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0)))
    character, results = read_run_character(hero), tmp_path / "results"
    for _ in range(2):  # the second run replaces what the first one wrote
        run = started(results, character, take)
        scenes = character.put_on(run)
        run.write("report.html", lambda path: path.write_text("later"))
        assert run.output.owns("hero.glb"), "also after further files were written"
    assert run.written == [MOTION_BVH, "hero.glb", "report.html"]
    assert list(scenes) == [1] and scenes[1].frames == 20 and scenes[1].packed["name"] == "hero.glb"
    assert read_character(results / "hero.glb").clips == ("motion", "person_1"), "its own, and one more"


@pytest.mark.parametrize("suffix", [".glb", ".bvh"])
def test_everyone_of_a_run_goes_onto_the_character(tmp_path: Path, suffix: str) -> None:
    hero = body_file(tmp_path / f"hero{suffix}", human(np.random.default_rng(1), spine=4, legs=0.8), 1)
    takes = [body_file(tmp_path / f"{n}.bvh", human(np.random.default_rng(0)), n, frames=10 + n) for n in (1, 2, 3)]
    character, results = read_run_character(hero), tmp_path / "results"
    started(results, character, *takes)
    run = started(results, character, *takes[:2])  # the folder still has the third
    scenes = character.put_on(run)
    assert {number: scene.frames for number, scene in scenes.items()} == {1: 11, 2: 12}
    files = ["hero.glb"] if suffix == ".glb" else ["hero_person_1.bvh", "hero_person_2.bvh"]
    assert run.written == ["motion.bvh", "motion_2.bvh", *files]
    if suffix == ".glb":
        assert read_character(results / "hero.glb").clips == ("motion", "person_1", "person_2")


def test_files_of_others_are_not_replaced(tmp_path: Path, hero: Path) -> None:
    take = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0)))
    results = tmp_path / "results"
    results.mkdir()
    (results / "hero.glb").write_text("mine")
    with pytest.raises(OutputError, match=r"hero\.glb"):
        started(results, read_run_character(hero), take)
    inside = results / "other.glb"
    inside.write_bytes(hero.read_bytes())
    with pytest.raises(OutputError, match="folder of the input"):
        started(results, read_run_character(inside), take)
    assert (results / "hero.glb").read_text() == "mine" and inside.read_bytes() == hero.read_bytes()


def test_characters_that_a_run_cannot_write_are_refused_before_it(tmp_path: Path, hero: Path) -> None:
    named = hero.with_name("motion.glb")
    named.write_bytes(hero.read_bytes())
    robot = tmp_path / "robot.urdf"
    robot.write_text("")
    dog = body_file(tmp_path / "dog.glb", four_legged(np.random.default_rng(0)))
    for path, message in ((named, "another result; rename it"), (robot, f"retarget SESSION --to {robot}"),
                          (dog, "four legs")):  # fmt: skip
        with pytest.raises(MuybridgeError, match=message):
            read_run_character(path)
