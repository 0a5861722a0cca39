"""What is told of a defect of this package that did not end the process."""

from __future__ import annotations

from pathlib import Path
from traceback import walk_tb

_PACKAGE = Path(__file__).parents[2]


def words_of(error: BaseException) -> str:
    """Return an error's type and message, and the innermost line of this package that it passed:
    "IndexError: index 5 is out of bounds at core/limb/detector.py:108".

    Without the line where it never was in this package.
    """
    passed = [(Path(f.f_code.co_filename), line) for f, line in walk_tb(error.__traceback__)]
    ours = [(path, line) for path, line in passed if path.is_relative_to(_PACKAGE)]
    # Those of OpenCV end in a line's end.
    words = f"{type(error).__name__}: {' '.join(str(error).split())}"
    if not ours:
        return words
    path, line = ours[-1]
    return f"{words} at {path.relative_to(_PACKAGE).as_posix()}:{line}"
