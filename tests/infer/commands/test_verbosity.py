"""`-v`, `-vv` and `-q`: log records of all modules on standard error, beside the progress display."""

import io
import logging
import sys

import pytest

from muybridge.infer.commands import app
from muybridge.infer.runtime import logs
from muybridge.infer.runtime.progress import Progress

LOG = logging.getLogger("muybridge.geometry.example")


@pytest.fixture
def command(monkeypatch, tmp_path):
    """Registers a command `try` that logs at every level and reports progress."""
    from importlib.metadata import EntryPoint

    (tmp_path / "logging_command.py").write_text(
        "import logging\n"
        "from muybridge.infer.runtime.progress import Progress\n"
        "def tried():\n"
        "    log = logging.getLogger('muybridge.geometry.example')\n"
        "    for level in ('debug', 'info', 'warning'):\n"
        "        getattr(log, level)('%s [1] of %s', level, 2)\n"
        "    logging.getLogger('other').info('from elsewhere')\n"
        "    logging.getLogger('other').debug('never')\n"
        "    with Progress() as progress:\n"
        "        progress.say('working')\n"
        "        progress.notice('look')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "logging_command", raising=False)
    entry = EntryPoint("try", "logging_command:tried", app.GROUP)
    monkeypatch.setattr(app, "find_commands", lambda: {"try": entry})


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ([], "warning: warning [1] of 2\nworking\nnote: look\n"),
        (["-q"], "warning: warning [1] of 2\nnote: look\n"),
        (["-v"], "info: info [1] of 2\nwarning: warning [1] of 2\nworking\nnote: look\n"),
        (
            ["--verbose", "--verbose", "-q"],
            "debug: muybridge.geometry.example: debug [1] of 2\ninfo: muybridge.geometry.example: info [1] of 2\n"
            "warning: muybridge.geometry.example: warning [1] of 2\ninfo: other: from elsewhere\nnote: look\n",
        ),
    ],
)
def test_levels(command, capsys, flags, expected):
    assert app.run_command(["try", *flags]) == 0
    lines = capsys.readouterr().err.splitlines(keepends=True)
    assert "".join(line for line in lines if "muybridge.infer.commands.app" not in line) == expected


def test_nothing_is_left_behind(command, capsys):
    before = logging.getLogger().handlers[:], logging.getLogger().level, logging.getLogger("muybridge").level
    app.run_command(["try", "-vv"])
    assert before == (logging.getLogger().handlers, logging.getLogger().level, logging.getLogger("muybridge").level)
    assert not logs.is_quiet()
    capsys.readouterr()


def test_an_exception_that_is_logged_keeps_its_traceback(capsys):
    with logs.verbosity():
        try:
            raise ZeroDivisionError("by [bold]zero[/bold]")
        except ZeroDivisionError:
            LOG.exception("failed")
    said = capsys.readouterr().err
    assert said.startswith("error: failed\nTraceback") and "ZeroDivisionError: by [bold]zero[/bold]" in said


def test_records_appear_above_the_bars(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    logs.error_console.cache_clear()
    with logs.verbosity(1), Progress() as progress, progress.task("counting", 3) as task:
        task.advance()
        LOG.info("in the middle of %d", 3)
        assert progress._bars is not None and progress._bars.rich.console is logs.error_console()
    logs.error_console.cache_clear()
    lines = terminal.getvalue()
    assert "info: in the middle of 3\n" in lines.replace("\x1b[0m", "") and "counting" in lines
