"""The functions that read files from disk, each with a good file: what `tests/faults` damages.

A function that opens a file to read it carries `@reader`; a test holds that none is forgotten.
"""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])
Sample = Mapping[str, str] | Callable[[Path], None]


@dataclasses.dataclass(frozen=True)
class Reader:
    """A kind of file, the function that reads it, and how to make a good one."""

    name: str
    file: str  # its name in the sample's folder
    sample: Sample  # texts by file name, or a function that fills an empty folder
    read: Callable[[Path], Any]

    def fill(self, folder: Path) -> Path:
        """Writes the sample into an empty folder; returns the file that this reader reads."""
        if callable(self.sample):
            self.sample(folder)
        else:
            for name, text in self.sample.items():
                (folder / name).write_text(text, encoding="utf-8")
        return folder / self.file


READERS: dict[str, Reader] = {}


def reader(
    name: str, file: str, sample: Sample, call: Callable[[Callable[..., Any], Path], Any] | None = None
) -> Callable[[Function], Function]:
    """Registers a function that reads a file; the function stays as it is.

    Args:
        name: of the kind of file; a function that reads several kinds is registered once for each.
        file: a name that such a file may have.
        sample: a good file, with all that lies beside it.
        call: calls the function for a file; by default with the file's path as text.
    """

    def register(function: Function) -> Function:
        def read(path: Path) -> Any:
            return function(str(path)) if call is None else call(function, path)

        READERS[name] = Reader(name, file, sample, read)
        return function

    return register


def of_folder(function: Callable[..., Any], file: Path) -> Any:
    """Calls a reader that takes the folder of its file."""
    return function(file.parent)


def of_path(function: Callable[..., Any], file: Path) -> Any:
    """Calls a reader that takes a Path."""
    return function(file)
