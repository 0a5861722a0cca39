"""YAML files that people write: read within bounds, and whatever is wrong said in one line."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

_MOST_BYTES = 1_000_000
# An integer of more is no number of a file's, and Python does not even write it out.
_MOST_BITS = 1000
_DEEPEST = 50  # collections in brackets, one in another; PyYAML takes a time that grows as a square
_SHOWN = 60


class YamlFileError(ValueError):
    """A file cannot be used; the message goes after the file's name."""


_MERGE = "tag:yaml.org,2002:merge"
_TOO_DEEP = "is not valid YAML: it is nested too deeply"


class _Loader(yaml.SafeLoader):
    """Takes 1e6 for a number, as ROS does; in YAML 1.1 it is a string. Raises YamlFileError where
    brackets are nested too deeply, or a key is there twice, of which PyYAML would take the last.
    """

    def fetch_flow_collection_start(self, token: type[yaml.Token]) -> None:
        if self.flow_level >= _DEEPEST:
            raise YamlFileError(_TOO_DEEP)
        super().fetch_flow_collection_start(token)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != _MERGE:
                if key.value in seen:
                    line = key.start_mark.line + 1
                    raise YamlFileError(f"has the key {shown(key.value)} twice (line {line})")
                seen.add(key.value)
        return super().construct_mapping(node, deep)

    def construct_bounded_int(self, node: yaml.ScalarNode) -> int:
        number = self.construct_yaml_int(node)
        if number.bit_length() > _MOST_BITS:
            raise ValueError("an integer has too many digits")
        return number


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_bounded_int)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$", re.ASCII),
    list("-+.0123456789"),
)


def yaml_events(text: str) -> Iterator[yaml.Event]:
    """Return a text's events as the parser of YAML finds them, before there are any values."""
    events: Iterator[yaml.Event] = yaml.parse(text, _Loader)
    return events


def _constructed(text: str) -> Any:
    loader = _Loader(text)
    try:
        return loader.get_single_data()
    finally:
        loader.dispose()


def read_yaml(path: Path, read: Callable[[str], Any] = _constructed) -> Any:
    """Return what a YAML file holds; None for nothing.

    read : what makes that of the file's text. Raises YamlFileError, which says in one line why it
    cannot be used.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise YamlFileError(f"cannot be read: {error.strerror}") from None
    if len(raw) > _MOST_BYTES:
        raise YamlFileError(f"is larger than {_MOST_BYTES} bytes")
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        raise YamlFileError("is not a text file in UTF-8") from None
    try:
        return read(text)
    except YamlFileError:
        raise
    except yaml.YAMLError as error:
        raise YamlFileError(f"is not valid YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise YamlFileError(_TOO_DEEP) from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # What PyYAML's constructors raise for text that is not what its tag or form says.
        words = " ".join(str(error).split())
        raise YamlFileError(f"is not valid YAML: a value is not of its kind ({words})") from None


def shown(value: Any) -> str:
    """Return a value as a message shows it: short, whatever it is."""
    try:
        text = _SHORT.repr(value)
    except ValueError:
        return "an integer of too many digits"
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 2 * _SHOWN
_SHORT.maxlist = _SHORT.maxdict = _SHORT.maxtuple = _SHORT.maxarray = 20
_SHORT.maxlevel = 3
