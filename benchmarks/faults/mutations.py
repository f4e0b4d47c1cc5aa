"""Damage: what disks, editors, other programs and ill will make of a good file."""

import gzip
import io
import json
import random
import warnings
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

_HOLE = "@HOLE@"
_DEEP = 100_000
# what may stand where JSON has a value, as raw text
HOSTILE = (
    "NaN", "Infinity", "-Infinity", "-0", "-0.0", "1e300", "-1e300", "1e160", "1e20", "1e400", "1" + "0" * 400,
    "9223372036854775808", "1e-320", "-1", "0", "0.5", "999999999", "null", "true", "false", '""', '"x"',
    '"\\ud800"', '"\\u0000"', '"../../../etc/passwd"', "[]", "{}", "[[]]", "[1, 2, 3]", "[1e20, 1e20, 1e20]",
    '{"a": 1}', "[" * _DEEP + "]" * _DEEP, '{"a":' * _DEEP + "1" + "}" * _DEEP, '"' + "x" * 1_000_000 + '"',
)  # fmt: skip
_CELLS = (
    "nan", "inf", "-inf", "1e20", "1e160", "1e300", "1e400", "1" + "0" * 400, "-1", "-0", "0", "", "x", '"', "\0",
    "0x10", "1_000", "\N{ARABIC-INDIC DIGIT ONE}", "1,5", " ", "x" * 200_000, "=1+1",
)  # fmt: skip


def damaged(content: bytes, name: str, rng: random.Random) -> bytes:
    """Returns a file's content after one to three mutations of those that fit its name."""
    fitting = list(_ANY)
    for suffix, more in _BY_SUFFIX.items():
        if name.endswith(suffix):
            fitting += more * 3  # bytes alone seldom get past a parser
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        try:
            content = rng.choice(fitting)(content, rng)
        except (
            ValueError, IndexError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error, OSError, EOFError
        ):  # fmt: skip
            content = _flip(content, rng)  # what is no such file any more has no values to change
    return content


def _flip(content: bytes, rng: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if content else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _truncate(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _repeat(content: bytes, rng: random.Random) -> bytes:
    a, b = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return content[:b] + content[a:b] * rng.choice((1, 2, 20)) + content[b:]


def _noise(content: bytes, rng: random.Random) -> bytes:
    a = rng.randrange(len(content) + 1)
    return content[:a] + rng.randbytes(rng.choice((1, 8, 200))) + content[a:]


def _fill(content: bytes, rng: random.Random) -> bytes:
    a, b = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    return content[:a] + rng.choice((b"\xff", b"\0", b"\x7f")) * (b - a) + content[b:]


def _whole(content: bytes, rng: random.Random) -> bytes:
    return rng.choice((b"", b"\0" * 100, rng.randbytes(1000), b"[" * _DEEP, b"null", b"{}", b"[]", b"\xff\xfe", b"\n"))


def _encoding(content: bytes, rng: random.Random) -> bytes:
    return rng.choice(
        (
            lambda: content.decode().encode("utf-16"),
            lambda: content.decode().encode("utf-32"),
            lambda: b"\xef\xbb\xbf" + content,
            lambda: content.replace(b"\n", b"\r\n"),
            lambda: content.replace(b"\n", b"\r"),
            lambda: content.replace(b"a", b"\xe4"),
            lambda: content + b"\0",
        )
    )()


def json_text(content: bytes, rng: random.Random) -> bytes:
    """Returns JSON with one value, key or member changed."""
    tree = json.loads(content)
    places = list(_places(tree))
    if not places:
        return rng.choice(HOSTILE).encode()
    owner, key = rng.choice(places)
    kind = rng.randrange(8)
    if kind == 0:
        del owner[key]
    elif kind == 1 and isinstance(owner, dict):
        owner[f"{key} "] = owner[key]
    elif kind == 2 and isinstance(owner, list):
        owner[:] = owner * rng.choice((2, 50))
    else:
        owner[key] = _HOLE
    text = json.dumps(tree)
    if kind == 3 and isinstance(owner, dict):
        text = text.replace(f'"{_HOLE}"', f"1, {json.dumps(key)}: 2", 1)
    return text.replace(f'"{_HOLE}"', rng.choice(HOSTILE), 1).encode()


def _places(tree: Any) -> Any:
    if isinstance(tree, dict | list):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _cell(content: bytes, rng: random.Random) -> bytes:
    """Returns a table with a cell changed, or a row or column gone or repeated."""
    rows = [line.split(",") for line in content.decode().splitlines()]
    kind = rng.randrange(8)
    if kind == 0:
        del rows[rng.randrange(len(rows))]
    elif kind == 1:
        rows.insert(rng.randrange(len(rows)), rng.choice(rows))
    elif kind == 2:
        column = rng.randrange(len(rows[0]))
        rows = [row[:column] + row[column + 1 :] for row in rows]
    else:
        row = rng.choice(rows)
        row[rng.randrange(len(row))] = rng.choice(_CELLS)
    return "\n".join(",".join(row) for row in rows).encode() + b"\n"


def _gzip(content: bytes, rng: random.Random) -> bytes:
    plain = gzip.decompress(content)
    if rng.random() < 0.05:
        return gzip.compress(plain + b"1,2,3,4\n" * 4_000_000, 1)
    return gzip.compress(rng.choice((_cell, _cell, _cell, _flip, _encoding))(plain, rng), 1)


def _safetensors(content: bytes, rng: random.Random) -> bytes:
    """Returns tensors with another header or other numbers."""
    length = int.from_bytes(content[:8], "little")
    header, data = content[8 : 8 + length], content[8 + length :]
    kind = rng.randrange(4)
    if kind == 0:
        return content[: 8 + length] + rng.choice((b"\xff", b"\0", b"\x7f")) * len(data)
    if kind == 1:
        return content[: 8 + length] + _flip(data, rng)
    tree = json.loads(header)
    inner = [name for name in tree.get("__metadata__", {}) if tree["__metadata__"][name].startswith("{")]
    if kind == 2 and inner:
        name = rng.choice(inner)
        tree["__metadata__"][name] = json_text(tree["__metadata__"][name].encode(), rng).decode()
        header = json.dumps(tree).encode()
    else:
        header = json_text(header, rng)
    claimed = len(header) if rng.random() < 0.9 else rng.choice((2**40, 2**63, 0, len(header) - 1))
    return claimed.to_bytes(8, "little") + header + data


def _npz(content: bytes, rng: random.Random) -> bytes:
    """Returns an archive with a member's header changed, a pickle in it, or a bomb."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = rng.choice(sorted(members))
    whole = members[name]
    kind = rng.randrange(6)
    if kind == 0:
        shape = rng.choice((b"(99999999999,)", b"(-1,)", b"(9223372036854775807, 9)", b"()", b"(0,)", b"(1, 1, 1)"))
        start, end = whole.index(b"'shape': ") + 9, whole.index(b")", whole.index(b"'shape'")) + 1
        members[name] = whole[:start] + shape + whole[end:]
    elif kind == 1:
        described = rng.choice((b"'|O'", b"'<M8'", b"'|S9'", b"'<c16'", b"'>f8'", b"[('a','<f8')]", b"'<f2'"))
        start = whole.index(b"'descr': ") + 9
        members[name] = whole[:start] + described + whole[whole.index(b",", start) :]
    elif kind == 2:
        # a pickle that runs a command when it is loaded
        members[name] = b"cos\nsystem\n(S'touch executed'\ntR."
    elif kind == 3:
        members[rng.choice(("x", "../x.npy", "a/b/c.npy", "00000/unknown.npy", ".npy"))] = whole
    elif kind == 4:
        del members[name]
    else:
        members[name] = rng.choice((_flip, _truncate, _fill))(whole, rng)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for each, data in members.items():
            archive.writestr(each, data)
    return buffer.getvalue()


def _model(content: bytes, rng: random.Random) -> bytes:
    """Returns a zip with the JSON in it changed, a member gone, damaged or there twice, or a pickle in it."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    place = rng.randrange(len(members))
    name, data = members[place]
    kind = rng.randrange(5)
    if kind == 0:
        del members[place]
    elif kind == 1:
        members.append((name, rng.choice((_flip, _truncate, _fill))(data, rng)))
    elif kind == 2:
        members[place] = name, b"cos\nsystem\n(S'touch executed'\ntR."
    else:
        members = [(each, json_text(inner, rng) if each == "data" else inner) for each, inner in members]
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        warnings.simplefilter("ignore")  # a name twice is what is wanted
        for each, inner in members:
            archive.writestr(each, inner)
    return buffer.getvalue() if rng.random() < 0.7 else _flip(buffer.getvalue(), rng)


_ITEMS = (  # of CBOR: claims of exabytes, nesting, tags, numbers that are none, ends without a beginning
    b"\x9b" + b"\xff" * 8, b"\xbb\x7f" + b"\xff" * 7, b"\x7b" + bytes(4) + b"\xff" * 4, b"\x5b\x7f" + b"\xff" * 7,
    b"\x81" * _DEEP, b"\xa1\x61a" * _DEEP, b"\x9f" * 50, b"\x5f\x41a\xff", b"\x7f\x61a\xff",
    b"\xc2\x58\x40" + b"\xff" * 64,
    b"\xd8\x1c\x81\xd8\x1d\x00", b"\xf9\x7e\x00", b"\xfb\x7f\xf0" + bytes(6), b"\xf7", b"\xf8\x18", b"\xff",
    b"\x61\xff",
    b"\x1b" + b"\xff" * 8, b"\x3b" + b"\xff" * 8, b"\x60", b"\x80", b"\xa0", b"\xf6",
)  # fmt: skip


def _cbor(content: bytes, rng: random.Random) -> bytes:
    """Returns a message with an item put in, or in place of what is there."""
    at, item = rng.randrange(len(content) + 1), rng.choice(_ITEMS)
    return content[:at] + item + content[at + rng.choice((0, 1, len(item))) :]


def _bomb(content: bytes, rng: random.Random) -> bytes:
    """Returns an archive whose one member unpacks to a gibibyte of zeros."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
    name = names[0]
    buffer = io.BytesIO()
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (134217728,), }"
    header += b" " * (118 - len(header) - 1) + b"\n"
    with (
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(name, "w", force_zip64=True) as member,
    ):
        member.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        for _ in range(1024):
            member.write(bytes(1 << 20))
    with zipfile.ZipFile(buffer, "a") as archive:
        for each in names[1:]:
            archive.writestr(each, b"")
    return buffer.getvalue()


def _ones(content: bytes, rng: random.Random) -> bytes:
    """Returns tensors whose every float of 32 bits has all bits set: it is not a number."""
    del rng
    length = 8 + int.from_bytes(content[:8], "little")
    changed = bytearray(content)
    for name, each in json.loads(content[8:length]).items():
        if name != "__metadata__" and each["dtype"] == "F32":
            first, end = (length + offset for offset in each["data_offsets"])
            changed[first:end] = b"\xff" * (end - first)
    return bytes(changed)


Mutation = Callable[[bytes, random.Random], bytes]
_ANY: tuple[Mutation, ...] = (_flip, _truncate, _repeat, _noise, _fill, _whole, _encoding)
_BY_SUFFIX: dict[str, list[Mutation]] = {
    ".json": [json_text, json_text, json_text],
    ".csv": [_cell, _cell],
    ".txt": [_cell],
    ".gz": [_gzip, _gzip, _gzip],
    ".safetensors": [_safetensors, _safetensors, _safetensors],
    ".npz": [_npz, _npz, _npz],
    ".zip": [_model, _model, _model],
    ".cbor": [_cbor, _cbor, _cbor],
}
NAMED: dict[str, Mutation] = {
    "bomb": _bomb,
    "whole": _whole,
    "truncate": _truncate,
    "tensors": _safetensors,
    "ones": _ones,
}


def with_value(content: bytes, key: str, raw: str) -> bytes:
    """Returns a JSON object with another value of one key, as raw text."""
    return json.dumps(json.loads(content) | {key: _HOLE}).replace(f'"{_HOLE}"', raw, 1).encode()
