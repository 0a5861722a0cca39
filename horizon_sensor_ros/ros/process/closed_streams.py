"""Standard streams that a launcher has closed, or whose reader is gone.

Light: it is loaded before everything that takes time.
"""

from __future__ import annotations

import os


def open_closed_streams() -> None:
    """Open on nothing what is closed of input, output and errors: else a file or a socket gets its
    number, and with it what is printed there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def write_to_nothing(number: int) -> None:
    """Let what is written to a descriptor from now on be lost, what is held back included: it would
    fail again when the interpreter ends.
    """
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, number)
    os.close(nothing)
