"""The public names with their signatures as text, read from their sources.

`python -m tests.api.signatures` in the repository's root writes `signatures.txt` anew: review the difference, since it
is what users of the package will notice (docs/reference/api-policy.md).
"""

import ast
import inspect
import textwrap
from pathlib import Path

import muybridge

GOLDEN = Path(__file__).with_name("signatures.txt")


def signatures() -> str:
    """One paragraph a name, in alphabetical order."""
    return "\n".join(_described(name) for name in sorted(muybridge.__all__) if name != "__version__")


def _described(name: str) -> str:
    value = getattr(muybridge, name)
    if inspect.isclass(value):
        return _class(name, value)
    if inspect.isfunction(value):
        return f"def {_function(_definition(value), name)}\n"
    return f"{name}: {type(value).__name__}\n"


def _definition(value: object) -> ast.stmt:
    return ast.parse(textwrap.dedent(inspect.getsource(value))).body[0]  # type: ignore[arg-type]


def _function(node: ast.stmt, name: str) -> str:
    assert isinstance(node, ast.FunctionDef)
    returns = "" if node.returns is None else f" -> {ast.unparse(node.returns)}"
    return f"{name}({ast.unparse(node.args)}){returns}"


def _class(name: str, value: type) -> str:
    """Bases, public fields, properties and methods, in the order of the source."""
    node = _definition(value)
    assert isinstance(node, ast.ClassDef)
    bases = ", ".join(ast.unparse(base) for base in node.bases)
    lines = [f"class {name}({bases})"]
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and not ast.unparse(item.target).startswith("_"):
            lines.append(f"    {ast.unparse(item)}")
        elif isinstance(item, ast.FunctionDef) and (item.name == "__init__" or not item.name.startswith("_")):
            marks = [ast.unparse(mark) for mark in item.decorator_list]
            lines.append("    " + " ".join([*(f"@{mark}" for mark in marks), _function(item, item.name)]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    GOLDEN.write_text(signatures(), encoding="utf-8")
