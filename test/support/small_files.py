"""A full disk, as far as one can be had without the right to mount one."""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_larger_files(most_bytes: int) -> Iterator[None]:
    """Let this process fail to write files that are larger."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # Bytecode that is cut off at the limit would be read by whoever comes next.
    bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = bytecode
