"""Whatever README and docs tell people to type runs: every Python block, every shell line; commands in running text parse."""

import re
import shlex
import shutil
from importlib import util
from pathlib import Path

import click
import pytest
import typer
from typer.testing import CliRunner

from whiskjax.app.command_line import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "examples" / "README.md"]
TARGETS = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))

PYTHON = {str(page.relative_to(ROOT)): re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL) for page in PAGES}
SHELL = {
    str(page.relative_to(ROOT)): [
        line for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.DOTALL) for line in block.splitlines()
    ]
    for page in PAGES
}
# Each block of the README is complete; a page's blocks follow each other.
RUNS = [(f"README.md, block {i}", [block]) for i, block in enumerate(PYTHON["README.md"])]
RUNS += [(name, blocks) for name, blocks in PYTHON.items() if blocks and name != "README.md"]


@pytest.fixture
def beside_examples(tmp_path, monkeypatch):
    """A working folder that holds what the pages take for granted: examples/."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WHISKJAX_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.mark.parametrize(("name", "blocks"), RUNS, ids=[name for name, _ in RUNS])
def test_python_blocks_run(name, blocks, beside_examples, capsys):
    namespace = {"__name__": "__main__"}
    for i, block in enumerate(blocks):
        exec(compile(block, f"{name}[{i}]", "exec"), namespace)
    told = capsys.readouterr().out
    if name.startswith("README.md"):
        assert told.startswith("True"), f"the first use that people try is not sound:\n{told}"


def _words(line: str) -> list[str]:
    return shlex.split(line, comments=True)


@pytest.mark.parametrize("page", [name for name, lines in SHELL.items() if lines])
def test_shell_lines_run(page, beside_examples):
    """In the order of the page, in one folder; `make` is what CI runs, and `pip` installs what `make demo` does."""
    ci = (ROOT / ".ci" / "run").read_text()
    makefile = (ROOT / "Makefile").read_text()
    for line in filter(None, map(str.strip, SHELL[page])):
        match _words(line):
            case []:
                continue
            case ["make", target, *_]:
                assert target in TARGETS and re.search(rf"\b{target}\b", ci), f"{line}: CI does not run it"
            case ["pip", "install", what]:
                assert f'"{what}"' in makefile, f"{line}: no target installs it"
            case ["whiskjax", *words]:
                answer = CliRunner().invoke(app, words)
                assert answer.exit_code == 0, f"{line}\n{answer.output}\n{answer.exception!r}"
            case _:
                pytest.fail(f"{page}: nobody tried this line: {line}")


def _inline() -> list[tuple[str, str]]:
    """Commands in running text, as (page, command)."""
    found = []
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        found += [(str(page.relative_to(ROOT)), code) for code in re.findall(r"`((?:whiskjax|make|python) [^`\n]+)`", text)]
    return found


@pytest.mark.parametrize(("page", "code"), _inline())
def test_commands_in_running_text_parse(page, code):
    words = _words(code)
    if words[0] == "make":
        assert words[1] in TARGETS
    elif words[:2] == ["python", "-m"]:
        assert util.find_spec(words[2]) is not None
    elif words[0] == "python":
        assert (ROOT / words[1]).is_file()
    else:
        command, context = typer.main.get_command(app), None
        words = words[1:]
        while isinstance(command, click.Group | typer.core.TyperGroup):
            assert words, f"{code}: which verb?"
            name, *words = words
            command, context = command.get_command(context, name), context
            assert command is not None, f"{code}: there is no {name}"
        known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        assert {word.split("=")[0] for word in words if word.startswith("--")} <= known


def test_pages_link_to_what_exists():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) < 150
