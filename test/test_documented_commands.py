"""Commands as the pages and the help texts have them: their own parsers take them."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest

from horizon_sensor_ros.sim.hard_scenes import hard_scenes

ROOT = Path(__file__).parents[1]
PACKAGE = "horizon_sensor_ros"
COMMANDS = dict(re.findall(r'"(\w+)": "((?:ros|tools)\.[\w.]+)"', (ROOT / "setup.py").read_text()))
TOOLS = {name: module for name, module in COMMANDS.items() if module.startswith("tools.")}
PAGES = [*sorted((ROOT / "doc").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
by_page = pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
# Options that pages name of other people's programs.
FOREIGN = {"--help", "--clock"}
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")


class _Parser(Exception):  # noqa: N818 - carries one out of the script that makes it
    pass


@pytest.fixture
def parsers(
    modules_of_the_benchmark: None, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], argparse.ArgumentParser]:
    """Gives the parser of a command, or of the benchmark `run.py`."""

    def caught(parser: argparse.ArgumentParser, *_: object) -> None:
        raise _Parser(parser)

    def parser_of(name: str) -> argparse.ArgumentParser:
        if name in TOOLS:
            parser = import_module(f"{PACKAGE}.{TOOLS[name]}")._parser()
        else:
            assert name == "run.py", f"no command {name}"
            run = import_module("run")
            with monkeypatch.context() as patch:
                patch.setattr(argparse.ArgumentParser, "parse_args", caught)
                with pytest.raises(_Parser) as made:
                    run.main([])
            parser = made.value.args[0]
        parser.allow_abbrev = False
        return parser

    return parser_of


def parse(parser: argparse.ArgumentParser, words: list[str]) -> argparse.Namespace:
    try:
        return parser.parse_args(words)
    except SystemExit:  # the parser's own words are on stderr
        pytest.fail(f"{parser.prog} does not take: {' '.join(words)}")


def blocks(text: str) -> Iterator[str]:
    """Commands of ours in a page's indented blocks, each in one line and without its comment."""
    block = "\n".join(line[4:] for line in text.splitlines() if line.startswith("    "))
    for line in block.replace("\\\n", "").splitlines():
        command = re.split(r"\s{2,}#", line)[0].strip().removeprefix(".venv/bin/")
        if re.match(r"(?:horizon_\w+|python benchmarks/\w+\.py)\b", command):
            yield command.removeprefix("python ")


def spans(text: str) -> Iterator[str]:
    """What a page has between backticks."""
    plain = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    yield from re.findall(r"`([^`]+)`", " ".join(plain.split()))


def named(text: str) -> Iterator[list[str]]:
    """Words of the spans that call a command: its name, and what follows."""
    parts = import_module("run").PARTS
    for span in spans(text):
        bare = re.sub(r"^(?:\.venv/bin/)?(?:python )?(?:benchmarks/)?", "", span)
        name, *words = bare.split()
        if name in parts and words:
            yield ["run.py", "--only", name, *words]
        elif name == "--only" and words:
            yield ["run.py", *bare.split()]
        elif name in {"run.py", *TOOLS} or re.match(r"horizon_\w+ .*--", bare):
            yield [name, *words]


def test_what_is_looked_for_is_found(modules_of_the_benchmark: None) -> None:
    text = "\n\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert len(list(blocks(text))) >= 10
    found = list(named(text))
    assert sum(words[0] == "run.py" for words in found) > 25
    assert sum(words[0] in TOOLS and len(words) > 1 for words in found) > 5


@by_page
def test_commands_of_a_pages_blocks_are_taken(
    page: Path, parsers: Callable[[str], argparse.ArgumentParser]
) -> None:
    for command in blocks(page.read_text(encoding="utf-8")):
        name, *words = shlex.split(command)
        parse(parsers(name), words)


@by_page
def test_commands_in_a_pages_sentences_are_taken(
    page: Path, parsers: Callable[[str], argparse.ArgumentParser]
) -> None:
    for name, *words in named(page.read_text(encoding="utf-8")):
        parser = parsers(name)
        for action in parser._actions:  # what is required, a sentence may leave out
            action.required = False
        values = [word for word in words if word != "NAME"]
        if values[-1:] == ["--only"] or values[-1:] == ["--params"]:
            assert values.pop() in OPTION.findall(parser.format_help())
        found = parse(parser, values)
        if name == "run.py" and found.kinds:
            hard_scenes(0, kinds=tuple(found.kinds))  # raises ValueError, which names them


@by_page
def test_options_that_a_page_names_are_some_commands(
    page: Path, parsers: Callable[[str], argparse.ArgumentParser]
) -> None:
    known = set(FOREIGN)
    for name in (*TOOLS, "run.py"):
        known.update(OPTION.findall(parsers(name).format_help()))
    for span in spans(page.read_text(encoding="utf-8")):
        if span.startswith("--"):
            assert set(OPTION.findall(span)) <= known, span


@pytest.mark.parametrize("name", sorted(TOOLS))
def test_examples_of_a_help_text_are_taken(
    name: str, parsers: Callable[[str], argparse.ArgumentParser]
) -> None:
    text = parsers(name).format_help().replace("\\\n", "")
    _, _, examples = re.split("(example)", text, maxsplit=1, flags=re.IGNORECASE)
    found = re.findall(r"(?:^ +|^s?: +)(horizon_\w+)\b([^;\n]*)", examples, re.M)
    assert name in {command for command, _ in found}
    for command, words in found:
        parse(parsers(command), shlex.split(words))


@by_page
def test_makes_targets_of_a_page_exist(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    text = page.read_text(encoding="utf-8")
    assert set(re.findall(r"(?:`|^    )make ([a-z-]+)", text, re.M)) <= targets


@by_page
def test_scripts_of_a_page_exist(page: Path) -> None:
    for script in re.findall(
        r"\b(?:benchmarks|doc)/[\w/]+\.py\b", page.read_text(encoding="utf-8")
    ):
        assert (ROOT / script).is_file(), script
