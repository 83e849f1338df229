"""What every reader of points checks: reach, a person's size, zeros that mean missing, names that are there twice."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.infer.commands.app import run_command
from muybridge.infer.labelling.label import metres_of
from muybridge.motion.formats.points.common import METRES_OF_UNIT, check_unit
from muybridge.motion.formats.points.person import implausible_stature
from muybridge.motion.formats.points.unlabelled import read_marker_cloud
from muybridge.motion.formats.points.world import Trajectories, points_of_file, take_out_zeros, unique_names
from muybridge.motion.formats.registry import FORMATS, ReadOptions, read_file
from tests.motion.formats.standing import FPS, NAMES, walk, walk_mm
from tests.paths import DATA, case_file

# By the limbs of the person who walks.
TALL_M = 1.680527
SUFFIXES = (".c3d", ".trc", ".csv", ".npz", ".parquet")
# Left markers of a standing person, metres; the right ones mirror them.
_LEFT = {
    "SHO": (0.2, 0, 1.45), "ELB": (0.28, 0, 1.15), "WRA": (0.27, -0.1, 0.92), "WRB": (0.3, -0.05, 0.9),
    "ASI": (0.13, -0.1, 1.0), "PSI": (0.05, 0.1, 1.03), "KNE": (0.16, 0, 0.52), "ANK": (0.14, 0, 0.09),
    "HEE": (0.1, 0.06, 0.05), "TOE": (0.1, -0.15, 0.05),
}  # fmt: skip
LABELS = tuple(f"{side}{name}" for side in "LR" for name in _LEFT)
MARKERS_M = np.array([(x * sign, y, z) for sign in (1, -1) for x, y, z in _LEFT.values()])


def written(path: Path, names: tuple[str, ...] = NAMES, factor: float = 1e-3, **places: object) -> Path:
    """The walk as a file; `places` replaces samples: marker_frame=(x, y, z) metres."""
    if path.suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="pyarrow (the extra parquet) is not installed")
    points = walk(names, factor)
    for key, place in places.items():
        name, _, frame = key.rpartition("_")
        points.points_world[int(frame), NAMES.index(name)] = place
    write = FORMATS[path.suffix].write_points
    assert write is not None
    write(path, points)
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_sound_file_is_read_without_a_word(tmp_path: Path, suffix: str) -> None:
    take = read_file(written(tmp_path / f"a{suffix}"))
    assert take.notices == () and take.positions.landmarks.names == NAMES
    np.testing.assert_allclose(take.positions.points_world, walk().points_world, atol=1e-6)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_point_beyond_any_room_is_refused_with_its_name_and_frame(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path / f"a{suffix}", left_knee_2=(0.1, -7e5, 0.5))
    with pytest.raises(FormatError, match=r"'left_knee' is 7e\+05 m from the origin in frame 3 of 8; .* damaged"):
        read_file(path)
    if suffix in (".c3d", ".trc", ".csv"):
        with pytest.raises(FormatError, match="'left_knee' is 7e.05 m from the origin in frame 3"):
            read_marker_cloud(path)
    assert read_file(written(tmp_path / f"b{suffix}", left_knee_2=(0.1, -900, 0.5))).positions.points_world.any()


def sized(factor: float, unit: str, names: tuple[str, ...] = NAMES) -> Trajectories:
    """The walk by numbers that are so many times those in metres, said to be in a unit."""
    return Trajectories(names, walk_mm() * 1e-3 * factor, FPS, unit)


@pytest.mark.parametrize(("factor", "stated", "likely"), [
    (1000, "m", "mm"), (1000, "", "mm"), (100, "m", "cm"), (1, "mm", "m"), (1, "cm", "m"), (1000, "cm", "mm"),
    (100, "mm", "cm"), (39.37, "m", "in"), (1000, "in", "mm"),
])  # fmt: skip
def test_a_person_of_no_persons_size_is_refused_with_the_likely_unit(factor: float, stated: str, likely: str) -> None:
    tall = TALL_M * factor * METRES_OF_UNIT[stated or "m"]
    with pytest.raises(FormatError) as caught:
        points_of_file(Path("a.csv"), sized(factor, stated), "walk")
    assert f"the person would be {tall:,.4g} m tall" in str(caught.value)
    assert caught.value.remedy == "unit_of_points" and caught.value.details["unit"] == likely
    read = points_of_file(Path("a.csv"), sized(factor, stated), "walk", unit=likely)
    np.testing.assert_allclose(read.points.points_world, walk().points_world, rtol=1e-3)
    assert read.notices == ()


def test_a_unit_that_the_user_states_is_believed_and_the_size_said() -> None:
    read = points_of_file(Path("a.csv"), sized(100, ""), "walk", unit="m")
    assert "168.1 m tall; the file's numbers are likely centimetres" in read.notices[0]
    small = points_of_file(Path("a.csv"), sized(0.4, "m"), "walk")
    assert small.notices == ("the person would be 0.6722 m tall",), "an infant is no reason to refuse"


@pytest.mark.parametrize("factor", [0.001, 0.05, 1.0, 20.0])
@pytest.mark.parametrize("names", [
    tuple(f"wand_{k}" for k in range(15)), tuple(f"left_index_{k}" for k in range(15)),
    ("nose", "left_ear", *"abcdefghijklm"),
])  # fmt: skip
def test_what_has_no_names_of_a_body_may_have_any_size(factor: float, names: tuple[str, ...]) -> None:
    assert points_of_file(Path("a.csv"), sized(factor, "m", names), "walk").notices == ()


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_markers_on_the_skin_show_a_wrong_unit_too(unit: str) -> None:
    rng = np.random.default_rng(0)
    xyz = MARKERS_M + rng.normal(0, 1e-3, (4, *MARKERS_M.shape))
    others = {"m": 1000.0, "cm": 10.0} if unit == "m" else {"mm": 0.001, "cm": 0.01}
    assert implausible_stature(LABELS, xyz, others) is None
    found = implausible_stature(LABELS, xyz * (0.001 if unit == "m" else 1000.0), others)
    assert found is not None and found[1:] == (unit, True)


def test_points_far_from_everything_have_another_unit_if_all_are() -> None:
    names = tuple(f"wand_{k}" for k in range(15))
    with pytest.raises(FormatError, match="lie .* m from the origin") as caught:
        points_of_file(Path("a.csv"), sized(1000, "m", names), "walk")
    assert caught.value.details["unit"] == "mm"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_zeros_of_a_marker_that_is_elsewhere_are_gaps(tmp_path: Path, suffix: str) -> None:
    zeros = {f"{name}_{frame}": (0, 0, 0) for name, frame in (("left_hip", 0), ("left_hip", 3), ("right_knee", 7))}
    path = written(tmp_path / f"a{suffix}", **zeros)
    take = read_file(path)
    missing = np.isnan(take.positions.points_world).all(axis=-1)
    expected = np.isnan(walk().points_world).all(axis=-1)
    for name, frame in (("left_hip", 0), ("left_hip", 3), ("right_knee", 7)):
        expected[frame, NAMES.index(name)] = True
    assert np.array_equal(missing, expected)
    assert take.notices == ("3 positions of exactly 0, 0, 0 were taken as missing (left_hip, right_knee)",)
    if suffix in (".c3d", ".trc", ".csv"):
        assert np.array_equal(np.isnan(read_marker_cloud(path).points).all(axis=-1), expected)


def test_what_moves_through_the_origin_was_there() -> None:
    start = np.cumsum(np.full((6, 1, 3), 0.01), axis=0) - 0.01
    still = np.zeros((6, 1, 3))
    gap = np.concatenate([still[:2], still[:2] + 1.0, still[:2] + np.nan])
    for xyz, missing in ((start, 0), (still, 0), (gap, 4)):
        take_out_zeros(["hips"], xyz, 50.0)
        assert int(np.isnan(xyz[..., 0]).sum()) == missing
    assert take_out_zeros(["a", "b"], np.stack([still[:, 0], start[:, 0]], axis=1), 50.0) == [
        "in all frames at exactly 0, 0, 0: a"]  # fmt: skip


def test_zeros_in_all_frames_are_no_person_of_no_height() -> None:
    take = points_of_file(Path("a.trc"), Trajectories(NAMES, np.zeros((6, len(NAMES), 3)), 50.0, "mm"), "walk")
    assert [notice[:36] for notice in take.notices] == ["in all frames at exactly 0, 0, 0: no"]


def test_names_of_twins_are_made_unique() -> None:
    assert unique_names(["a", "b"]) == (("a", "b"), [])
    names, said = unique_names(["KNEE", "KNEE_2", "KNEE", "KNEE", "x"])
    assert names == ("KNEE", "KNEE_2", "KNEE_3", "KNEE_4", "x") and "KNEE_3 for the next KNEE" in said[0]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_twins_are_read_renamed_and_said(tmp_path: Path, suffix: str) -> None:
    take = read_file(written_with_twins(tmp_path / f"a{suffix}"))
    assert [n for n in take.positions.landmarks.names if "KNEE" in n] == ["KNEE", "KNEE_2"]
    assert any("KNEE_2 for the next KNEE" in n for n in take.notices)
    np.testing.assert_allclose(take.positions.points_world, walk().points_world, atol=1e-6)


def written_with_twins(path: Path) -> Path:
    """A file of names of equal length, of which two are then made one in the file."""
    names = tuple({"left_knee": "KNEE", "right_knee": "KNEX"}.get(n, n) for n in NAMES)
    written(path, names)
    if path.suffix == ".npz":
        np.savez(path, points_world=walk().points_world, names=np.array([n.replace("KNEX", "KNEE") for n in names]),
                 fps=np.array(FPS))  # fmt: skip
    elif path.suffix == ".parquet":
        import pyarrow.parquet as pq

        table = pq.read_table(path)
        pq.write_table(table.rename_columns([n.replace("KNEX", "KNEE") for n in table.column_names]), path)
    else:
        path.write_bytes(path.read_bytes().replace(b"KNEX", b"KNEE"))
    return path


@pytest.mark.parametrize(("word", "unit"), [
    ("mete", "m"), ("MM", "mm"), ("Metr", "m"), ("mill", "mm"), ("cent", "cm"), ("[mm]", "mm"), ("mm.", "mm"),
    ("inch", "in"),
])  # fmt: skip
def test_units_in_the_words_of_old_systems(word: str, unit: str) -> None:
    assert check_unit(Path("a"), word, "UNITS") == unit


@pytest.mark.parametrize("word", ["met", "meterstick", "furlong", "", "me"])
def test_other_words_are_no_units(word: str) -> None:
    with pytest.raises(FormatError, match="UNITS is .* valid are m, cm, mm, in"):
        check_unit(Path("a"), word, "UNITS")


@pytest.mark.parametrize("command", ["convert", "solve", "compare"])
def test_every_command_refuses_a_person_of_1700_metres(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str
) -> None:
    path = written(tmp_path / "a.csv", factor=1.0)
    rest = {"convert": [tmp_path / "o.c3d"], "solve": ["--out", tmp_path / "o"], "compare": [path]}
    assert run_command([command, str(path), *map(str, rest[command])]) == 2
    said = capfd.readouterr().err
    assert "1,681 m tall; the file's numbers are likely millimetres; give --units" in said and said.count("\n") == 1


def test_label_corrects_a_wrong_unit_and_says_so(tmp_path: Path) -> None:
    multiplied = "the file states no unit or a wrong one: its points were multiplied by 0.001"
    for factor, said in ((1.0, [multiplied]), (1e-3, [])):
        notes: list[str] = []
        metres_of(read_marker_cloud(written(tmp_path / "a.csv", factor=factor)).points, notes)
        assert notes == said


def test_the_cases_of_wrong_units_zeros_and_damage() -> None:
    for name, unit, fps in (("millimetres.csv", "mm", 50), ("wrong_unit.trc", "m", None)):
        with pytest.raises(FormatError, match="m tall; the file's numbers are likely") as caught:
            read_file(case_file(f"units_silent/{name}"), ReadOptions(fps=fps))
        assert caught.value.details["unit"] == unit
    with pytest.raises(FormatError, match="'left_eye' is .* m from the origin in frame 1 of 12"):
        read_file(case_file("c3d_shifted/100_silent_p.c3d"))


@pytest.mark.parametrize("name", ["tennis_serve_pig39.c3d", "tennis_serve_pig39_gaps.c3d", "walk_force_plates.c3d"])
def test_recordings_are_read_without_a_word(name: str) -> None:
    if not (DATA / "markers" / name).is_file():
        pytest.skip(f"../shared/data/markers/{name} is not here")
    assert read_file(DATA / "markers" / name).notices == ()
