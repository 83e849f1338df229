"""Stages on disk: what is stored comes back, and a damaged file is computed again."""

import io
import zipfile

import numpy as np
import pytest

from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import Stages, StageStore
from tests.paths import DATA

ARRAYS = {"points": np.arange(12.0).reshape(4, 3), "names": np.array(["a", "bc"])}


def _renamed(data: bytes) -> bytes:
    """An entry under another name, in a valid archive."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name.replace("points", "pointz"), old.read(name))
    return out.getvalue()


def _flipped(data: bytes) -> bytes:
    middle = data.index(b"array_points") + 60  # within the compressed array
    return data[:middle] + bytes(b ^ 255 for b in data[middle : middle + 8]) + data[middle + 8 :]


def test_a_stored_stage_comes_back(tmp_path):
    store = StageStore(tmp_path)
    store.save("s", "key", ARRAYS, {"count": 3}, 1.5)
    found = store.load("s", "key")
    assert found is not None and found.resumed and found.facts == {"count": 3} and found.seconds == 1.5
    assert found.arrays.keys() == ARRAYS.keys()
    assert all((found.arrays[n] == a).all() for n, a in ARRAYS.items())
    assert store.holds("s", "key") and not store.holds("s", "other") and store.load("s", "other") is None


@pytest.mark.parametrize("damage", [_renamed, _flipped, lambda d: d[:-30], lambda d: b"", lambda d: b"PK" + d[5:]])
def test_a_damaged_stage_is_computed_again(tmp_path, damage):
    store = StageStore(tmp_path)
    first = Stages(store, Progress(), ["inputs"])("s", 1, lambda: (ARRAYS, {}))
    path = store.path("s")
    path.write_bytes(damage(path.read_bytes()))
    computed = []
    again = Stages(store, Progress(), ["inputs"])("s", 1, lambda: computed.append(1) or (ARRAYS, {}))
    assert computed and not again.resumed and again.key == first.key
    assert Stages(store, Progress(), ["inputs"])("s", 1, lambda: (ARRAYS, {})).resumed, "stored soundly again"


CASES = DATA / "cases" / "stage_cache"


@pytest.mark.skipif(not CASES.is_dir(), reason="needs shared/data/cases")
def test_damaged_stages_of_real_runs_are_no_results(tmp_path):
    files = sorted(CASES.glob("*.npz"))
    assert files
    store = StageStore(tmp_path)
    for file in files:
        store.path("s").write_bytes(file.read_bytes())
        found = store.load("s", "key")
        assert found is None and not store.holds("s", "key"), file.name
        computed = Stages(store, Progress(), ["inputs"])("s", 1, lambda: (ARRAYS, {}))
        assert not computed.resumed and store.holds("s", computed.key)
