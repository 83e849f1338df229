"""The motion of a run put onto a character as well: its file goes into the results folder, and reports show it."""

from dataclasses import dataclass
from pathlib import Path

from muybridge.errors import MuybridgeError
from muybridge.infer.pipelines.characters.pages import fits_page
from muybridge.infer.pipelines.characters.retarget import Target, output_paths, read_run_target, retarget_results
from muybridge.infer.pipelines.characters.takes import person_clip_names
from muybridge.infer.results.names import MOST_PEOPLE, MOTION_BVH, PERSONAL, of_person
from muybridge.infer.results.run import Run
from muybridge.infer.viewer import Scene, read_scene
from muybridge.motion.formats.registry import ReadOptions, can_use
from muybridge.motion.robots.read import is_robot


@dataclass(frozen=True)
class CharacterOfRun:
    """A character that a run's motion is put onto.

    Attributes:
        target: the character, and the roles of its joints.
    """

    target: Target

    @property
    def path(self) -> Path:
        """Its file."""
        return self.target.character.path

    @property
    def names(self) -> tuple[str, ...]:
        """Every file that may be written into the results folder."""
        clips = person_clip_names(range(1, MOST_PEOPLE + 1), self.target.clips)
        own = Path(self.path.name)
        return tuple(dict.fromkeys(
            str(path) for count in range(1, len(clips) + 1) for path in output_paths(own, self.path, clips[:count])
        ))  # fmt: skip

    def put_on(self, run: Run) -> dict[int, Scene]:
        """Write the character with the motion of everyone in the results folder.

        Args:
            run: which wrote the motion.

        Returns:
            What the report of each person shows, by number; not of characters that are too large for a page.

        Raises:
            MuybridgeError: the motion cannot be put onto the character.
        """
        folder = run.output.path
        # Not all that lies there: a run before this one may have written further people.
        people = [n for n in range(1, MOST_PEOPLE + 1) if of_person(MOTION_BVH, n) in run.written]
        for notice in retarget_results(folder, self.target, people=people):
            run.progress.notice(notice)
        clips = person_clip_names(people, self.target.clips)
        paths = output_paths(Path(self.path.name), self.path, clips)
        run.written.extend(str(path) for path in paths)
        scenes = {}
        for k, (number, clip) in enumerate(zip(people, clips, strict=True)):
            path = paths[0] if len(paths) == 1 else paths[k]
            scene = read_scene(folder / path, ReadOptions(clip=clip if can_use(path, "clip") else None))
            if fits_page(scene):
                scenes[number] = scene
            else:
                run.progress.notice(f"{path} is too large to be shown in the report; `muybridge view` shows it")
        return scenes


def read_run_character(path: Path) -> CharacterOfRun:
    """The character of a file, read before any other work.

    Raises:
        MuybridgeError: it cannot be written into a results folder as one file, has the name of another result, is a
            robot, or has no human body.
    """
    if is_robot(path):
        raise MuybridgeError(
            f"{path}: is a robot, whose motion is made from the results: `muybridge run SESSION`, then `muybridge "
            f"retarget SESSION --to {path}`"
        )
    character = CharacterOfRun(read_run_target(path))
    results = {of_person(name, n) for name in PERSONAL for n in range(1, MOST_PEOPLE + 1)}
    taken = sorted(results & set(character.names))
    if taken:
        raise MuybridgeError(f"{path}: would be written as {taken[0]}, which is another result; rename it")
    return character
