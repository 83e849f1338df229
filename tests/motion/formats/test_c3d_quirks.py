"""C3D files that contradict themselves or the format: what is there is kept, and what is not is said."""

import struct
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.motion.formats.points.c3d import Analog, C3DTake, Event, read_c3d_take, write_c3d
from muybridge.motion.formats.points.c3d_read import read_raw_c3d
from muybridge.motion.formats.registry import ReadOptions, read_file, write_file
from tests.motion.formats.standing import FRAMES, walk, walk_mm
from tests.paths import case_file


def parameter(group: int, name: bytes, kind: int, shape: tuple[int, ...], data: bytes, to: int | None = None) -> bytes:
    """One record; `to` replaces the distance to the next."""
    content = struct.pack("bB", kind, len(shape)) + bytes(shape) + data + b"\0"
    return struct.pack("bb", len(name), group) + name + struct.pack("<h", to or 2 + len(content)) + content


def c3d(path: Path, header: tuple[int, int] = (1, FRAMES), frames: int = FRAMES, last: int | None = None,
        unit: bytes = b"mm", screen: bytes = b"+Z", analog: bytes = b"", events: bytes = b"") -> Path:  # fmt: skip
    """The walk as an Intel C3D of integers with two analog channels a frame."""
    count = 15
    section = b"\0\0\0\x54" + struct.pack("bb", 5, -1) + b"POINT" + struct.pack("<h", 3) + b"\0"
    section += parameter(1, b"USED", 2, (), struct.pack("<h", count)) + parameter(
        1, b"RATE", 4, (), struct.pack("<f", 50)
    )
    section += parameter(1, b"UNITS", -1, (len(unit),), unit) + parameter(1, b"Y_SCREEN", -1, (2,), screen)
    section += struct.pack("bb", 6, -2) + b"ANALOG" + struct.pack("<h", 3) + b"\0" + analog
    section += struct.pack("bb", 5, -3) + b"EVENT" + struct.pack("<h", 3) + b"\0" + events
    section += parameter(1, b"FRAMES", 2, (), struct.pack("<h", frames), last)
    if last is None:
        section += bytes(2)
    blocks = -(-len(section) // 512)
    head = bytearray(512)
    struct.pack_into("<10H", head, 0, 0x5002, count, 2, header[0], header[1], 10, 0, 0, 2 + blocks, 1)
    struct.pack_into("<f", head, 12, 1.0)
    struct.pack_into("<f", head, 20, 50.0)
    data = b""
    for place in walk_mm(False):
        data += np.concatenate([np.round(place), np.zeros((15, 1))], axis=1).astype("<i2").tobytes()
        data += np.array([32532, 32767], "<u2").tobytes()
    path.write_bytes(bytes(head) + section.ljust(512 * blocks, b"\0") + data.ljust(-(-len(data) // 512) * 512, b"\0"))
    return path


def channels(offsets: tuple[int, int], form: bytes = b"UNSIGNED", kind: int = 2) -> bytes:
    packed = struct.pack("<2h" if kind == 2 else "<2f", *offsets)
    return (
        parameter(2, b"OFFSET", kind, (2,), packed) + parameter(2, b"SCALE", 4, (2,), struct.pack("<2f", 0.5, 0.5))
        + parameter(2, b"FORMAT", -1, (len(form),), form)
    )  # fmt: skip


def check(path: Path, *said: str) -> None:
    take = read_file(path)
    np.testing.assert_allclose(take.positions.points_world, np.round(walk_mm(False)) * 1e-3, atol=1e-6)
    assert len(take.notices) == len(said), take.notices
    assert all(text in notice for text, notice in zip(said, take.notices, strict=True))


def test_a_sound_file(tmp_path: Path) -> None:
    check(c3d(tmp_path / "a.c3d"))


@pytest.mark.parametrize(("offsets", "form", "values"), [
    ((-32752, 32767), b"UNSIGNED", (-126.0, 0.0)), ((-32768, -1), b"UNSIGNED", (-118.0, -16384.0)),
    ((100, 0), b"SIGNED", (16216.0, 16383.5)), ((-100, 0), b"SIGNED", (16316.0, 16383.5)),
])  # fmt: skip
def test_offsets_of_unsigned_channels_are_unsigned(tmp_path: Path, offsets, form, values) -> None:
    analog = read_c3d_take(c3d(tmp_path / "a.c3d", analog=channels(offsets, form))).analog
    assert analog is not None
    np.testing.assert_allclose(analog.values[0], values)


def test_frames_that_are_numbered_from_zero(tmp_path: Path) -> None:
    path = c3d(tmp_path / "a.c3d", (0, FRAMES - 1))
    check(path, "numbered from 0")
    take = read_file(path)
    write_file(tmp_path / "b.c3d", take)
    assert take.start == 0 and read_raw_c3d(tmp_path / "b.c3d").first_frame == 1
    assert len(read_file(tmp_path / "b.c3d").positions.points_world) == FRAMES


@pytest.mark.parametrize(("last", "frames"), [(7, 8), (8, 7), (8, 9), (9, 8)])
def test_counts_of_frames_that_differ_are_settled_by_the_data(tmp_path: Path, last: int, frames: int) -> None:
    check(
        c3d(tmp_path / "a.c3d", (1, last), frames), f"its header has {last} frames, POINT:FRAMES {frames}: 8 were read"
    )


def test_counts_of_frames_that_are_not_there_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="header has 90 frames, POINT:FRAMES 80, and the file ends before"):
        read_file(c3d(tmp_path / "a.c3d", (1, 90), 80))


@pytest.mark.parametrize("to", [3000, 32767])
def test_a_last_parameter_that_leads_beyond_the_section_is_the_last(tmp_path: Path, to: int) -> None:
    check(c3d(tmp_path / "a.c3d", last=to))


@pytest.mark.parametrize("unit", [b"mill", b"MM", b"Millimeters"])
def test_words_for_units(tmp_path: Path, unit: bytes) -> None:
    check(c3d(tmp_path / "a.c3d", unit=unit))


def test_a_screen_whose_axis_points_down(tmp_path: Path) -> None:
    check(c3d(tmp_path / "a.c3d", screen=b"-Z"), "Y_SCREEN is -Z, X_SCREEN not stated: Z was taken")
    with pytest.raises(FormatError, match=r"Y_SCREEN is '\+X'.*pass `up`"):
        read_file(c3d(tmp_path / "a.c3d", screen=b"+X"))
    assert read_file(tmp_path / "a.c3d", ReadOptions(up="z")).positions.points_world.any()


def test_events_without_times(tmp_path: Path) -> None:
    labels = parameter(3, b"LABELS", -1, (6, 3), b"StrikeOff   Strike")
    times = parameter(3, b"TIMES", 4, (2, 2), struct.pack("<4f", 0, 0.1, 0, 0.3))
    path = c3d(tmp_path / "a.c3d", events=parameter(3, b"USED", 2, (), struct.pack("<h", 3)) + labels + times)
    check(path, "EVENT:USED is 3, and 2 events have times")
    events = read_c3d_take(path).events
    assert [e.label for e in events] == ["Strike", "Off"] and events[1].time == pytest.approx(0.3)
    one = parameter(3, b"USED", 2, (), struct.pack("<h", 1)) + labels
    one += parameter(3, b"TIMES", 4, (2,), struct.pack("<2f", 0, 0.2))
    assert [e.time for e in read_c3d_take(c3d(tmp_path / "b.c3d", events=one)).events] == pytest.approx([0.2])


def test_what_was_said_is_not_lost_on_the_way_to_c3d(tmp_path: Path) -> None:
    analog = Analog(("Fz",), ("N",), 50.0, np.arange(float(FRAMES))[:, None])
    write_c3d(tmp_path / "a.c3d", C3DTake(walk(), 3, (Event("Foot Strike", 0.1),), analog))
    take = read_file(tmp_path / "a.c3d")
    assert take.notices == () and take.c3d is not None and take.c3d.first_frame == 3


def test_the_cases_of_c3d() -> None:
    shd = read_c3d_take(case_file("c3d_unsigned_offset/shd01.c3d")).analog
    assert shd is not None and shd.values[0, 0] == pytest.approx(-11.35, abs=0.005)
    for name, notices in (("plain", 0), ("pointer", 0), ("header39", 1)):
        take = read_file(case_file(f"c3d_old_quirks/{name}.c3d"))
        assert take.positions.points_world.shape == (40, 15, 3) and len(take.notices) == notices
    first = read_file(case_file("c3d_first_frame_0/read_NOTworking2.c3d"))
    assert first.positions.points_world.shape == (670, 23, 3) and first.start == 0
    names = read_file(case_file("c3d_duplicate_names/duplicate.c3d")).positions.landmarks.names
    assert len(names) == 15 and {"KNEE", "KNEE_2"} < set(names)
    assert "RKNE_2" in read_file(case_file("c3d_duplicate_labels/type-2a.c3d")).positions.landmarks.names
    up = read_file(case_file("c3d_y_screen_minus_z/CB_Static0001.c3d"))
    assert np.nanmax(up.positions.points_world[..., 2]) > 1 and "Z was taken" in up.notices[0]


def test_unsigned_channels_agree_with_ezc3d() -> None:
    ezc3d = pytest.importorskip("ezc3d")
    path = case_file("c3d_unsigned_offset/parameterOverflow.c3d")
    ours, other = read_c3d_take(path).analog, ezc3d.c3d(str(path))["data"]["analogs"][0].T
    assert ours is not None
    np.testing.assert_allclose(ours.values, other)
