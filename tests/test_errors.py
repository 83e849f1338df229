"""The family of errors, and the context in which files from outside are parsed."""

import pytest

from muybridge.errors import CalibrationError, FormatError, parsing


@pytest.mark.parametrize(
    ("problem", "text"),
    [
        (KeyError("frames"), "x.bvh: damaged, or not a BVH: 'frames'"),
        (AttributeError("'bytes' has\nno shape"), "x.bvh: damaged, or not a BVH: 'bytes' has no shape"),
        (ValueError(), "x.bvh: damaged, or not a BVH: ValueError"),
        (RecursionError("maximum recursion depth"), "x.bvh: nested too deeply for a BVH; the file is damaged"),
        (MemoryError(), "x.bvh: declares more data than fits into memory; a BVH of this size is damaged"),
        (OSError("Invalid\n data\n"), "x.bvh: cannot be read: Invalid data"),
        (PermissionError(13, "Permission denied"), "x.bvh: cannot be read: Permission denied"),
    ],
)
def test_whatever_a_parser_raises_becomes_one_line_that_names_the_file(problem: Exception, text: str) -> None:
    with pytest.raises(FormatError) as caught, parsing("x.bvh", FormatError, "a BVH"):
        raise problem
    assert str(caught.value) == text
    assert caught.value.__cause__ is problem


@pytest.mark.parametrize(
    "problem", [KeyError("a"), MemoryError(), RecursionError(), FileNotFoundError(2, "No such file")]
)
def test_a_file_name_with_a_line_break_is_named_in_one_line(problem: Exception) -> None:
    with pytest.raises(FormatError, match=r"^/takes/new line\.bvh: ") as caught:
        with parsing("/takes/new\nline.bvh", FormatError, "a BVH"):
            raise problem
    assert len(str(caught.value).splitlines()) == 1


def test_errors_of_the_family_pass_through_unchanged() -> None:
    original = CalibrationError("camera 2 has no lens")
    with pytest.raises(CalibrationError) as caught, parsing("x.bvh", FormatError, "a BVH"):
        raise original
    assert caught.value is original
