"""What was packed, unpacked piece by piece: a small file may stand for more than any memory holds."""

import csv
import io
import lzma
import zipfile
from collections.abc import Iterator
from typing import IO

_DICTIONARY = 2**27  # bytes that unpacking .xz may take, as far as so much comes out: presets up to 9 need 65 MiB

_PIECE = 2**18  # bytes


class _Xz(io.RawIOBase):
    """What a content of .xz unpacks to, as a stream."""

    def __init__(self, content: bytes) -> None:
        self._unpacker = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=_DICTIONARY)
        self._content = content

    def readable(self) -> bool:
        """Returns True."""
        return True

    def readinto(self, buffer: "memoryview") -> int:  # type: ignore[override]
        """Fills a buffer; EOFError where the content is cut off, LZMAError where more than one stream stands in it."""
        piece = b""
        while not (piece or self._unpacker.eof):
            if self._unpacker.needs_input and not self._content:
                raise EOFError("it is cut off")
            piece = self._unpacker.decompress(self._content, len(buffer))
            self._content = b""
        if self._unpacker.unused_data:  # other readers would go on there, and have rows that nobody has looked at
            raise lzma.LZMAError("something stands behind its end")
        buffer[: len(piece)] = piece
        return len(piece)


def xz_rows(content: bytes, longest: int, most: int) -> Iterator[list[str]]:
    """Yields the rows of CSV within .xz, each of a line, as `rows`; lzma.LZMAError or EOFError if it is damaged."""
    return rows(io.BufferedReader(_Xz(content)), longest, most)


def rows(stream: io.BufferedIOBase, longest: int, most: int) -> Iterator[list[str]]:
    """Yields the rows of CSV, each of a line of its own; no more than one is held.

    Args:
        stream: what unpacks as it is read.
        longest: bytes of a line.
        most: bytes of all.

    Raises:
        csv.Error: if a line is no row, as an empty one, or longer, or there are more bytes.
        UnicodeDecodeError: if it is no text.
    """
    while line := stream.readline(longest + 1):
        most -= len(line)
        if len(line) > longest or most < 0:
            raise csv.Error(f"a line has over {longest} bytes" if len(line) > longest else "it unpacks to too much")
        if not (row := next(csv.reader([line.decode()], strict=True), [])):
            raise csv.Error("a line is empty")
        yield row


class Piecewise:
    """A member of an archive whose reads are of bounded size, since `ZipFile` unpacks as much as it is asked for."""

    def __init__(self, member: IO[bytes]) -> None:
        self._member = member

    def read(self, size: int = _PIECE, /) -> bytes:
        """Returns at most so many of the next bytes, none at the end."""
        return self._member.read(min(size, _PIECE))


def check_members(archive: zipfile.ZipFile, most: int) -> None:
    """Raises ValueError unless an archive unpacks to at most so many bytes, by kinds that unpack piece by piece."""
    members = archive.infolist()
    if (size := sum(each.file_size for each in members)) > most:
        raise ValueError(f"it would unpack to {size} bytes")
    for each in members:
        if each.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{each.filename} is packed otherwise than by deflate")
