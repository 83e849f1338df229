"""The command line: commands by entry point, known errors in one line, bugs with their traceback."""

import json
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from muybridge import __version__
from muybridge.errors import MuybridgeError
from muybridge.infer.commands import app as cli

EXTRAS = ("torch", "kornia", "anny", "moderngl", "onnx", "onnxscript")
# A process in which the training libraries cannot be found, as after a base install.
BASE_INSTALL = f"""
import importlib.abc, sys
class Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Missing())
from muybridge.infer.commands.app import main
"""

# Prints what commands said, which are given as JSON in the second argument: [[exit code, stdout, stderr], ...].
EACH_IN_TURN = """
import contextlib, io, json
said = []
for words in json.loads(sys.argv[1]):
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            main(words)
        except SystemExit as stop:
            said.append([stop.code or 0, out.getvalue(), error.getvalue()])
print(json.dumps(said))
"""


def python(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def installed(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command line as a user has it."""
    return subprocess.run([sys.executable, "-m", "muybridge", *arguments], capture_output=True, text=True, timeout=120)


@pytest.fixture
def command(monkeypatch, tmp_path):
    """Registers the function of a source text as the only command, `try`."""

    def register(source: str) -> None:
        (tmp_path / "tried_commands.py").write_text(source)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "tried_commands", raising=False)
        entry = EntryPoint("try", "tried_commands:tried", cli.GROUP)
        monkeypatch.setattr(cli, "find_commands", lambda: {"try": entry})

    return register


def test_help_lists_every_command_with_a_line():
    done = installed("--help")
    assert done.returncode == 0 and done.stderr == ""
    lines = {line[2:].split("  ")[0]: line for line in done.stdout.splitlines() if line.startswith("  ")}
    assert set(lines) == set(cli.find_commands()) >= {"run", "demo"}
    for name in ("run", "demo"):
        assert len(lines[name].split()) > 4
    assert installed().stdout == done.stdout


def test_version():
    assert installed("--version").stdout == f"muybridge {__version__}\n"


@pytest.mark.parametrize("module", ["muybridge.infer.commands.app", "muybridge.infer.commands.run"])
def test_the_command_line_leaves_torch_out(module):
    code = f"import sys, {module}; print([m for m in {EXTRAS!r} if m in sys.modules])"
    assert python(code).stdout == "[]\n"


def test_help_needs_nothing_but_the_standard_library():
    code = "import sys, muybridge.infer.commands.app as c; c.run_command(['--help']); print('numpy' in sys.modules)"
    assert python(code).stdout.endswith("False\n")


def test_every_command_explains_itself_without_the_extras():
    names = sorted(cli.find_commands())
    done = python(BASE_INSTALL + EACH_IN_TURN, json.dumps([[*name.split(), "--help"] for name in names]))
    assert (done.returncode, done.stderr) == (0, "")
    said = json.loads(done.stdout)
    assert len(said) == len(names)
    for name, (code, out, error) in zip(names, said, strict=True):
        assert (code, error) == (0, ""), name
        assert f"usage: muybridge {name}" in out


def test_run_has_its_stages_options():
    said = installed("run", "--help-all").stdout
    for flag in ("--calibration", "--video-size", "--workers", "--triangulate.min-views", "--overwrite"):
        assert flag in said


def test_training_without_its_extra_says_what_to_install():
    done = python(BASE_INSTALL + "main(['train', 'keypoints'])")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert 'pip install "muybridge[train]"' in done.stderr


def test_commands_of_two_words_are_listed_and_corrected():
    listed = installed("calibrate")
    assert listed.returncode == 0 and "calibrate board" in listed.stdout and "calibrate people" in listed.stdout
    assert installed("calibrate", "--help").stdout == listed.stdout
    done = installed("calibrate", "bord")
    assert done.returncode == 2 and "did you mean `muybridge calibrate board`?" in done.stderr


def test_an_unknown_command_is_one_line():
    done = installed("rum")
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and "did you mean `muybridge run`?" in done.stderr


def test_an_option_that_does_not_exist_exits_with_2():
    done = installed("run", "somewhere", "--triangulat.min-views", "3")
    assert done.returncode == 2 and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("flag", "value", "said"), [("--workers", "0", "workers must be"), ("--triangulate.min-views", "1", "min_views")]
)
def test_an_option_out_of_range_is_said(flag, value, said, capfd):
    with pytest.raises(SystemExit) as stopped:
        cli.main(["run", "somewhere", flag, value])
    assert stopped.value.code == 2
    error = capfd.readouterr().err
    assert said in error and "--help" in error and "Traceback" not in error


def test_known_errors_are_one_line(command, capsys):
    command("from muybridge.errors import VideoError\ndef tried():\n    raise VideoError('a\\n  b')\n")
    assert cli.run_command(["try"]) == 2
    assert capsys.readouterr().err == "error: a b\n"


def test_bugs_keep_their_traceback(command):
    command("def tried():\n    raise ZeroDivisionError\n")
    with pytest.raises(ZeroDivisionError):
        cli.run_command(["try"])


def test_an_interrupt_is_130(command):
    command("def tried():\n    raise KeyboardInterrupt\n")
    assert cli.run_command(["try"]) == 130


def test_what_a_command_returns_is_the_exit_code(command):
    command('def tried(code: int):\n    """Try."""\n    return code\n')
    assert cli.run_command(["try", "--code", "7"]) == 7
    command('def tried():\n    """Try."""\n')
    assert cli.run_command(["try"]) == 0


def test_a_missing_extra_is_named_and_the_help_works_without(command, monkeypatch, capsys):
    command('"""Tried."""\nimport torch\n\ndef tried():\n    """Trains something."""\n')
    monkeypatch.setitem(sys.modules, "torch", None)
    assert cli.run_command(["--help"]) == 0
    assert "try  Trains something." in capsys.readouterr().out
    assert cli.run_command(["try"]) == 2
    assert capsys.readouterr().err == (
        "error: `muybridge try` needs torch, which is not installed; install the extra: "
        'pip install "muybridge[train]"\n'
    )


def test_a_missing_extra_inside_a_command_is_named_too(command, monkeypatch, capsys):
    command("def tried():\n    import kornia.geometry\n")
    monkeypatch.setitem(sys.modules, "kornia", None)
    assert cli.run_command(["try"]) == 2
    assert 'pip install "muybridge[train]"' in capsys.readouterr().err


def test_a_missing_module_of_no_extra_is_a_bug(command):
    command("import surely_there_is_no_such_module\n")
    with pytest.raises(ModuleNotFoundError):
        cli.run_command(["try"])


def test_a_command_that_is_not_there_is_known_as_such(monkeypatch, capsys):
    entry = EntryPoint("lost", "muybridge.nowhere.commands:lost", cli.GROUP)
    monkeypatch.setattr(cli, "find_commands", lambda: {"lost": entry})
    assert cli.run_command(["--help"]) == 0
    assert "not part of this installation" in capsys.readouterr().out
    with pytest.raises(MuybridgeError, match="reinstall"):
        cli._dispatch(["lost"])


def test_many_sessions_each_have_their_folder(tmp_path):
    from muybridge.infer.commands.run import plan

    a, b, again = tmp_path / "x" / "walk", tmp_path / "y" / "walk", tmp_path / "run"
    out = tmp_path / "out"
    assert plan([a], out) == [(a, out)]
    assert plan([a, again], None) == [(a, None), (again, None)]
    assert plan([a, b, again, a], out) == [
        (a, out / "x-walk"),
        (b, out / "y-walk"),
        (again, out / "run"),
    ]
    assert Path("x-walk") not in [p for p, _ in plan([a, b], None)]
