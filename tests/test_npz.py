"""NumPy archives from outside: refused in one line where they are damaged, and before memory is asked for."""

import io
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError, ModelError
from muybridge.motion.formats.points.npz import read_npz
from muybridge.motion.formats.registry import ReadOptions, read_file
from muybridge.npz import load_npz
from tests.paths import DATA


def archive_of(path: Path, entries: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return path


def stored(array: object) -> bytes:
    out = io.BytesIO()
    np.save(out, np.asarray(array), allow_pickle=True)
    return out.getvalue()


def declaring(shape: tuple[int, ...], content: bytes = b"", dtype: str = "<f8") -> bytes:
    out = io.BytesIO()
    header = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, header)  # type: ignore[arg-type]
    return out.getvalue() + content


def take(path: Path, frames: int) -> Path:
    """Points of many frames that shrink to nearly nothing."""
    names = np.array([f"n{i}" for i in range(23)])
    np.savez_compressed(path, points_world=np.zeros((frames, 23, 3)), names=names, fps=np.array(60.0))
    return path


@pytest.mark.parametrize("array", [
    np.arange(24.0).reshape(2, 3, 4), np.asfortranarray(np.arange(12).reshape(3, 4)), np.array("text"),
    np.zeros((0, 3), np.float32), np.array([["a", "bc"]]), np.array(True), np.arange(6, dtype=">i2"),
])  # fmt: skip
def test_arrays_are_read_as_numpy_reads_them(tmp_path: Path, array: np.ndarray) -> None:
    np.savez_compressed(tmp_path / "a.npz", array=array, other=np.zeros(3))
    (there,) = load_npz(tmp_path / "a.npz", ["array", "absent"]).values()
    assert there.dtype == array.dtype and there.shape == array.shape and np.array_equal(there, array)
    assert set(load_npz(tmp_path / "a.npz")) == {"array", "other"}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"PK no array", "magic"),
        (declaring((10**9, 23, 3)), "0 bytes follow"),
        (declaring((2,), bytes(8)), "8 bytes follow"),
        (declaring((2,), bytes(24)), "24 bytes follow"),
        (declaring((-1,), bytes(8)), "8 bytes follow"),
        (declaring((10**30,), dtype="<U0"), "not an .npz"),
        (stored(np.array([{}], object)), "holds objects"),
        (stored(np.zeros(2, "f8,i4")), "records"),
        (declaring((1,), bytes(8)).replace(b"'shape': (1,)", b"'shape': (1, "), "header of points_world.npy cannot be"),
        (declaring((1,), bytes(8)).replace(b"\x01\x00", b"\x09\x00", 1), "9.0"),
    ],
)
def test_what_is_no_sound_array_is_refused(tmp_path: Path, content: bytes, says: str) -> None:
    path = archive_of(tmp_path / "a.npz", {"points_world.npy": content, "fps.npy": stored(50.0)})
    with pytest.raises(ModelError, match=says) as caught:
        load_npz(path, error=ModelError, what="an .npz of weights")
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    assert load_npz(path, ["fps"])["fps"] == 50, "what isn't asked for isn't read"


def test_entries_that_are_no_arrays_are_ignored(tmp_path: Path) -> None:
    path = archive_of(tmp_path / "a.npz", {"README.txt": b"words", "fps.npy": stored(50.0)})
    assert list(load_npz(path)) == ["fps"]


def test_a_damaged_archive_is_refused_or_read_as_it_was(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    np.savez_compressed(
        tmp_path / "a.npz", points_world=rng.normal(size=(5, 2, 3)), names=np.array(["a", "b"]), fps=np.array(50.0)
    )
    data = (tmp_path / "a.npz").read_bytes()
    right = load_npz(tmp_path / "a.npz")
    refused = 0
    for _ in range(300):
        damaged = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 4)):
            damaged[at] = rng.integers(256)
        (tmp_path / "b.npz").write_bytes(damaged[: rng.integers(1, len(data))] if rng.random() < 0.2 else damaged)
        try:
            there = load_npz(tmp_path / "b.npz")
        except FormatError as error:
            assert str(tmp_path / "b.npz") in str(error) and "\n" not in str(error)
            refused += 1
        else:  # damage to what nobody reads: times, attributes, names of entries
            assert all(np.array_equal(there[name], right[name]) for name in set(there) & set(right))
    assert refused > 100


def test_too_much_data_is_refused_before_it_is_allocated(tmp_path: Path) -> None:
    path = take(tmp_path / "bomb.npz", 150_000)
    tracemalloc.start()
    for limit in (None, 10**6):
        with pytest.raises(FormatError, match="declares 82.8 MB.*`limit`"):
            read_npz(path, limit=limit)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()
    with pytest.raises(FormatError, match="declares 82.8 MB"):
        read_file(path)


@pytest.mark.parametrize("up", ["y", "z"])
def test_reading_takes_at_most_twice_the_memory_of_what_is_read(tmp_path: Path, up: str) -> None:
    path, size = take(tmp_path / "bomb.npz", 150_000), 150_000 * 23 * 3 * 8
    tracemalloc.start()
    points = read_file(path, ReadOptions(units="mm", up=up, limit=10**8)).positions
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(points.points_world) == 150_000 and most < 2 * size


@pytest.fixture
def case(request: pytest.FixtureRequest) -> Callable[[str], list[Path]]:
    """Files of a folder of cases; the test is skipped where it is absent."""

    def files(pattern: str) -> list[Path]:
        found = sorted((DATA / "cases").glob(pattern))
        if not found:
            pytest.skip(f"no files ../shared/data/cases/{pattern}")
        return found

    return files


def test_damaged_files_that_ended_in_tracebacks(case: Callable[[str], list[Path]]) -> None:
    for path in case("npz/*.npz"):
        with pytest.raises(FormatError, match=path.name):
            read_file(path)
