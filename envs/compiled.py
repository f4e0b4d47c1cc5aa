"""How every kernel of the project is compiled."""

import functools
import pathlib
from typing import Any

import numba


@functools.cache
def _sources(folder: pathlib.Path) -> tuple[tuple[str, int, int], ...]:
    """Returns what tells whether a source file of the folder has changed."""
    return tuple((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(folder.glob("*.py")))


def compiled(function: Any) -> Any:
    """Compiles a scalar function of one robot, or a loop over robots, to machine code, and caches it on disk.

    IEEE arithmetic as it is written, without fastmath: a lone robot, a batch, and another day give the same bits.
    """
    return _cached(numba.njit(cache=True, error_model="numpy")(function))


def inlined(function: Any) -> Any:
    """Compiles like `compiled` and puts the code in place of each call: arrays are expensive arguments."""
    return _cached(numba.njit(cache=True, error_model="numpy", forceinline=True)(function))


def _cached(dispatcher: Any) -> Any:
    """Returns the dispatcher with a disk cache that is void once a source file has changed, of this folder or its own.

    Numba looks for changes in the file of a cached function alone, but a kernel holds the code of all it calls: without
    this a kernel could go on running what its neighbour files said before an update.
    """
    index = dispatcher._cache._cache_file
    folders = {pathlib.Path(__file__).parent, pathlib.Path(dispatcher.py_func.__code__.co_filename).parent}
    index._source_stamp = (index._source_stamp, *map(_sources, sorted(folders)))
    return dispatcher
