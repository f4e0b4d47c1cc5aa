"""Damage: what disks, editors, other programs and ill will make of a good file."""

import functools
import gzip
import io
import json
import lzma
import random
import re
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence
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
_TAGGED = (
    "!!python/object/apply:os.system ['touch executed']", "!!binary x", "&a [*a]", "*nowhere", ".nan", "-.inf", "{}",
    "[" * 5000, "[.inf, 0, 0]", "[1e300, 0, 0]", "[0, 0]", "~", "yes", "0b1", "1:30", "2001-01-01", "|", "../../../x",
    "&a [x,x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b]\nd: [*c,*c,*c,*c,*c,*c,*c]",
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
        except Exception:
            content = _flip(content, rng)  # what is no such file any more has no values to change
    return content


def _flip(content: bytes, rng: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if content else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _truncate(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _piece(content: bytes, rng: random.Random) -> bytes:
    """Returns a file with a piece of it repeated, filled with one byte or pushed aside by noise."""
    a, b = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    kind = rng.randrange(3)
    if kind == 0:
        return content[:b] + content[a:b] * rng.choice((1, 2, 20)) + content[b:]
    if kind == 1:
        return content[:a] + rng.randbytes(rng.choice((1, 8, 200))) + content[a:]
    return content[:a] + rng.choice((b"\xff", b"\0", b"\x7f")) * (b - a) + content[b:]


def _whole(content: bytes, rng: random.Random) -> bytes:
    return rng.choice((b"", b"\0" * 100, rng.randbytes(1000), b"[" * _DEEP, b"null", b"{}", b"[]", b"\xff\xfe", b"\n"))


def _encoding(content: bytes, rng: random.Random) -> bytes:
    kind = rng.randrange(4)
    if kind == 0:
        return content.decode().encode(rng.choice(("utf-16", "utf-32", "utf-8-sig")))
    return (
        content + b"\0"
        if kind == 1
        else content.replace(*rng.choice(((b"\n", b"\r\n"), (b"\n", b"\r"), (b"a", b"\xe4"))))
    )


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


def _packed(unpack: Callable[[bytes], bytes], pack: Callable[[bytes], bytes]) -> "Mutation":
    """Returns what damages a table within gzip or xz, of which one grows to tens of megabytes now and then."""

    def mutated(content: bytes, rng: random.Random) -> bytes:
        plain = unpack(content)
        if rng.random() < 0.05:
            return pack(plain + b"1,2,3,4\n" * 4_000_000)
        return pack(rng.choice((_cell, _cell, _cell, _flip, _encoding))(plain, rng))

    return mutated


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


_PICKLE = b"cos\nsystem\n(S'touch executed'\ntR."  # runs a command when it is loaded


def _array(content: bytes, rng: random.Random) -> bytes:
    """Returns an array of NumPy with another shape or type in its header, damaged, or a pickle in its place."""
    kind = rng.randrange(4)
    if kind == 0:
        shape = rng.choice((b"(99999999999,)", b"(-1,)", b"(9223372036854775807, 9)", b"()", b"(0,)", b"(1, 1, 1)"))
        start, end = content.index(b"'shape': ") + 9, content.index(b")", content.index(b"'shape'")) + 1
        return content[:start] + shape + content[end:]
    if kind == 1:
        described = rng.choice((b"'|O'", b"'<M8'", b"'|S9'", b"'<c16'", b"'>f8'", b"[('a','<f8')]", b"'<f2'"))
        start = content.index(b"'descr': ") + 9
        return content[:start] + described + content[content.index(b",", start) :]
    return _PICKLE if kind == 2 else rng.choice((_flip, _truncate, _piece))(content, rng)


def _archive(content: bytes, rng: random.Random) -> bytes:
    """Returns a zip with a member changed by what it is, gone, of another name or there twice, or damaged itself."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    place = rng.randrange(len(members))
    name, data = members[place]
    kind = rng.randrange(6)
    if kind == 0:
        del members[place]
    elif kind == 1:
        members.append((name, rng.choice((_flip, _truncate, _piece))(data, rng)))
    elif kind == 2:
        members.append((rng.choice(("x", "../x.npy", "a/b/c.npy", "00000/unknown.npy", ".npy")), data))
    elif name.endswith(".npy"):
        members[place] = name, _array(data, rng)
    else:
        members[place] = name, _PICKLE if kind == 3 else json_text(data, rng)
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        warnings.simplefilter("ignore")  # a name twice is what is wanted
        for each, inner in members:
            archive.writestr(each, inner)
    return buffer.getvalue() if rng.random() < 0.8 else _flip(buffer.getvalue(), rng)


def _token(content: bytes, rng: random.Random) -> bytes:
    """Returns a text, of whatever format, with a number, a word or a line changed."""
    text = content.decode("utf-8", "surrogateescape")
    kind = rng.randrange(6)
    lines = text.splitlines(keepends=True)
    if kind == 0:
        del lines[rng.randrange(len(lines))]
    elif kind == 1:
        lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    else:
        place = rng.choice(list(re.finditer(r"[-+\w.]+" if kind == 2 else r"-?\d[\d.e+-]*", text)))
        return (text[: place.start()] + rng.choice(_CELLS) + text[place.end() :]).encode("utf-8", "surrogateescape")
    return "".join(lines).encode("utf-8", "surrogateescape")


def _yaml(content: bytes, rng: random.Random) -> bytes:
    """Returns a mapping with another value of a key, as YAML alone can write it."""
    lines = content.decode().splitlines()
    place = rng.randrange(len(lines))
    key = lines[place].partition(":")[0]
    lines[place] = f"{key}: {rng.choice(_TAGGED)}"
    return "\n".join(lines).encode() + b"\n"


def _entities(content: bytes, rng: random.Random) -> bytes:
    """Returns XML with entities that grow without end, or name a file."""
    billion = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(9))
    declared = rng.choice((f'<!ENTITY e0 "e">{billion}', '<!ENTITY e9 SYSTEM "file:///etc/passwd">'))
    start = content.index(b">") + 1
    return f"<!DOCTYPE sdf [{declared}]>".encode() + content[:start] + b"&e9;" + content[start:]


def _png(content: bytes, rng: random.Random) -> bytes:
    """Returns an image whose header says another size, depth or kind, with the right checksum."""
    header = bytearray(content[16:29])
    place, size = rng.choice(((0, 4), (4, 4), (8, 1), (9, 1), (12, 1)))
    header[place : place + size] = (rng.choice((0, 1, 3, 16, 255, 2**16, 2**31 - 1)) % 256**size).to_bytes(size, "big")
    return content[:16] + header + zlib.crc32(b"IHDR" + header).to_bytes(4, "big") + content[33:]


def _journal(content: bytes, rng: random.Random) -> bytes:
    """Returns lines of JSON with one of them changed."""
    lines = content.splitlines()
    place = rng.randrange(len(lines))
    lines[place] = json_text(lines[place], rng)
    return b"\n".join(lines) + b"\n"


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


Mutation = Callable[[bytes, random.Random], bytes]
_ANY: tuple[Mutation, ...] = (_flip, _truncate, _piece, _piece, _piece, _whole, _encoding)
_BY_SUFFIX: dict[str, list[Mutation]] = {
    ".json": [json_text, json_text, json_text],
    ".csv": [_cell, _cell, _token],
    ".txt": [_cell, _token],
    ".yaml": [_yaml, _yaml, _token],
    ".map": [_token, _token],
    ".scen": [_token, _token],
    ".world": [_token, _token, _entities],
    ".pgm": [_token],
    ".png": [_png, _png],
    ".npy": [_array, _array, _array],
    ".journal": [_journal, _journal],
    ".gz": [_packed(gzip.decompress, functools.partial(gzip.compress, compresslevel=1, mtime=0))] * 3,
    ".xz": [_packed(lzma.decompress, functools.partial(lzma.compress, preset=0))] * 3,
    ".safetensors": [_safetensors, _safetensors, _safetensors],
    ".npz": [_archive, _archive, _archive],
    ".zip": [_archive, _archive, _archive],
    ".cbor": [_cbor, _cbor, _cbor],
}


def nudged(content: bytes, name: str, rng: random.Random, under: Sequence[str] = ()) -> bytes:
    """Returns a file that reads as well as before and says something else: what only a digest can tell.

    Args:
        under: keys of a JSON object, below which the change is to be.
    """
    if name.endswith(".safetensors"):
        length = 8 + int.from_bytes(content[:8], "little")
        return content[:length] + _flip(content[length:], rng)
    if name.endswith(".csv.xz"):
        rows = [line.split(",") for line in lzma.decompress(content).decode().splitlines()]
        row = rng.choice(rows[1:])
        row[rng.choice([k for k, cell in enumerate(row) if cell])] += "1"
        return lzma.compress("".join(f"{','.join(each)}\n" for each in rows).encode(), preset=0)
    if not name.endswith(".json"):
        return _flip(content, rng)
    tree = json.loads(content)
    part = tree
    for key in under:
        part = part[key]
    leaves = [(owner, key) for owner, key in _places(part) if not isinstance(owner[key], dict | list)]
    if not leaves:
        return content + b" "
    owner, key = rng.choice(leaves)
    value = owner[key]
    if isinstance(value, bool) or value is None:
        owner[key] = not value
    elif isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value):
        owner[key] = value[:-1] + ("0" if value[-1] != "0" else "1")
    else:
        owner[key] = value + ("x" if isinstance(value, str) else 1)
    return json.dumps(tree).encode()
