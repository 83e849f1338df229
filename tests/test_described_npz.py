"""Files of arrays with a description: equal contents are equal files, and what is no such file is told so."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.described_npz import DescribedFile
from muybridge.errors import FormatError

KIND = DescribedFile("muybridge_thing", "a thing", "build_graph", version=3, packed=True)
ABOUT, ARRAYS = {"names": ["a", "b"]}, {"numbers": np.arange(6.0).reshape(2, 3)}


def test_what_was_written_is_read_and_equal_contents_are_equal_files(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    KIND.write(one, ABOUT, ARRAYS)
    KIND.write(other, ABOUT, {"numbers": np.asfortranarray(ARRAYS["numbers"])})
    assert one.read_bytes() == other.read_bytes()
    assert b"muybridge_thing.npy" in one.read_bytes()[:60]
    about, arrays = KIND.read(one, lambda about, arrays: (about, arrays))
    assert about == {"version": 3, **ABOUT}
    np.testing.assert_array_equal(arrays["numbers"], ARRAYS["numbers"])


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"

    def refuse(about: object, arrays: object) -> None:
        raise ValueError("no numbers")

    path.write_bytes(b"text")
    with pytest.raises(FormatError, match="is no thing"):
        KIND.read(path, refuse)
    np.savez(path.with_suffix(".npz"), numbers=np.zeros(3))
    with pytest.raises(FormatError, match="is no thing"):
        KIND.read(path.with_suffix(".npz"), refuse)
    DescribedFile("muybridge_thing", "a thing", "build_graph", version=2).write(path, ABOUT, ARRAYS)
    with pytest.raises(FormatError, match="is a thing of version 2; this muybridge reads version 3"):
        KIND.read(path, refuse)
    KIND.write(path, ABOUT, ARRAYS)
    with pytest.raises(FormatError, match=r"is damaged as a thing \(no numbers\)"):
        KIND.read(path, refuse)
