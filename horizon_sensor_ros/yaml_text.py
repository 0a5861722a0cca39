"""YAML that people write: read, or refused with an error of one kind."""

from __future__ import annotations

from typing import Any

import yaml


def load_yaml(text: str) -> Any:
    """Return what a YAML text holds, plain values only.

    Raises yaml.YAMLError for what is no YAML, nests too deeply, holds values that are none of their
    tag (PyYAML's own constructors then raise errors of any kind), or has aliases, with which a
    short text holds any amount.
    """
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader)):
            raise yaml.YAMLError("it has YAML aliases, which these files cannot have")
        return yaml.safe_load(text)
    except yaml.YAMLError:
        raise
    except RecursionError:
        raise yaml.YAMLError("it nests too deeply") from None
    except (ValueError, KeyError, AttributeError, IndexError, TypeError) as error:
        raise yaml.YAMLError(f"a value is none of its tag: {error}") from None
