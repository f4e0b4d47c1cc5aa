"""Archives of arrays as runs keep them, read so that a damaged one is a line and nothing in it is executed."""

import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.system.checks import MOST_BYTES
from wayfield.system.unpacking import Piecewise, check_members

_SUFFIX = ".npy"
_DENSEST = 100  # times; numbers of a robot that moves, or whose clock runs on, are packed less densely


class Archive:
    """An .npz file that is open within a `with`; whatever is wrong with it there is a ValueError that names it.

    Raises:
        ValueError: on leaving the `with`, if the file is damaged or holds anything else; the message names file
            and array.
        OSError: on entering it, if the file cannot be opened.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._reading = ""  # the array

    def __enter__(self) -> "Archive":
        self._stream = open(self._file, "rb")
        try:
            self._members = zipfile.ZipFile(self._stream)
            packed = sum(each.compress_size for each in self._members.infolist())
            check_members(self._members, max(MOST_BYTES, _DENSEST * packed))
        except BaseException as error:
            self.__exit__(type(error), error)
            raise
        return self

    @property
    def names(self) -> list[str]:
        """Returns the names of the arrays."""
        return [name.removesuffix(_SUFFIX) for name in self._members.namelist()]

    def __getitem__(self, name: str) -> NDArray[Any]:
        self._reading = name
        with self._members.open(f"{name}{_SUFFIX}") as member:
            array: NDArray[Any] = np.lib.format.read_array(Piecewise(member), allow_pickle=False)
        if array.dtype.kind not in "fbiuV" or array.dtype.hasobject:
            raise ValueError(f"it holds {array.dtype}, not numbers")
        self._reading = ""
        return array

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        self._stream.close()
        if isinstance(error, (zipfile.BadZipFile, zlib.error, LookupError, TypeError, ValueError, EOFError, OSError)):
            problem = str(error)
        elif isinstance(
            error,
            # a header that asks for more than there is, an archive of another kind, a lone array;
            # the last: of NumPy's repair of headers of Python 2
            AttributeError | MemoryError | NotImplementedError | OverflowError | SyntaxError | RuntimeError
            | tokenize.TokenError,
        ):  # fmt: skip
            problem = f"{type(error).__name__} {error}"
        else:
            return
        where = f"{self._reading}: " if self._reading else ""
        raise ValueError(f"{self._file}: {where}the file is damaged: {' '.join(problem.split())[:200]}")
