"""Decoder of requests and encoder of replies: CBOR without tags, with limits, and nothing evaluated.

A compiled scan of the bytes comes first. It refuses messages outside the protocol and messages that take long to
decode, so that no message can block the server.
"""

import math
import pathlib
from typing import Any, NamedTuple

import cbor2
import numpy as np

from wayfield.bridges.coppelia import standstill
from wayfield.system.compiled import allocating
from wayfield.system.readers import reader

MAX_MESSAGE = 64 * 2**20  # bytes; libzmq closes the connection of a longer one
MAX_DEPTH = 32  # of arrays and maps in one another
MAX_ITEMS = 1_000_000  # of a request or a reply, the members of arrays and maps counted
MAX_TEXT = 2**20  # bytes of one text
MAX_UUID = 256  # characters
MAX_NAME = 256  # characters of a function's name

VERSION_MISMATCH = "The client ZeroMQ remote API version does not match CoppeliaSim's version"

_FAULTS = (
    "",
    "it ends before it is complete",
    "it holds more than it should after its end",
    f"arrays and maps in it are nested deeper than {MAX_DEPTH}",
    f"it holds more than {MAX_ITEMS:,} items",
    "it holds a tag",
    "it holds something of indefinite length",
    "it holds a value that is neither number, text, bytes, array, map, true, false nor null",
    "a map in it has a key that is no text",
    f"it holds a text of more than {MAX_TEXT:,} bytes",
    "it holds an integer below -2**63",
    "",  # a number that is not finite: the message names its place
)
_INCOMPLETE, _SURPLUS, _DEEP, _MANY, _TAG, _INDEFINITE, _SIMPLE, _KEY, _LONG, _LOW, _INFINITE = range(1, len(_FAULTS))


class Request(NamedTuple):
    """A call of a client."""

    uuid: str  # of the client
    func: str
    args: list[Any]
    timeout: float | None  # s, of silence, after which the client may be dropped; None: the default


class Refusal(ValueError):
    """A malformed message; `reply` is the answer to it."""

    def __init__(self, reply: dict[str, Any]) -> None:
        super().__init__(reply.get("err", reply.get("error")))
        self.reply = reply


@allocating
def scan(data):
    """Returns 0 when the bytes (n,) uint8 are one CBOR item within the limits, else the index of the fault."""
    left = np.empty(MAX_DEPTH + 1, np.int64)  # items that each open array or map still holds
    keyed = np.empty(MAX_DEPTH + 1, np.int64)  # whether it is a map
    depth = 0
    left[0] = 1
    keyed[0] = 0
    size = data.shape[0]
    at = 0
    items = 0
    infinite = False
    while depth >= 0:
        if left[depth] == 0:
            depth -= 1
            continue
        if at >= size:
            return _INCOMPLETE
        kind = data[at] >> 5
        short = data[at] & 31
        at += 1
        items += 1
        if items > MAX_ITEMS:
            return _MANY
        # what a map holds counts down from an even number: a key comes where it is even
        if keyed[depth] and left[depth] % 2 == 0 and kind != 3:
            return _KEY
        left[depth] -= 1
        if short > 27:
            return _INDEFINITE
        extra: Any = 0 if short < 24 else 1 << (short - 24)
        if at + extra > size:
            return _INCOMPLETE
        value: Any = np.uint64(short)
        if extra:
            value = np.uint64(0)
            for k in range(extra):
                value = (value << np.uint64(8)) | np.uint64(data[at + k])
            at += extra
        if kind == 1:
            if value > np.uint64(0x7FFFFFFFFFFFFFFF):
                return _LOW
        elif kind == 2 or kind == 3:
            if value > np.uint64(size - at):
                return _INCOMPLETE
            if kind == 3 and value > np.uint64(MAX_TEXT):
                return _LONG
            at += int(value)
        elif kind == 4 or kind == 5:
            if value > np.uint64(size - at):  # each item takes a byte at least
                return _INCOMPLETE
            depth += 1
            if depth > MAX_DEPTH:
                return _DEEP
            left[depth] = np.int64(value) * (2 if kind == 5 else 1)
            keyed[depth] = 1 if kind == 5 else 0
        elif kind == 6:
            return _TAG
        elif kind == 7:
            if extra == 8:
                if (value >> np.uint64(52)) & np.uint64(0x7FF) == np.uint64(0x7FF):
                    infinite = True
            elif extra == 4:
                if (value >> np.uint64(23)) & np.uint64(0xFF) == np.uint64(0xFF):
                    infinite = True
            elif extra == 2:
                if (value >> np.uint64(10)) & np.uint64(0x1F) == np.uint64(0x1F):
                    infinite = True
            elif extra == 1 or short < 20 or short > 22:
                return _SIMPLE
    if at < size:
        return _SURPLUS
    return _INFINITE if infinite else 0


def _sample_request(folder: pathlib.Path) -> None:
    args = ["/p3dx", 1.5, [1, {"name": b"\0\1"}]]
    message = {"uuid": "a", "ver": 2, "lang": "python", "func": "sim.getObject", "args": args, "timeout": 1.0}
    (folder / "request.cbor").write_bytes(cbor2.dumps(message))


def _request_of_file(function: Any, file: pathlib.Path) -> Request:
    try:
        request: Request = function(file.read_bytes())
    except Refusal as error:
        raise ValueError(f"{file}: {error}") from None
    return request


@reader("request over ZeroMQ", "request.cbor", _sample_request, _request_of_file)
def request_of(payload: bytes) -> Request:
    """Returns the request in a message.

    Raises:
        Refusal: if the message is malformed; its text is one line.
    """
    fault = scan(np.frombuffer(payload, np.uint8))
    if fault not in (0, _INFINITE):
        raise _refusal(f"request refused: the message is no CBOR of this protocol: {_FAULTS[fault]}")
    try:
        message = cbor2.loads(payload)
    except (cbor2.CBORDecodeError, ValueError) as error:  # text that is no UTF-8
        raise _refusal(f"request refused: the message is no CBOR of this protocol: {one_line(error)}") from None
    if not isinstance(message, dict):
        raise _refusal("request refused: the message is no map")
    uuid, func, args, timeout = message.get("uuid"), message.get("func"), message.get("args"), message.get("timeout")
    if uuid is None:
        raise Refusal({"success": False, "error": VERSION_MISMATCH})
    if not isinstance(uuid, str) or not 0 < len(uuid) <= MAX_UUID:
        raise _refusal(f"request refused: uuid must be a text of 1 to {MAX_UUID} characters")
    if "eval" in message:
        raise _refusal("request refused: nothing is evaluated here; ask for a function by func")
    if not isinstance(func, str) or not 0 < len(func) <= MAX_NAME:
        raise _refusal(f"request refused: func must be a text of 1 to {MAX_NAME} characters")
    if args is None:
        args = []
    if not isinstance(args, list):
        raise _refusal("request refused: args must be an array")
    if fault:
        place = next((i for i, value in enumerate(args) if not _finite(value)), None)
        where = "the request" if place is None else f"argument {place + 1}"
        raise _refusal(f"in {one_line(func)}: {where} holds a number that is not finite; every number must be")
    if timeout is not None and (
        isinstance(timeout, bool) or not isinstance(timeout, int | float) or not 0 < timeout < 1e9
    ):
        timeout = None
    return Request(uuid, func, args, timeout)


def encoded(reply: dict[str, Any]) -> bytes:
    """Returns the bytes of a reply; a reply that is too long or not encodable becomes an error."""
    try:
        payload = standstill.encoded(reply)
    except (cbor2.CBOREncodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
        return bytes(cbor2.dumps({"err": f"the reply cannot be encoded: {one_line(error)}"}))
    if len(payload) > MAX_MESSAGE:
        return bytes(cbor2.dumps({"err": f"the reply would have {len(payload):,} bytes; {MAX_MESSAGE:,} is the most"}))
    return payload


def one_line(text: object, longest: int = 200) -> str:
    """Returns a text on one line and cut to a length, for messages and the log."""
    line = " ".join(str(text).split())
    line = "".join(c if c.isprintable() else "?" for c in line)
    return line if len(line) <= longest else line[: longest - 1] + "…"


def _finite(value: Any) -> bool:
    if isinstance(value, list | dict):
        return all(map(_finite, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, float) or math.isfinite(value)


def _refusal(text: str) -> Refusal:
    return Refusal({"err": text})
