"""Work that is killed at a chosen change of the disk."""

import os
import signal
from collections.abc import Callable
from typing import Any

import wayfield  # noqa: F401  registers the ids


def killed_at(count: int, work: Callable[[], Any]) -> bool:
    """Returns whether work in a process of its own was killed just before its count-th change of the disk."""
    child = os.fork()
    if child:
        return os.WIFSIGNALED(os.waitpid(child, 0)[1])
    left = count

    def counted(change: Any) -> Any:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal left
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left -= 1
            return change(*args, **kwargs)

        return call

    for name in ("replace", "rename", "fsync", "unlink", "mkdir", "rmdir", "chmod"):
        setattr(os, name, counted(getattr(os, name)))
    try:
        work()
    finally:
        os._exit(0)
