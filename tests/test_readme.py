"""What the README says can be done as it stands there."""

import re
from pathlib import Path


def _blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.S)


def test_commands_exist(repository: Path) -> None:
    makefile = (repository / "Makefile").read_text()
    shell = "\n".join(_blocks(repository / "README.md", "sh"))
    targets = re.findall(r"^make ([\w-]+)", shell, re.M)
    assert targets[:2] == ["demo", "test"]
    for target in [*targets, *re.findall(r"`make ([\w-]+)`", (repository / "README.md").read_text())]:
        assert re.search(rf"^{target}:", makefile, re.M), target
    registered = (repository / "pyproject.toml").read_text()
    commands = re.findall(r"muybridge ([a-z]\w+)", "\n".join(_blocks(repository / "README.md", "powershell")))
    commands += re.findall(r"`muybridge ([a-z]\w+)[^`]*`", (repository / "README.md").read_text())
    assert {"demo", "run", "train"} <= set(commands)
    for command in commands:
        assert re.search(rf'^{command} = "muybridge\.', registered, re.M), command


def test_the_citation_is_of_this_version(repository: Path) -> None:
    import muybridge

    assert f"version: {muybridge.__version__}" in (repository / "CITATION.cff").read_text()
