"""What `import muybridge` offers, how cheap it is, and that nothing of it changes unnoticed."""

import ast
import inspect
import subprocess
import sys

import pytest

import muybridge
from tests.api.signatures import GOLDEN, signatures

# Networks, networking and arrays: none of it is needed before the first name is used.
HEAVY = ("numpy", "scipy", "numba", "cv2", "onnxruntime", "torch", "av", "socket", "ssl", "http", "urllib.request")
FUNCTIONS = [name for name in muybridge.__all__ if inspect.isfunction(getattr(muybridge, name))]


def _python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_importing_loads_nothing_heavy() -> None:
    assert _python(f"import sys, muybridge; print([m for m in {HEAVY!r} if m in sys.modules])") == "[]"


def test_importing_takes_less_than_a_fifth_of_a_second() -> None:
    # Seconds of the processor, the best of three: other processes are no matter of ours.
    code = "import time; start = time.process_time(); import muybridge; print(time.process_time() - start)"
    assert min(float(_python(code)) for _ in range(3)) < 0.2


def test_using_everything_loads_no_training_library() -> None:
    code = (
        "import sys, muybridge; [getattr(muybridge, name) for name in muybridge.__all__]; "
        "print([m for m in ('torch', 'kornia', 'anny', 'onnx', 'muybridge.train') if m in sys.modules])"
    )
    assert _python(code) == "[]"


def test_signatures_are_those_of_the_golden_file() -> None:
    said = "the public interface changed: see docs/reference/api-policy.md, then run python -m tests.api.signatures"
    assert signatures() == GOLDEN.read_text(encoding="utf-8"), said


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="captrue"):
        muybridge.captrue  # noqa: B018


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_typed_and_documented(name: str) -> None:
    function = getattr(muybridge, name)
    node = ast.parse(inspect.getsource(function)).body[0]
    assert isinstance(node, ast.FunctionDef) and node.returns is not None
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    assert all(argument.annotation is not None for argument in arguments)
    text = inspect.getdoc(function) or ""
    if function.__module__.startswith("muybridge.api"):
        assert "Args:" in text and "Raises:" in text and "Example:" in text
        assert all(f"{argument.arg}:" in text for argument in arguments), text
    assert "--" not in text, "flags are the command line's"
