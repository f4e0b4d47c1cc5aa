"""Files that may be damaged: what is read of them, or the one line that says what is wrong with which."""

import json
import pathlib
import stat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.system.checks import shown, unread
from wayfield.system.objects import without_repeats

MOST_TEXT = 2**24  # bytes of a file of text; those that are written here have a few thousand
MOST_NUMBERS = 2**31  # bytes of a file of arrays


def read_bytes(file: pathlib.Path, most: int) -> bytes:
    """Returns the content of a file of at most so many bytes; the size is looked at before memory is taken.

    Raises:
        ValueError: naming the file, if it is missing, no regular file or too large.
    """
    try:
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            raise ValueError(f"{file} cannot be read: it is no file")
        if status.st_size > most:
            raise ValueError(f"{file} has {status.st_size} bytes; at most {most} can be right")
        return file.read_bytes()
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {unread(file, error)}") from None


def read_object(file: pathlib.Path) -> dict[str, Any]:
    """Returns the JSON object of a file.

    Raises:
        ValueError: naming the file, if it cannot be read or holds something else.
    """
    return parsed_object(read_bytes(file, MOST_TEXT), str(file))


def parsed_object(content: bytes | str, source: str) -> dict[str, Any]:
    """Returns the object of a JSON text.

    Raises:
        ValueError: naming the source, if it is no such text.
    """
    try:
        text = content.decode("utf-8") if isinstance(content, bytes) else content
        parsed = json.loads(text, object_pairs_hook=without_repeats)
    except RecursionError:
        raise ValueError(f"{source} is no JSON that can be read: it is nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{source} is no JSON: {error}") from None
    if not isinstance(parsed, dict):
        raise ValueError(f"{source} holds {shown(parsed)}; it must be one object")
    return parsed


def read_arrays(file: pathlib.Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Returns the arrays of a safetensors file, and the texts that stand beside them.

    Raises:
        ValueError: naming the file, if it cannot be read or is damaged.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    content = read_bytes(file, MOST_NUMBERS)
    try:
        arrays = dict(load(content))  # checks the header's sizes against the file's
        header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
        return arrays, dict(header.get("__metadata__", {}))
    except (SafetensorError, ValueError, KeyError, TypeError, ArithmeticError, RecursionError, MemoryError) as error:
        problem = " ".join(str(error).split())[:200]  # it may quote the header
        raise ValueError(f"{file} is damaged or no safetensors file: {problem}") from None


def is_whole(value: object, least: int, most: int) -> bool:
    """Returns whether a value is a whole number in a range."""
    return type(value) is int and least <= value <= most


def is_number(value: object) -> bool:
    """Returns whether a value is a plain number that a double holds."""
    if type(value) is int:
        return -(2**63) <= value < 2**63
    return type(value) is float and bool(np.isfinite(value))
