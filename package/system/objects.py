"""Text files of the user's and the JSON objects in them; what is wrong with one is a line that begins with the file."""

import json
import os
from collections.abc import Iterable
from typing import Any, NoReturn

from wayfield.system.checks import MOST_BYTES, repeated, shown, suggestion, unread


class FileNote(UserWarning):
    """What was taken for granted of a user's file, argument or gain; workers, which read it again, leave it unsaid."""


def read_text(file: str) -> str:
    """Returns the text of a UTF-8 file, without its byte order mark.

    Raises:
        ValueError: if it is no ordinary file or no UTF-8; one line that starts with file:line.
        OSError: if it cannot be opened.
    """
    check_ordinary(file, f"{file}:1:")
    with open(file, "rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > MOST_BYTES:
            raise ValueError(f"{file}:1: holds more than {MOST_BYTES} bytes; it must be smaller")
        content = stream.read(size)  # a bound alone would be taken as memory at once
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(
            f"{file}:{line}: byte {content[error.start]:#04x} is no UTF-8; it must be text, saved as UTF-8"
        ) from None
    return text


def state_of(file: str | os.PathLike[str]) -> tuple[str, int, int, int, int]:
    """Returns what is another once a file has been changed: its name, inode, size, and times to the nanosecond.

    The time of the last change of any kind is among them, which a program cannot set back as it can the other one.

    Raises:
        OSError: if there is no such file.
    """
    status = os.stat(file)
    return str(file), status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def check_ordinary(file: str | os.PathLike[str], named: str) -> None:
    """Raises ValueError, which begins with the name, for a folder, and for a pipe or a device, which may never end.

    Raises FileNotFoundError, with the whole path, where there is nothing.
    """
    if not os.path.exists(file):
        raise FileNotFoundError(unread(file, FileNotFoundError()))
    if os.path.exists(file) and not os.path.isfile(file):
        raise ValueError(f"{named} is a folder or a device; it must be a file")


def check_keys(
    file: str, place: str, fields: dict[str, Any], known: Iterable[str], required: Iterable[str] = ()
) -> None:
    """Raises ValueError, naming file and field, for a field that nothing reads, or for one that is missing."""
    for key in fields:
        if key not in known:
            near = suggestion(key, known)
            raise fault(file, f"field {shown(place + key)} is not known; the fields are {', '.join(known)}.{near}")
    for key in required:
        if key not in fields:
            raise fault(file, f"field {place + key!r} is missing")


def json_object(file: str, of_list: str = "") -> dict[str, Any]:
    """Returns the one object of a JSON file; of a file that holds a list, an object with it as the field `of_list`.

    Raises:
        ValueError: if it holds no such object; one line that starts with the file.
        OSError: if it cannot be opened.
    """
    try:
        content = json.loads(
            read_text(file), object_pairs_hook=without_repeats, parse_constant=_not_json, parse_int=_whole
        )
    except json.JSONDecodeError as error:
        raise ValueError(f"{file}:{error.lineno}: {error.msg}") from None
    except RecursionError:
        raise fault(file, "is nested too deeply") from None
    except MemoryError:
        raise fault(file, "is too large for this machine's memory") from None
    except ValueError as error:
        raise fault(file, error) from None
    if of_list and isinstance(content, list):
        return {of_list: content}
    if not isinstance(content, dict):
        raise fault(file, f"holds {shown(content)}; it must be one object {{...}}")
    return content


def without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Returns the object of the pairs; JSON itself would keep only the last of two fields of one name."""
    fields = dict(pairs)
    if len(fields) < len(pairs):
        raise ValueError(f"field {shown(repeated(name for name, _ in pairs))} is given twice")
    return fields


def _whole(digits: str) -> int:
    """Returns the whole number of the digits; Python itself refuses more than some thousands, with a riddle."""
    if len(digits) > 400:
        raise ValueError(f"{digits[:20]}... is a number of {len(digits)} digits; no field takes one so large")
    return int(digits)


def _not_json(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not a number of JSON; every number must be finite")


def fault(file: str, problem: object) -> ValueError:
    """Returns the error with the file in front, unless it is there already, with the line."""
    text = str(problem)
    return ValueError(text if text.startswith(f"{file}:") else f"{file}: {text}")
