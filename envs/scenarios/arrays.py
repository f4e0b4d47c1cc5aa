"""A single .npy array, read so that a damaged file is an error of one line and nothing in it is executed."""

import tokenize

import numpy as np
from numpy.typing import NDArray

from wayfield.system.objects import check_ordinary

# what NumPy raises at a damaged head; the last of its repair of heads that Python 2 wrote
_DAMAGED = (
    ValueError, SyntaxError, EOFError, LookupError, TypeError, OverflowError, MemoryError, tokenize.TokenError
)  # fmt: skip


def stored_array(file: str) -> NDArray[np.generic]:
    """Returns the array of a .npy file, of whatever type and shape, mapped and not read.

    So what the head promises takes no memory before the caller has checked it.

    Raises:
        ValueError: if it is no such file; the message does not name it.
        OSError: if it cannot be opened.
    """
    check_ordinary(file, "is no .npy file of an array: it")
    try:
        stored = np.load(file, mmap_mode="r", allow_pickle=False)
    except _DAMAGED as error:
        if "pickle" in str(error) or "Python objects" in str(error):
            raise ValueError("is no .npy file of an array: it holds pickled objects, which are not loaded") from None
        raise ValueError(f"is no .npy file of an array: {' '.join(str(error).split())[:200]}") from None
    if not isinstance(stored, np.ndarray):
        stored.close()
        raise ValueError("is no .npy file of an array: it is an archive")
    return stored
