"""The help of every command, short and long."""

import dataclasses
import importlib
import pkgutil
import re

import pytest

import muybridge
from muybridge.infer.commands import app, options, parsing
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.videos import RunOptions

SUBCOMMANDS = {"train": ("keypoints", "people", "labels", "solver", "rigger", "skinning", "adapt"), "eval": ()}
# A line that begins an option; without a terminal there may be no frame around it.
OPTION = re.compile(r"^[│|]? *(--?[a-zA-Z][\w.-]*)", re.M)
COMMANDS = [
    (name, *sub)
    for name in app.find_commands()
    for sub in [(), *((word,) for word in SUBCOMMANDS.get(name, ()))]
]  # fmt: skip


@pytest.fixture
def shown(capsys, monkeypatch):
    """The help of a command."""
    monkeypatch.setenv("COLUMNS", "100")

    def show(name: str, *words: str) -> str:
        command = app.find_commands()[name].load()
        with pytest.raises(SystemExit) as stopped:
            parsing.parse(command, name, words)
        assert stopped.value.code == 0
        return str(capsys.readouterr().out)

    return show


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_no_help_shows_none_or_an_empty_default(shown, words):
    for flag in ("--help", "--help-all"):
        text = shown(*words, flag)
        assert (
            "{None" not in text
            and "default: None" not in text
            and not re.search(r"default:\s*(''|\[\]|\(\)|\{\})?\s*\)", text)
        ), flag
        assert "{fixed}" not in text and "{{" not in text and "{STR" not in text
        assert {"--help-all", "-v", "-q", "-h"} <= set(OPTION.findall(text))


def test_the_short_help_of_run_has_fifteen_options_and_an_example(shown):
    text = shown("run", "--help")
    assert len(OPTION.findall(text)) <= 15
    for flag in ("--out", "--calibration", "--everyone", "--min-confidence", "--workers", "--markers"):
        assert flag in text
    assert text.count("Example:") == 1 and "    muybridge run " in text
    assert "--smooth.method" not in text and "marker-video" not in text


def test_the_long_help_is_grouped_by_stage(shown):
    text = shown("run", "--help-all")
    groups = re.findall(r"^[╭─ ]*([a-z.-]+) options[─╮ ]*$", text, re.M)
    stages = ["session", "detect", "tracking", "flips", "triangulate", "view-bias", "smooth", "fit", "refinement"]
    assert set(stages) < set(groups) and len(groups) == len(set(groups))
    for flag in ("--triangulate.min-views", "--tracking.gate", "--flips.prior", "--no-view-bias", "--smooth.method"):
        assert flag in text
    for gone in ("fit.clean", "flips.parts", "marker-video", "--person", "odd-view"):
        assert gone not in text
    diagnosis = shown("calibrate check", "--help-all")
    assert "--max-shift" in diagnosis and "min-effect" not in diagnosis and "farthest" not in diagnosis


def test_an_option_of_python_alone_is_refused_on_the_command_line(capsys):
    assert dataclasses.fields(RunOptions().solve.fit.clean)
    with pytest.raises(SystemExit) as stopped:
        app.main(["run", "somewhere", "--fit.clean.passes", "2"])
    assert stopped.value.code == 2 and "fit.clean.passes" in capsys.readouterr().err


def test_options_reach_the_command():
    command = app.find_commands()["run"].load()
    words = ["a", "b", "--out", "c", "--cameras", "x", "y", "--tracking.gate", "0.2", "--no-view-bias", "-vv", "-q",
             "--keypoints.onnx.no-flip", "--everyone"]  # fmt: skip
    call = parsing.parse(command, "run", words)
    found = call.arguments["options"]
    assert [str(p) for p in (*call.arguments["sessions"], call.arguments["out"])] == ["a", "b", "c"]
    assert found.session.cameras == ("x", "y") and found.solve.tracking.gate == 0.2 and found.solve.everyone
    assert not found.solve.view_bias.enabled and found.detect.keypoints.onnx.flip is False
    assert (call.console.verbose, call.console.quiet) == (2, True)
    assert parsing.parse(command, "run", ["a"]).arguments["options"] == RunOptions()


def test_common_options_exist():
    for name, entry in app.find_commands().items():
        common = getattr(importlib.import_module(entry.module), "COMMON_OPTIONS", {}).get(entry.attr, ())
        parser = parsing.parser_of(entry.load(), name)
        subs = [p for a in parser._actions if isinstance(a.choices, dict) for p in a.choices.values()]
        known = {a.dest.split(".")[-1].replace("-", "_") for p in (parser, *subs) for a in p._actions}
        assert set(common) <= known, name


def options_classes():
    """Every class of options by name; two may share one."""
    found: dict[str, list[type]] = {}
    for package in ("geometry", "infer", "motion"):
        path = importlib.import_module(f"muybridge.{package}").__path__
        for module in pkgutil.walk_packages(path, f"muybridge.{package}."):
            for name, kind in vars(importlib.import_module(module.name)).items():
                if dataclasses.is_dataclass(kind) and isinstance(kind, type):
                    found.setdefault(name, []).append(kind)
    return found


def test_the_table_of_options_names_classes_and_fields_that_exist():
    classes = options_classes()
    pairs = [(name, field) for name, fields in options.COMMAND_LINE.items() for field in fields]
    pairs += [tuple(key.split(".")) for key in (*options.METAVARS, *options.NAMES)]
    for name, field in pairs:
        assert any(field in kind.__dataclass_fields__ for kind in classes[name]), (name, field)
    assert options.WITHOUT_PREFIX <= set(classes)


def test_a_docstring_becomes_help():
    def command(path: str, /, detect: DetectOptions = DetectOptions()) -> None:  # noqa: B008
        """First line.

        A paragraph
        of two lines.

        Example:
            muybridge try

        Args:
            path: a text of
                two lines: joined.
            detect: how.

        Raises:
            Nothing: ever.
        """

    assert parsing.description(command) == "First line.\n\nA paragraph of two lines.\n\nExample:\n    muybridge try"
    assert parsing._sections(command)[1] == {"path": "a text of two lines: joined.", "detect": "how."}
    assert muybridge.__version__
