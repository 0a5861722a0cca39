"""How this process's part of the DDS graph ends without waiting for itself.

Fast DDS, to end a participant, waits for the thread that hears of others, and where it was built
for old systems, as its wheels of PyPI are, it waits in a loop that keeps the lock which that thread
needs: on another core that one may not get it for minutes, or at all
(https://github.com/eProsima/Fast-DDS/issues/6513). On the same core the scheduler lets it go first.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_THREADS = "/proc/self/task"


@contextmanager
def on_one_core() -> Iterator[None]:
    """Keep all threads of this process to one core meanwhile; on systems but Linux, do nothing."""
    before = {}
    if os.path.isdir(_THREADS):
        core = min(os.sched_getaffinity(0))
        for thread in map(int, os.listdir(_THREADS)):
            # One that has ended meanwhile.
            with suppress(OSError):
                before[thread] = os.sched_getaffinity(thread)
                os.sched_setaffinity(thread, {core})
    try:
        yield
    finally:
        for thread, cores in before.items():
            with suppress(OSError):
                os.sched_setaffinity(thread, cores)
