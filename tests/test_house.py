"""The size of the house: no folder, file or function grows beyond what one reads at once."""

import ast
from pathlib import Path

from tests.paths import tracked_files

MOST_ENTRIES, MOST_LINES, LONGEST_FUNCTION = 14, 400, 60
SOURCES = ("geometry", "models", "motion", "train", "infer", ".root")
# Data, not code: the shaders of one renderer.
NOT_CODE = ("__pycache__", "shaders", "assets", "weights", "cards")


def _is_source(path: Path, repository: Path) -> bool:
    return path.relative_to(repository).parts[0] in SOURCES


def test_no_source_folder_has_more_than_fourteen_entries(repository: Path) -> None:
    entries: dict[Path, set[str]] = {}
    for path in tracked_files(repository):
        if _is_source(path, repository):
            for parent in path.parents:
                if parent == repository:
                    break
                child = path.relative_to(parent).parts[0]
                entries.setdefault(parent, set()).add(child.removesuffix(".pyi").removesuffix(".py"))
    full = {
        str(folder.relative_to(repository)): len(names)
        for folder, names in entries.items()
        if len(names - {"__init__"}) > MOST_ENTRIES and folder.name not in NOT_CODE
    }
    assert not full


def test_no_python_file_has_more_than_four_hundred_lines(repository: Path) -> None:
    long = {
        str(path.relative_to(repository)): count
        for path in tracked_files(repository)
        if path.suffix == ".py" and (count := len(path.read_text(encoding="utf-8").splitlines())) > MOST_LINES
    }
    assert not long


def test_no_function_has_more_than_sixty_lines(repository: Path) -> None:
    long = []
    for path in tracked_files(repository):
        if path.suffix != ".py" or not _is_source(path, repository):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body
                # A docstring is for the reader of the documentation; the limit is about code.
                documented = ast.get_docstring(node) is not None
                doc = (body[0].end_lineno or 0) - body[0].lineno + 1 if documented else 0
                lines = (node.end_lineno or 0) - node.lineno + 1 - doc
                if lines > LONGEST_FUNCTION:
                    long.append((str(path.relative_to(repository)), node.name, lines))
    assert not long
