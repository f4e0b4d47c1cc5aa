"""The damage of the fault campaign, draw by draw: what each draw asks for is what becomes of the file."""

import gzip
import io
import json
import random
import re
import zipfile
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from wayfield.benchmarks.faults import mutations


class Told(random.Random):
    """Answers each draw by what it was told, and notes between how many it chose."""

    def __init__(self, *answers: Any) -> None:
        super().__init__(0)
        self.answers = list(answers)
        self.asked: list[int] = []

    def choice(self, seq: Sequence[Any]) -> Any:
        self.asked.append(len(seq))
        return seq[self.answers.pop(0)]

    def randrange(self, start: int, stop: int | None = None, step: int = 1) -> int:
        assert stop is None
        self.asked.append(start)
        found: int = self.answers.pop(0)
        assert 0 <= found < start
        return found

    def random(self) -> float:
        found: float = self.answers.pop(0)
        return found

    def randbytes(self, n: int) -> bytes:
        return b"R" * n


def _done(mutation: Callable[[bytes, random.Random], bytes], content: bytes, *answers: Any) -> bytes:
    rng = Told(*answers)
    found = mutation(content, rng)
    assert not rng.answers, "a draw was left out"
    return found


def test_bytes_are_damaged_where_the_draws_say() -> None:
    content = bytes(range(65, 81))
    for place, flips in enumerate((1, 1, 2, 8, 64)):
        draws = [(k % 16, k % 8) for k in range(flips)]
        wanted = bytearray(content)
        for at, bit in draws:
            wanted[at] ^= 2**bit
        assert _done(mutations._flip, content, place, *(each for pair in draws for each in pair)) == bytes(wanted)
    assert _done(mutations._flip, b"") == b""
    for end in (0, 5, 16):  # nothing is left, or all of it
        assert _done(mutations._truncate, content, end) == content[:end]
        for place, times in enumerate((1, 2, 20)):
            wanted = content[:end] + content[3:end] * times + content[end:]
            if end >= 3:
                assert _done(mutations._repeat, content, end, 3, place) == wanted
        for place, count in enumerate((1, 8, 200)):
            assert _done(mutations._noise, content, end, place) == content[:end] + b"R" * count + content[end:]
        for place, byte in enumerate((b"\xff", b"\0", b"\x7f")):
            first, last = sorted((end, 4))
            wanted = content[:first] + byte * (last - first) + content[last:]
            assert _done(mutations._fill, content, end, 4, place) == wanted
    for mutation, answers in (
        (mutations._truncate, (16,)),
        (mutations._repeat, (16, 16, 0)),
        (mutations._noise, (16, 0)),
        (mutations._fill, (16, 16, 0)),
    ):
        rng = Told(*answers)
        mutation(content, rng)
        assert rng.asked[0] == 17  # the places between and around sixteen bytes


def test_a_file_is_another_file() -> None:
    content = b"na\n\xc3\xa4"
    wholes = [_done(mutations._whole, content, k) for k in range(9)]
    assert wholes[0] == b""
    assert set(wholes[1]) == {0}
    assert wholes[2] == b"R" * 1000
    assert set(wholes[3]) == set(b"[")
    assert len(wholes[3]) > 10_000
    assert [json.loads(wholes[k]) for k in (4, 5, 6)] == [None, {}, []]
    found = [_done(mutations._encoding, content, k) for k in range(7)]
    text = content.decode()
    assert found[0].decode("utf-16") == found[1].decode("utf-32") == text
    assert len(found[1]) == 2 * len(found[0])
    assert found[2].decode("utf-8-sig") == text
    assert found[3] == b"na\r\n\xc3\xa4"
    assert found[4] == b"na\r\xc3\xa4"
    with pytest.raises(UnicodeDecodeError):
        found[5].decode()
    assert found[6] == content + b"\0"


def test_one_place_of_a_json_is_changed() -> None:
    tree = {"a": [1, {"b": "c"}], "d": None}
    content = json.dumps(tree).encode()
    places = [(tree, "a"), (tree["a"], 0), (tree["a"], 1), (tree["a"][1], "b"), (tree, "d")]  # type: ignore[index]
    assert list(mutations._places(tree)) == places
    hostile = [each for each in mutations.HOSTILE if len(each) < 100]
    assert {"NaN", "-Infinity", "1e400", "null", "[]", "{}", '""'} <= set(hostile)

    def changed(*answers: int) -> Any:
        return json.loads(_done(mutations.json_text, content, *answers))

    null = mutations.HOSTILE.index("null")
    assert changed(4, 0, null) == {"a": [1, {"b": "c"}]}
    assert changed(1, 0, null) == {"a": [{"b": "c"}], "d": None}
    assert changed(4, 1, null) == tree | {"d ": None}
    for place, times in enumerate((2, 50)):
        assert changed(1, 2, place, null)["a"] == tree["a"] * times  # type: ignore[operator]
    for kind in (1, 2, 4, 5, 6, 7):  # of a member that is no list, or of a list that is no object, its value
        if kind != 2:
            assert changed(1, kind, null)["a"] == [None, {"b": "c"}]
        if kind != 1:
            assert changed(3, kind, null)["a"] == [1, {"b": None}]
    assert changed(1, 3, null)["a"] == [None, {"b": "c"}]  # a list has no key to be there twice
    twice = _done(mutations.json_text, content, 3, 3, null).decode()
    assert re.findall(r'"b": ([^,}]*)', twice) == ["1", "2"]
    for k, raw in enumerate(mutations.HOSTILE):
        assert _done(mutations.json_text, b"{}", k) == raw.encode()
    rng = Told(1, 7, null)
    mutations.json_text(content, rng)
    assert rng.asked == [5, 8, len(mutations.HOSTILE)]
    assert mutations.with_value(b'{"a": 1, "b": [2]}', "b", "1e400") == b'{"a": 1, "b": 1e400}'
    assert json.loads(mutations.with_value(b'{"a": 1}', "b", '"x"')) == {"a": 1, "b": "x"}


def test_one_cell_row_or_column_of_a_table_is_changed() -> None:
    content = b"x,y,z\n1,2,3\n4,5,6\n7,8,9\n"

    def changed(*answers: int) -> bytes:
        return _done(mutations._cell, content, *answers)

    assert changed(0, 2) == b"x,y,z\n1,2,3\n7,8,9\n"
    assert changed(1, 1, 3) == b"x,y,z\n7,8,9\n1,2,3\n4,5,6\n7,8,9\n"
    assert changed(2, 1) == b"x,z\n1,3\n4,6\n7,9\n"
    minus = mutations._CELLS.index("-1")
    for kind in range(3, 8):
        assert changed(kind, 3, minus, 0) == b"x,y,z\n1,2,3\n4,5,6\n-1,8,9\n"
    rng = Told(7, 3, 0, 2)
    mutations._cell(content, rng)
    assert rng.asked == [8, 4, len(mutations._CELLS), 3]
    packed = gzip.compress(content)
    assert gzip.decompress(_done(mutations._gzip, packed, 0.06, 0, 0, 2)) == b"x,y,z\n1,2,3\n7,8,9\n"
    assert gzip.decompress(_done(mutations._gzip, packed, 0.05, 4, 6)) == content + b"\0"
    assert sum(gzip.decompress(_done(mutations._gzip, packed, 0.5, 3, 0, 0, 0))) == sum(content) + 1 - 2 * (
        content[0] & 1
    )


def _tensors() -> tuple[bytes, bytes, bytes]:
    header = {
        "__metadata__": {"card": '{"dt": 1}', "name": "x"},
        "a": {"dtype": "F32", "shape": [2], "data_offsets": [4, 12]},
        "b": {"dtype": "I32", "shape": [1], "data_offsets": [0, 4]},
    }
    text = json.dumps(header).encode()
    data = bytes(range(1, 13))
    return len(text).to_bytes(8, "little") + text + data, text, data


def test_tensors_have_another_header_or_other_numbers() -> None:
    content, text, data = _tensors()
    for place, byte in enumerate((b"\xff", b"\0", b"\x7f")):
        assert _done(mutations._safetensors, content, 0, place) == content[:-12] + byte * 12
    found = _done(mutations._safetensors, content, 1, 0, 11, 1)
    assert found == content[:-1] + bytes([12 ^ 2])
    null = mutations.HOSTILE.index("null")
    for kind, of_card in ((2, True), (3, False)):
        # where the card is meant, of the one text that holds JSON its one member
        inner = (0, 0, 7, null) if of_card else (0, 7, null)
        found = _done(mutations._safetensors, content, kind, *inner, 0.89)
        length = int.from_bytes(found[:8], "little")
        tree = json.loads(found[8 : 8 + length])
        assert found[8 + length :] == data
        if of_card:
            assert tree == json.loads(text) | {"__metadata__": {"card": '{"dt": null}', "name": "x"}}
        else:
            assert tree == json.loads(text) | {"__metadata__": None}
    for place, claimed in enumerate((2**40, 2**63, 0, None)):
        found = _done(mutations._safetensors, content, 3, 0, 7, null, 0.9, place)
        header = found[8:-12]
        wanted = len(header) - 1 if claimed is None else claimed
        assert int.from_bytes(found[:8], "little") == wanted
        assert json.loads(header) == json.loads(text) | {"__metadata__": None}
    rng = Told(1, 0, 0, 0)
    mutations._safetensors(content, rng)
    assert rng.asked[0] == 4
    ones = _done(mutations._ones, content)
    assert ones == content[:-12] + data[:4] + b"\xff" * 8  # the floats alone


def _archive(**members: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def _members(content: bytes) -> list[tuple[str, bytes]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return [(each.filename, archive.read(each)) for each in archive.infolist()]


def test_an_archive_has_another_member() -> None:
    array = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (3, 2), }   \nDATA"
    content = _archive(b=b"other", a=array)

    def changed(*answers: Any) -> dict[str, bytes]:
        return dict(_members(_done(mutations._npz, content, 0, *answers)))  # the first by name: a

    for place, shape in ((1, b"(-1,)"), (3, b"()"), (5, b"(1, 1, 1)")):
        assert changed(0, place) == {"b": b"other", "a": array.replace(b"(3, 2)", shape)}
    for place, kind in ((0, b"'|O'"), (6, b"'<f2'")):
        assert changed(1, place) == {"b": b"other", "a": array.replace(b"'<f8'", kind)}
    assert b"touch executed" in changed(2)["a"]
    assert changed(2)["b"] == b"other"
    assert changed(3, 1) == {"b": b"other", "a": array, "../x.npy": array}
    assert changed(4) == {"b": b"other"}
    assert changed(5, 1, 7) == {"b": b"other", "a": array[:7]}
    rng = Told(1, 4)
    assert dict(_members(mutations._npz(content, rng))) == {"a": array}
    assert rng.asked == [2, 6]


def test_a_model_has_another_member() -> None:
    content = _archive(data=b'{"a": 1}', more=b"12345")
    whole = _members(content)
    null = mutations.HOSTILE.index("null")

    def changed(*answers: Any) -> list[tuple[str, bytes]]:
        return _members(_done(mutations._model, content, *answers, 0.69))

    assert changed(0, 0) == whole[1:]
    assert changed(1, 0) == whole[:1]
    assert changed(1, 1, 1, 2) == [*whole, ("more", b"12")]
    (name, pickle), other = changed(0, 2)
    assert name == "data"
    assert b"touch executed" in pickle
    assert other == whole[1]
    for kind in (3, 4):
        assert changed(1, kind, 0, 7, null) == [("data", b'{"a": null}'), whole[1]]
    plain = _done(mutations._model, content, 1, 0, 0.0)
    flipped = _done(mutations._model, content, 1, 0, 0.7, 0, 3, 0)
    assert [k for k, (a, b) in enumerate(zip(plain, flipped, strict=True)) if a != b] == [3]
    rng = Told(1, 0, 0.0)
    mutations._model(content, rng)
    assert rng.asked == [2, 5]


def test_a_message_has_an_item_more_or_another() -> None:
    content = b"0123456789"
    null = mutations._ITEMS.index(b"\xf6")
    assert _done(mutations._cbor, content, 4, null, 0) == b"0123\xf6456789"
    assert _done(mutations._cbor, content, 4, null, 1) == b"0123\xf656789"
    double = mutations._ITEMS.index(b"\xf9\x7e\x00")
    assert _done(mutations._cbor, content, 4, double, 2) == b"0123\xf9\x7e\x00789"
    rng = Told(10, null, 0)
    assert mutations._cbor(content, rng) == content + b"\xf6"
    assert rng.asked == [11, len(mutations._ITEMS), 3]


def test_what_fits_a_name_is_drawn_thrice_as_often(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[Any]] = []

    class Drawn(Told):
        def choice(self, seq: Sequence[Any]) -> Any:
            if callable(seq[0]):
                seen.append(list(seq))
                return seq[0]
            return super().choice(seq)

    def once(content: bytes, rng: random.Random) -> bytes:
        return content + b"!"

    monkeypatch.setattr(mutations, "_ANY", (once, *mutations._ANY[1:]))
    for place, times in enumerate((1, 1, 1, 2, 3)):
        assert mutations.damaged(b"x", "a.json", Drawn(place)) == b"x" + b"!" * times
    for suffix, own in mutations._BY_SUFFIX.items():
        seen.clear()
        mutations.damaged(b"x", f"a{suffix}", Drawn(0))
        assert seen == [[*mutations._ANY, *own, *own, *own]]
    seen.clear()
    mutations.damaged(b"x", "a.bin", Drawn(0))
    assert seen == [list(mutations._ANY)]


@pytest.mark.parametrize("error", [ValueError, IndexError, KeyError, RuntimeError, OSError, EOFError, zlib.error])
def test_what_no_mutation_fits_has_bits_flipped(monkeypatch: pytest.MonkeyPatch, error: type[Exception]) -> None:
    def fails(content: bytes, rng: random.Random) -> bytes:
        raise error("no such file")

    monkeypatch.setattr(mutations, "_ANY", (fails,))
    assert mutations.damaged(b"\0\0", "a.bin", Told(0, 0, 0, 1, 7)) == b"\0\x80"


def test_a_bomb_is_a_gibibyte_of_zeros_under_the_first_name(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(mutations, "range", lambda count: asked.append(count) or (0, 1), raising=False)
    content = _done(mutations._bomb, _archive(a=b"x", b=b"y", c=b"z"))
    assert asked == [1024]
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert [each.filename for each in archive.infolist()] == ["a", "b", "c"]
        assert archive.read("b") == archive.read("c") == b""
        whole = archive.read("a")
    assert whole[:8] == b"\x93NUMPY\x01\x00"
    length = int.from_bytes(whole[8:10], "little")
    assert (10 + length) % 64 == 0  # as NumPy's format has it
    header = whole[10 : 10 + length]
    assert header.endswith(b"\n")
    assert eval(header) == {"descr": "<f8", "fortran_order": False, "shape": (2**30 // 8,)}
    assert whole[10 + length :] == bytes(2 << 20)
