"""Tables as programs write them, and the dialects of tables and TRC files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.motion.formats.points.trc import read_trc
from muybridge.motion.formats.points.unlabelled import read_marker_cloud
from muybridge.motion.formats.registry import ReadOptions, read_file
from tests.motion.formats.standing import FPS, FRAMES, NAMES, walk_mm
from tests.paths import case_file

Y_UP = (1, 2, 0)


def numbers(place: FloatArray, empty: str = "") -> list[str]:
    return [c for p in place for c in ([f"{v:.3f}" for v in p] if np.isfinite(p).all() else [empty] * 3)]


def nexus(devices: bool = False) -> str:
    rows = [
        "Devices",
        "1000",
        ",,Force,,",
        "Frame,Sub Frame,Fx,Fy,Fz",
        ",,N,N,N",
        "1,0,0,0,1",
        "1,1,0,0,1",
        "",
    ] * devices
    rows += [
        "Trajectories",
        "50",
        ",," + ",".join(f"S:{n},," for n in NAMES),
        "Frame,Sub Frame" + ",X,Y,Z" * len(NAMES),
    ]
    rows += [",," + ",".join(["mm"] * 3 * len(NAMES))]
    rows += [",".join([str(t + 1), "0", *numbers(p)]) for t, p in enumerate(walk_mm())]
    return "\n".join(
        [*rows, "", "Model Outputs", "50", ",,S:Angle,,", "Frame,Sub Frame,X,Y,Z", ",,deg,deg,deg", "1,0,1,2,3"]
    )


def qualisys(titles: bool = True, columns: int = 2) -> str:
    head = {"NO_OF_FRAMES": FRAMES, "NO_OF_CAMERAS": 8, "NO_OF_MARKERS": len(NAMES), "FREQUENCY": 50, "NO_OF_ANALOG": 0,
            "ANALOG_FREQUENCY": 0, "DESCRIPTION": "--", "TIME_STAMP": "2024-01-01, 10:00:00\t1.5",
            "DATA_INCLUDED": "3D", "EVENT": "Start\t1\t0.0", "MARKER_NAMES": "\t".join(NAMES)}  # fmt: skip
    rows = [f"{key}\t{value}" for key, value in head.items()]
    if titles:
        rows += ["\t".join([*["Frame", "Time"][:columns], *(f"{n} {a}" for n in NAMES for a in "XYZ")])]
    for t, place in enumerate(walk_mm()):
        rows += ["\t".join([*[str(t + 1), "%.5f" % (t / 50)][:columns], *numbers(place, "0.000")])]
    return "\n".join(rows) + "\n"


def motive(kind: str = "Marker") -> str:
    bones = [["Bone", "S:Hip", "9", "Rotation"]] * 4 + [["Bone", "S:Hip", "9", "Position"]] * 3
    markers = [[kind, f"S:{n}", "7", "Position"] for n in NAMES for _ in range(3)]
    heads = [*bones, *markers, [kind, "S:nose", "7", "Mean Marker Error"]]
    rows = ["Format Version,1.23,Take Name,a,Capture Frame Rate,50.0,Export Frame Rate,50.0,Length Units,Millimeters,"
            "Coordinate Space,Global", ""]  # fmt: skip
    rows += [",".join(["", label, *(h[i] for h in heads)]) for i, label in enumerate(("Type", "Name", "ID", ""))]
    rows += [",".join(["Frame", "Time (Seconds)", *"XYZWXYZ", *("X", "Y", "Z") * len(NAMES), ""])]
    rows += [",".join([str(t), "%.6f" % (t / 50), *"0001", *"123", *numbers(p[:, Y_UP]), "0.1"])
             for t, p in enumerate(walk_mm())]  # fmt: skip
    return "\n".join(rows) + "\n"


def deeplabcut(individuals: bool = False) -> str:
    parts = [n for n in NAMES for _ in range(3)]
    rows = [",".join(["scorer", *["DLC_3D"] * len(parts)])]
    rows += [",".join(["individuals", *["mouse"] * len(parts)])] * individuals
    rows += [",".join(["bodyparts", *parts]), ",".join(["coords", *("x", "y", "z") * len(NAMES)])]
    return "\n".join(rows + [",".join([str(t), *numbers(p)]) for t, p in enumerate(walk_mm())]) + "\n"


def anipose() -> str:
    names = [c for n in NAMES for c in (f"{n}_x", f"{n}_y", f"{n}_z", f"{n}_error", f"{n}_ncams", f"{n}_score")]
    rows = [",".join([*names, "M_00", "center_0", "fnum"])]
    for t, place in enumerate(walk_mm()):
        cells = numbers(place)
        spread = [c for k in range(len(NAMES)) for c in (*cells[3 * k : 3 * k + 3], "0.4", "3", "0.9")]
        rows.append(",".join([*spread, "1.0", "0.0", str(t)]))
    return "\n".join(rows) + "\n"


TABLES: dict[str, tuple[str, Callable[[], str]]] = {
    "nexus": ("a.csv", nexus), "nexus_devices": ("a.csv", lambda: nexus(True)), "qualisys": ("a.tsv", qualisys),
    "qualisys_bare": ("a.txt", lambda: qualisys(False)), "qualisys_points": ("a.tsv", lambda: qualisys(False, 0)),
    "qualisys_titles": ("a.tsv", lambda: qualisys(True, 1)), "motive": ("a.csv", motive),
    "motive_bones": ("a.csv", lambda: motive("Bone Marker")), "deeplabcut": ("a.csv", deeplabcut),
    "deeplabcut_individuals": ("a.csv", lambda: deeplabcut(True)), "anipose": ("a.csv", anipose),
}  # fmt: skip


def dialects(text: str, rng: np.random.Generator) -> bytes:
    """The same table by another program's or country's habits."""
    if rng.random() < 0.5:
        separator = "\t" if "\t" in text else ","
        text = "\n".join(line + separator * (separator in line) for line in text.split("\n"))
    if rng.random() < 0.5:
        text = text.replace("\n", "\r\n")
    if rng.random() < 0.3:
        text += "\n\n"
    return text.encode(str(rng.choice(["utf-8", "utf-8-sig", "utf-16"])))


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_programs_are_read_as_they_are(tmp_path: Path, name: str) -> None:
    file, text = TABLES[name]
    fps = FPS if name.startswith(("deeplabcut", "anipose")) else None
    rng = np.random.default_rng(3)
    for content in (text().encode(), *(dialects(text(), rng) for _ in range(8))):
        (tmp_path / file).write_bytes(content)
        take = read_file(tmp_path / file, ReadOptions(fps=fps))
        assert take.fps == FPS and [n.split(":")[-1] for n in take.positions.landmarks.names] == list(NAMES)
        np.testing.assert_allclose(take.positions.points_world, walk_mm() * 1e-3, atol=1e-6)
        cloud = read_marker_cloud(tmp_path / file, fps)
        assert cloud.fps == FPS and np.nanmax(np.abs(cloud.points)) == pytest.approx(1.58)
        assert ("millimetres were assumed" in "".join(take.notices)) == (fps is not None)


def test_european_tables_have_semicolons_and_commas(tmp_path: Path) -> None:
    text = nexus().replace(",", ";").replace(".", ",")
    (tmp_path / "a.csv").write_text(text)
    np.testing.assert_allclose(read_file(tmp_path / "a.csv").positions.points_world, walk_mm() * 1e-3, atol=1e-6)
    (tmp_path / "b.csv").write_text("sep=;\ntime;a_x;a_y;a_z\n0;1,5;2;3\n0,5;4;5;6\n")
    read = read_file(tmp_path / "b.csv").positions
    assert read.fps == 2 and read.points_world[0, 0, 0] == 1.5


@pytest.mark.parametrize(("text", "says"), [
    (qualisys().replace("\t3D", "\t6D"), "export of Qualisys with 6D data; export 3D"),
    (qualisys().replace("MARKER_NAMES", "NO_NAMES"), "Qualisys that names no markers"),
    (motive().replace("Global", "Local"), "export of Motive in Local coordinates"),
    (motive().replace("Position", "Rotation"), "export of Motive without positions"),
    (deeplabcut().replace("z", "likelihood"), "DeepLabCut of one camera"),
    ("Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n1,0,2\n", "Vicon Nexus without trajectories"),
    ("Trajectories\n50\n", "begins like Vicon's export"),
])  # fmt: skip
def test_what_is_no_table_of_points_names_the_program(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    for read in (lambda p: read_file(p, ReadOptions(fps=FPS)), lambda p: read_marker_cloud(p, FPS)):
        with pytest.raises(FormatError, match=says) as caught:
            read(tmp_path / "a.csv")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("rate", ["0", "-50", "inf", "1e999"])
def test_a_table_with_an_impossible_frame_rate_is_refused(tmp_path: Path, rate: str) -> None:
    lines = nexus().split("\n")
    lines[1] = rate
    (tmp_path / "a.csv").write_text("\n".join(lines))
    with pytest.raises(FormatError, match=r"a\.csv: .*(frames per second|damaged)"):
        read_file(tmp_path / "a.csv")


@pytest.mark.parametrize("name", TABLES)
def test_damaged_tables_are_refused_in_one_line_or_sound(tmp_path: Path, name: str) -> None:
    text, rng = TABLES[name][1](), np.random.default_rng(11)
    for _ in range(25):
        damaged = bytearray(text.encode())
        for at in rng.integers(0, min(len(damaged), 2500), rng.integers(1, 6)):
            damaged[at] = rng.choice(list(b',\n\t;0X- "\x00\xff'))
        (tmp_path / "a.csv").write_bytes(damaged[: rng.integers(1, len(damaged))])
        for read in (lambda p: read_file(p, ReadOptions(fps=FPS)).positions.points_world,
                     lambda p: read_marker_cloud(p, FPS).points):  # fmt: skip
            try:
                assert read(tmp_path / "a.csv").ndim == 3
            except FormatError as error:
                assert "a.csv" in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("name", ["motive.csv", "qtm.tsv", "nexus.csv", "nexus_devices.csv", "dlc3d.csv"])
def test_the_cases_of_tables(name: str) -> None:
    path, fps = case_file(f"vendor_tables/{name}"), 50.0 if name == "dlc3d.csv" else None
    take = read_file(path, ReadOptions(fps=fps))
    xyz = take.positions.points_world
    assert xyz.shape == (40, 15, 3) and take.fps == 50 and np.nanmax(xyz[..., 2]) == pytest.approx(1.58)
    missing = [] if fps else [5, 6, 7, 8]
    assert np.nonzero(np.isnan(xyz[:, 3, 0]))[0].tolist() == missing and np.isnan(xyz[..., 0]).sum() == len(missing)
    assert np.nanmax(np.abs(read_marker_cloud(path, fps).points)) == pytest.approx(np.nanmax(np.abs(xyz)))


# TRC


def trc(extra: tuple[str, ...] = (), markers: int = len(NAMES), gap: bool = False) -> str:
    lines = ["PathFileType\t4\t(X/Y/Z)\ta.trc",
             "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
             f"50\t50\t{FRAMES}\t{markers}\tmm\t50\t1\t{FRAMES}", "Frame#\tTime\t" + "\t\t\t".join(NAMES) + "\t\t",
             "\t\t" + "\t".join(f"{a}{k + 1}" for k in range(len(NAMES)) for a in "XYZ"), ""]  # fmt: skip
    for t, place in enumerate(walk_mm(gap)[..., Y_UP]):
        lines.append("\t".join([str(t + 1), "%.3f" % (t / 50), *numbers(place), *(extra if t % 3 else ())]))
    return "\n".join(lines) + "\n"


def spaced(line: str) -> str:
    return " ".join(line.split("\t")).rstrip()


SPACED = {
    "all": lambda lines: [" ".join(line.split()) for line in lines],
    "rows": lambda lines: lines[:6] + [spaced(line) for line in lines[6:]],
    "one": lambda lines: [*lines[:9], spaced(lines[9]), *lines[10:]],
    "aligned": lambda lines: lines[:6] + ["  " + spaced(line).replace(" ", "   ") for line in lines[6:]],
    "values": lambda lines: [*lines[:2], lines[2].replace("\t", "\t\t "), *lines[3:]],
    "commas": lambda lines: lines[:6] + [line.replace(".", ",") for line in lines[6:]],
}


@pytest.mark.parametrize("name", SPACED)
def test_spaces_and_empty_cells_in_a_trc(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.trc").write_text("\n".join(SPACED[name](trc().split("\n"))))
    take = read_file(tmp_path / "a.trc")
    assert take.positions.landmarks.names == NAMES
    np.testing.assert_allclose(take.positions.points_world, walk_mm(False) * 1e-3, atol=1e-6)
    assert bool(take.notices) == (name in ("all", "rows", "one", "aligned"))


def test_spaces_that_hide_empty_cells_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text("\n".join(SPACED["rows"](trc(gap=True).split("\n"))))
    with pytest.raises(FormatError, match="line 11 has spaces between its numbers.* separate them by tabs"):
        read_trc(tmp_path / "a.trc")


@pytest.mark.parametrize(("extra", "markers", "said"), [
    (("1.0", "2.0", "3.0"), 15, 1), (("1", "2", "3", "", "", "", "4", "5", "6"), 15, 1), (("1", "2", "3"), 16, 2),
])  # fmt: skip
def test_trajectories_without_a_name_are_left_out_and_said(tmp_path: Path, extra, markers: int, said: int) -> None:
    (tmp_path / "a.trc").write_text(trc(extra, markers))
    take = read_file(tmp_path / "a.trc")
    assert take.positions.landmarks.names == NAMES and len(take.notices) == said
    assert f"{len(extra) // 3} trajector" in take.notices[0]
    np.testing.assert_allclose(take.positions.points_world, walk_mm(False) * 1e-3, atol=1e-6)


def test_a_trajectory_without_a_name_in_the_middle_moves_no_name(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(trc().replace("left_elbow", ""))
    take = read_file(tmp_path / "a.trc")
    assert take.positions.landmarks.names == tuple(n for n in NAMES if n != "left_elbow")
    np.testing.assert_allclose(take.positions.points_world, np.delete(walk_mm(False), 3, axis=1) * 1e-3, atol=1e-6)
    said = "1 trajectory without a name was left out, between the markers of line 4"
    assert said in take.notices


def test_one_frame_less_than_a_trc_states_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(trc().replace(f"\t{FRAMES}\t15", f"\t{FRAMES + 1}\t15"))
    assert "states 9 frames, 8 rows follow" in read_file(tmp_path / "a.trc").notices[0]


@pytest.mark.parametrize("name", [
    "cortex_trc/nummarkers.trc", "cortex_trc/unnamed_extra.trc", "trc_spaces/all_spaces.trc", "trc_spaces/one_row.trc",
    "trc_spaces/rows_spaces.trc",
])  # fmt: skip
def test_the_cases_of_trc(name: str) -> None:
    take = read_file(case_file(name))
    assert np.isfinite(take.positions.points_world).all() and take.positions.points_world.shape == (40, 15, 3)
    cortex = "1 trajectory without a name was left out, behind the markers of line 4"
    said = cortex if name.startswith("cortex") else "spaces, not tabs, are between the numbers of "
    assert any(said in notice for notice in take.notices)


def test_the_case_of_empty_cells_between_values() -> None:
    take = read_file(case_file("trc_double_tabs/static_walk_2.trc"))
    assert take.positions.points_world.shape == (153, 41, 3) and take.fps == 100 and not take.notices
