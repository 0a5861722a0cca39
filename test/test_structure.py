"""How the package is laid out: what its folders say is in them, and which way imports go."""

from __future__ import annotations

import ast
import dataclasses
import re
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "horizon_sensor_ros"
FOLDERS = sorted(path.parent for path in ROOT.rglob("__init__.py"))
BENCHMARKS = ROOT.parent / "benchmarks"
PARTS = sorted(path.parent for path in BENCHMARKS.rglob("__init__.py"))
# What files of a folder may import of the others.
MAY_IMPORT = {
    "core": {"core"},
    "sim": {"core", "sim"},
    "ros": {"core", "ros"},
    "tools": {"core", "sim", "ros", "tools"},
}
LONGEST_FUNCTION = 60


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Modules of the package that a file imports, wherever in it."""
    return frozenset(
        node.module
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        and node.module is not None
        and node.module.startswith(f"{ROOT.name}.")
    )


def inside(folder: Path) -> Iterator[Path]:
    """Its modules, and the folders of modules in it."""
    for path in folder.iterdir():
        if (path.suffix == ".py" and path.stem != "__init__") or (path / "__init__.py").is_file():
            yield path


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")


@pytest.mark.parametrize(
    "folder", [*FOLDERS, *PARTS], ids=lambda path: path.relative_to(ROOT.parent).as_posix()
)
def test_a_folder_names_what_is_in_it(folder: Path) -> None:
    said = ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or ""
    named = re.findall(r"``(\w+)``", said)
    assert len(named) == len(set(named))
    assert set(named) == {path.stem for path in inside(folder)}


def test_the_page_of_the_benchmarks_names_what_is_in_their_folder() -> None:
    rows = re.findall(r"^\| `([\w.]+)` \|", (BENCHMARKS / "README.md").read_text(), re.M)
    assert len(rows) == len(set(rows))
    assert set(rows) == {path.name for path in inside(BENCHMARKS)}


@pytest.mark.parametrize("floor", MAY_IMPORT)
def test_tests_lie_as_the_code_does(floor: str) -> None:
    """Beside them, in `scenarios`, what is of many files of a folder."""
    tests = Path(__file__).parent
    files = list((tests / floor).rglob("test_*.py"))
    assert files
    for path in files:
        folder = path.parent.relative_to(tests)
        own = folder.parent if folder.name == "scenarios" else folder
        assert (ROOT / own / "__init__.py").is_file(), path


@pytest.mark.parametrize("floor", MAY_IMPORT)
def test_imports_go_one_way(floor: str) -> None:
    files = list((ROOT / floor).rglob("*.py"))
    assert files
    for path in files:
        for module in imports_of(path):
            assert module.split(".")[1] in MAY_IMPORT[floor], f"{path} imports {module}"


def test_no_files_import_each_other_in_a_circle() -> None:
    graph = {module_of(path): imports_of(path) for path in ROOT.rglob("*.py")}
    assert frozenset().union(*graph.values()) <= graph.keys()
    TopologicalSorter(graph).prepare()  # raises CycleError, which names them


@pytest.mark.parametrize(
    "house", FOLDERS, ids=lambda path: path.relative_to(ROOT.parent).as_posix()
)
def test_no_rooms_of_a_folder_import_each_other_in_a_circle(house: Path) -> None:
    """Its rooms are its folders, and the files that lie in none of these."""
    here = f"{module_of(house)}."
    graph: dict[str, set[str]] = {}
    for path in house.rglob("*.py"):
        if path.parent != house or path.name != "__init__.py":
            room = module_of(path).removeprefix(here).split(".")[0]
            used = [module for module in imports_of(path) if module.startswith(here)]
            rooms = {module.removeprefix(here).split(".")[0] for module in used}
            graph.setdefault(room, set()).update(rooms - {room})
    TopologicalSorter(graph).prepare()  # raises CycleError, which names them


@pytest.mark.parametrize("floor", MAY_IMPORT)
def test_no_function_is_longer_than_a_page(floor: str) -> None:
    """From `def` to its end, what its docstring says included."""
    longer = {
        f"{module_of(path)}.{node.name}": lines
        for path in (ROOT / floor).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (lines := (node.end_lineno or 0) - node.lineno + 1) > LONGEST_FUNCTION
    }
    assert longer == {}


def test_what_holds_arrays_is_compared_by_identity() -> None:
    """Compared field by field it would raise: an array has no truth value."""
    of_arrays = [
        each
        for module in sorted(map(module_of, (ROOT / "core").rglob("*.py")))
        for each in vars(import_module(module)).values()
        if dataclasses.is_dataclass(each)
        and getattr(each, "__module__", "") == module
        and any("ndarray" in str(field.type) for field in dataclasses.fields(each))
    ]
    assert len(of_arrays) > 50
    assert [each for each in of_arrays if "__eq__" in vars(each)] == []
