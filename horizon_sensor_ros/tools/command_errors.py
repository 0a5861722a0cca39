"""Why a command does not do what it was asked for, for a person."""

from __future__ import annotations


class CommandError(Exception):
    """What a command was asked for cannot be done, or a file cannot be read or written: the message
    says which and why.

    exit_code : of a command that it ends.
    """

    exit_code = 1


class UsageError(CommandError):
    """An option asks for what cannot be, whatever is in the files; the message says which."""

    exit_code = 2  # as of argparse


def in_one_line(error: Exception) -> str:
    """What an exception says; its kind where it says nothing."""
    return " ".join(str(error).split()) or type(error).__name__
