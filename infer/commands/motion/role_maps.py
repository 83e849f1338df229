"""Suggested maps of joints or links, written for the user to correct."""

from pathlib import Path

from muybridge.files import replacing
from muybridge.infer.results.ownership import check_replaceable


def write_map(path: Path, text: str, source: Path, overwrite: bool, found: str = "") -> int:
    """Write a suggested map, and print where it is.

    Args:
        path: to write.
        text: of the map.
        source: the character or robot that was read, which is never replaced.
        overwrite: whether a file that is there may be replaced.
        found: how the roles were found, printed first.

    Returns:
        The exit code.

    Raises:
        OutputError: the file is there already, or cannot be written.
    """
    check_replaceable([path], overwrite, [source], make_folders=False)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    print("\n".join([*([found] if found else []), f"{path}: correct what is wrong in it, and give it with --map"]))
    return 0
