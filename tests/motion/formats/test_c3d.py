"""C3D beyond points: events, analog channels, first frame, byte orders; our reader beside ezc3d's."""

import struct

import ezc3d
import numpy as np
import pytest

from muybridge.errors import FormatError, OutputError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.motion.formats.points.c3d import Analog, C3DTake, Event, read_c3d, read_c3d_take, write_c3d
from muybridge.motion.formats.points.c3d_read import _Reader, read_raw_c3d
from tests.paths import SHARED

MARKERS = SHARED / "data" / "markers"


def make_points(frames: int = 5, names: tuple[str, ...] = ("LASI", "RASI", "SACR"), seed: int = 0) -> Points3D:
    rng = np.random.default_rng(seed)
    xyz = rng.normal(0, 1, (frames, len(names), 3))
    xyz[1:3, 1] = np.nan
    covariance = np.full((*xyz.shape, 3), np.nan)
    covariance[:, 0] = np.eye(3) * 0.005**2
    none = (0, *xyz.shape[:2])
    return Points3D(LandmarkSet("c3d", names, ()), xyz, covariance, np.empty(none), np.empty(none, bool), 100.0)


def make_take() -> C3DTake:
    analog = Analog(("Fz1", "EMG"), ("N", "V"), 1000.0, np.random.default_rng(1).normal(0, 300, (50, 2)))
    events = (Event("Foot Strike", 0.42, "Right", "subject", "heel"), Event("Foot Off", 61.5, "Left"))
    plates = {"USED": [1], "TYPE": [2], "CORNERS": np.arange(12.0).reshape(3, 4, 1), "ORIGIN": np.ones((3, 1)),
              "CHANNEL": np.array([[1], [2]]), "ZERO": [0, 0]}  # fmt: skip
    return C3DTake(make_points(), 42, events, analog, plates)


def test_everything_of_a_take_comes_back(tmp_path):
    take = make_take()
    write_c3d(tmp_path / "a.c3d", take)
    back = read_c3d_take(tmp_path / "a.c3d")
    np.testing.assert_allclose(back.points.points_world, take.points.points_world, atol=1e-6)
    assert back.first_frame == 42 and back.points.fps == 100 and len(back.events) == 2
    for one, other in zip(back.events, take.events, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-5)
        assert (one.label, one.context, one.subject, one.description) == (
            other.label, other.context, other.subject, other.description)  # fmt: skip
    assert back.analog is not None and back.analog.rate == 1000
    assert back.analog.labels == ("Fz1", "EMG") and back.analog.units == ("N", "V")
    np.testing.assert_allclose(back.analog.values, take.analog.values, rtol=1e-6)
    np.testing.assert_allclose(back.force_platforms["CORNERS"], take.force_platforms["CORNERS"])
    assert back.points.covariance_world[0, 0, 0, 0] == pytest.approx(0.005**2)
    write_c3d(tmp_path / "b.c3d", back)
    assert read_raw_c3d(tmp_path / "b.c3d").points.tobytes() == read_raw_c3d(tmp_path / "a.c3d").points.tobytes()
    other = ezc3d.c3d(str(tmp_path / "b.c3d"))
    assert other["header"]["points"]["first_frame"] == 41
    assert list(other["parameters"]["EVENT"]["LABELS"]["value"]) == ["Foot Strike", "Foot Off"]
    np.testing.assert_allclose(other["data"]["analogs"][0].T, take.analog.values, rtol=1e-6)


def test_residual_is_in_either_byte(tmp_path):
    """The format's low byte, as most readers have it, and the high one, as ezc3d has it."""
    write_c3d(tmp_path / "a.c3d", make_points())
    data = (tmp_path / "a.c3d").read_bytes()
    start = (struct.unpack_from("<H", data, 16)[0] - 1) * 512
    fourth = np.frombuffer(data, "<f4", 5 * 3 * 4, start).reshape(5, 3, 4)[..., 3]
    assert (fourth[:, 0].astype(int) & 0xFF == 5).all() and (fourth[:, 0].astype(int) >> 8 == 5).all()
    assert (fourth[1:3, 1] == -1).all() and (fourth[:, 2] == 0).all()
    assert (ezc3d.c3d(str(tmp_path / "a.c3d"))["data"]["meta_points"]["residuals"][0, 0] == 5).all()


@pytest.mark.parametrize("name", ["tennis_serve_pig39.c3d", "tennis_serve_pig39_gaps.c3d"])
def test_our_reader_and_ezc3d_agree(name):
    if not (MARKERS / name).is_file():
        pytest.skip("../shared/data is not here")
    ours, other = read_raw_c3d(MARKERS / name), ezc3d.c3d(str(MARKERS / name))
    np.testing.assert_array_equal(ours.points, other["data"]["points"][:3].transpose(2, 1, 0))
    np.testing.assert_array_equal(ours.residuals, other["data"]["meta_points"]["residuals"][0].T)
    compared = 0
    for group, parameters in ours.parameters.items():
        for key, mine in parameters.items():
            theirs = other["parameters"][group][key]["value"]
            if isinstance(mine, list):
                assert mine == [str(v).strip() for v in theirs], key
            elif key != "DATA_START":  # what it would be if ezc3d wrote the file
                np.testing.assert_allclose(mine.ravel(), np.ravel(theirs), err_msg=key)
            compared += 1
    assert compared > 10


def c3d_bytes(order: str, integers: bool, header_events: bool = False) -> bytes:
    """A small file by hand: 2 points, 3 frames, 2 samples a frame of 1 channel; order <, > or d (DEC)."""
    end = ">" if order == ">" else "<"

    def f4(*values: float) -> bytes:
        if order != "d":
            return struct.pack(f"{end}{len(values)}f", *values)
        raw = np.array(values, "<f4") * np.float32(4)
        return raw.view("<u2").reshape(-1, 2)[:, ::-1].astype("<u2").tobytes()

    def i2(*values: int) -> bytes:
        return struct.pack(f"{end}{len(values)}h", *values)

    def parameter(group: int, name: bytes, kind: int, shape: tuple[int, ...], data: bytes) -> bytes:
        body = struct.pack("bB", kind, len(shape)) + bytes(shape) + data + b"\0"
        return struct.pack("bb", len(name), group) + name + i2(len(body) + 2) + body

    def named(group: int, name: bytes) -> bytes:
        return struct.pack("bb", len(name), -group) + name + i2(3) + b"\0"

    section = named(1, b"POINT") + parameter(1, b"USED", 2, (), i2(2))
    section += parameter(1, b"LABELS", -1, (4, 2), b"ab  cd  ") + parameter(1, b"UNITS", -1, (2,), b"cm")
    section += parameter(1, b"Y_SCREEN", -1, (2,), b"+Y") + parameter(1, b"RATE", 4, (), f4(50.0))
    section += parameter(2, b"SCALE", 4, (1,), f4(0.5)) + parameter(2, b"OFFSET", 2, (1,), i2(10)) + named(2, b"ANALOG")
    section += parameter(2, b"GEN_SCALE", 4, (), f4(2.0)) + b"\0\0"
    blocks = -(-(len(section) + 4) // 512)
    processor = {"<": 84, "d": 85, ">": 86}[order]
    section = bytes([1, 0x50, blocks, processor]) + section
    scale = 0.25 if integers else -0.25
    header = bytes([2, 0x50]) + i2(2, 2, 7, 9, 10) + f4(scale) + i2(2 + blocks, 2) + f4(50.0)
    header = bytearray(header.ljust(512, b"\0"))
    if header_events:
        header[296:300] = i2(12345, 1)
        header[304:308] = f4(0.14)
        header[396:400] = b"STRK"
    data = b""
    for t in range(3):
        for k in range(2):
            values = (4 * t, 8 * k, 12, -1 if (t, k) == (1, 1) else 3)
            data += i2(*values) if integers else f4(*(v * 0.25 for v in values[:3]), values[3])
        data += i2(20 + t, 30) if integers else f4(20 + t, 30)
    return bytes(header) + section.ljust(512 * blocks, b"\0") + data.ljust(512, b"\0")


@pytest.mark.parametrize("integers", [False, True])
@pytest.mark.parametrize("order", ["<", ">", "d"])
def test_byte_orders_integers_units_axes(tmp_path, order, integers):
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(order, integers, header_events=True))
    take = read_c3d_take(tmp_path / "a.c3d")
    assert take.points.landmarks.names == ("ab", "cd") and take.points.fps == 50 and take.first_frame == 7
    # Y is up in the file, centimetres: (x, y, z) -> (z, x, y) / 100.
    np.testing.assert_allclose(take.points.points_world[2], [[0.03, 0.02, 0.0], [0.03, 0.02, 0.02]], atol=1e-9)
    assert np.isnan(take.points.points_world[1, 1]).all() and np.isfinite(take.points.points_world).sum() == 15
    assert take.points.covariance_world[0, 0, 0, 0] == pytest.approx((3 * 0.25 / 100) ** 2)
    np.testing.assert_allclose(take.analog.values[:, 0], [10, 20, 11, 20, 12, 20])
    assert take.analog.rate == 100 and take.events == (Event("STRK", pytest.approx(0.14)),)


def test_stated_unit_and_axes_can_be_overruled(tmp_path):
    (tmp_path / "a.c3d").write_bytes(c3d_bytes("<", False))
    points = read_c3d(tmp_path / "a.c3d", unit="m", up="z")
    np.testing.assert_allclose(points.points_world[2, 1], [2, 2, 3])
    with pytest.raises(FormatError, match="valid are m, cm, mm"):
        read_c3d(tmp_path / "a.c3d", unit="furlong")
    with pytest.raises(ValueError, match="up must be"):
        read_c3d(tmp_path / "a.c3d", up="x")


def test_many_points_and_results_of_gait_models(tmp_path):
    names = tuple(f"m{k}" for k in range(300))
    write_c3d(tmp_path / "a.c3d", make_points(names=names))
    assert read_c3d(tmp_path / "a.c3d").landmarks.names == names
    write_c3d(tmp_path / "b.c3d", make_points(names=("LASI", "LKneeAngles", "RASI")))
    file = ezc3d.c3d(str(tmp_path / "b.c3d"))
    file.add_parameter("POINT", "ANGLES", ["LKneeAngles"])
    file.write(str(tmp_path / "c.c3d"))
    assert read_c3d(tmp_path / "c.c3d").landmarks.names == ("LASI", "RASI")


@pytest.mark.parametrize(
    ("at", "new", "says"),
    [
        (1, b"\x51", "does not begin as"),
        (0, b"\xff", "parameters are stated to begin"),
        (2, b"\x63\x00", "99 points, POINT:USED 2"),
        (8, b"\xff\x00", "cut off"),
        (6, b"\xff\x00", "frames go from"),
        (16, b"\xff\xff", "cut off"),
        (512 + 3, b"\x07", "processor type 7"),
    ],
)
def test_damaged(tmp_path, at, new, says):
    data = bytearray(c3d_bytes("<", False))
    data[at : at + len(new)] = new
    (tmp_path / "bad.c3d").write_bytes(bytes(data))
    with pytest.raises(FormatError, match=says) as raised:
        read_c3d(tmp_path / "bad.c3d")
    assert "bad.c3d" in str(raised.value) and "\n" not in str(raised.value)


def whole_points(frames: int) -> Points3D:
    points = make_points(frames, ("LASI", "RASI"))
    points.points_world[1:3, 1] = 1.0
    return points


@pytest.mark.parametrize(("frames", "first"), [(65_600, 1), (20, 65_530), (20, 200_000)])
def test_frames_beyond_what_the_header_counts_come_back(tmp_path, frames, first):
    points = whole_points(frames)
    write_c3d(tmp_path / "a.c3d", C3DTake(points, first))
    back = read_c3d_take(tmp_path / "a.c3d")
    assert back.first_frame == first
    np.testing.assert_allclose(back.points.points_world, points.points_world, atol=1e-6)


def test_frames_are_counted_where_no_parameter_does(tmp_path):
    """By LONG_FRAMES alone, or by the file's size where all say 65,535."""
    points = whole_points(65_600)
    write_c3d(tmp_path / "a.c3d", points)
    data = (tmp_path / "a.c3d").read_bytes()
    for name in (b"LONG_FRAMES", b"ACTUAL_START_FIELD", b"ACTUAL_END_FIELD"):
        assert data.count(name) == 1
        data = data.replace(name, b"X" * len(name))
    (tmp_path / "b.c3d").write_bytes(data)
    assert len(read_c3d(tmp_path / "b.c3d").points_world) == 65_600
    long = data.replace(b"\x06\x01FRAMES", b"\x06\x01XRAMES").replace(b"X" * 11, b"LONG_FRAMES")
    (tmp_path / "c.c3d").write_bytes(long)
    assert len(read_c3d(tmp_path / "c.c3d").points_world) == 65_600


def test_point_frames_may_be_a_real_number(tmp_path):
    write_c3d(tmp_path / "a.c3d", make_points())
    reader = _Reader(tmp_path / "a.c3d", (tmp_path / "a.c3d").read_bytes())
    header = np.array([0, 1, 0, 1, 65_535])
    stated = {"POINT": {"FRAMES": np.array(65_600.0)}}
    assert reader.frames(header, stated, 512, 16) == (65_600, 1)


@pytest.mark.parametrize("room", [100, 4096, -300, -1])
def test_a_full_disk_is_said_and_the_file_before_kept(tmp_path, room):
    resource = pytest.importorskip("resource")
    xyz = np.zeros((500, 3, 3))
    points = Points3D(LandmarkSet("c3d", ("a", "b", "c"), ()), xyz, np.full((500, 3, 3, 3), np.nan),
                      np.empty((0, 500, 3)), np.empty((0, 500, 3), bool), 100.0)  # fmt: skip
    path = tmp_path / "a.c3d"
    write_c3d(path, points)
    before = path.read_bytes()
    end = len(before) - (-len(before) % 512)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room if room > 0 else end + room, hard))
    try:
        with pytest.raises(OutputError, match="a.c3d cannot be written"):
            write_c3d(path, points)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]
