"""Why a command that reads or writes a bag does not do it, for a person."""

from __future__ import annotations


class BagError(Exception):
    """A bag, or what belongs with it, cannot be read or written; the message says which and why.

    exit_code : of a command that it ends.
    """

    exit_code = 1


class UsageError(BagError):
    """An option asks for what cannot be, whatever is in the files; the message says which."""

    exit_code = 2  # as of argparse


def in_one_line(error: Exception) -> str:
    """What an exception says; its kind where it says nothing."""
    return " ".join(str(error).split()) or type(error).__name__
