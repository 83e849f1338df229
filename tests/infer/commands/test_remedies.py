"""The two tables of remedies have the same keys, in order, and every key that is raised is one of them."""

import re
import string
from pathlib import Path

from muybridge.errors import CalibrationError
from muybridge.infer.commands.remedies import COMMAND_REMEDIES, error_line
from muybridge.remedies import REMEDIES

ROOT = Path(__file__).parents[3]


def _fields(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


def test_both_tables_have_the_same_keys() -> None:
    assert list(REMEDIES) == sorted(REMEDIES)
    assert list(COMMAND_REMEDIES) == list(REMEDIES)
    for key, text in REMEDIES.items():
        assert not re.search(r"--\w|`muybridge ", text), key
        assert _fields(text) == _fields(COMMAND_REMEDIES[key]), key


def test_every_remedy_is_raised_somewhere() -> None:
    folders = [ROOT / name for name in ("geometry", "models", "motion", "infer", "train")]
    source = "\n".join(p.read_text(encoding="utf-8") for folder in folders for p in folder.rglob("*.py"))
    for key in REMEDIES:
        assert f'"{key}"' in source.replace(f'    "{key}":', ""), key


def test_the_two_texts_of_an_error() -> None:
    error = CalibrationError("camera a: 5 points", remedy="points_off_shape", shape="plane")
    assert str(error).startswith("camera a: 5 points; add points well off the plane, or pass")
    assert error_line(error).endswith("well off the plane, or give the lens with --lenses")
