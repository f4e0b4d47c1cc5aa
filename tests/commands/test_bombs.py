"""Small files that stand for large ones: each is refused in a line, within a bounded memory."""

import json
import lzma
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from wayfield.benchmarks.commands.submission import CARD, NEEDED, ROWS, signed
from wayfield.benchmarks.commands.submit import verify

SMALL = 1_000_000  # bytes of a file
LARGE = 100  # MiB that one unpacks to; of a table several times as much as objects
PEAKS = Path(__file__).parents[1] / "oracles" / "peaks.py"  # a process that has what verify needs, and no more
MOST = 200 << 20  # bytes of the process that verifies it
ROW = dict.fromkeys(NEEDED, "0") | {"contest": "docking", "robot": "p3dx", "policy": "polar", "split": "test"}
CODE = "0" * 64
ENTRY = {name: ROW[name] for name in ("contest", "robot", "policy", "gains_name", "split")}


def packed(pieces: Iterator[bytes]) -> bytes:
    """Returns pieces packed as .xz, one after the other."""
    packer = lzma.LZMACompressor(preset=0)
    return b"".join(map(packer.compress, pieces)) + packer.flush()


def rows(line: Callable[[int], bytes], count: int) -> Iterator[bytes]:
    yield ",".join((*ROW, "more")).encode() + b"\n"
    yield from (line(k) for k in range(count))


def of_row(k: int, more: str) -> tuple[dict[str, str], bytes]:
    row = ROW | {"episode": f"{k}", "more": more}
    return row, ",".join(row.values()).encode() + b"\n"


def signed_row(k: int) -> tuple[dict[str, str], bytes]:
    return of_row(k, f"{k}" * 1500)


FIRST = of_row(0, "")[1]
SIGNED = 20_000  # rows
CONTENTS: dict[str, Callable[[], Iterator[bytes]]] = {
    "newlines": lambda: (b"\n" * (1 << 20) for _ in range(LARGE)),
    "one line": lambda: (b"x" * (1 << 20) for _ in range(LARGE)),
    "columns": lambda: (b"a," * (1 << 19) for _ in range(LARGE)),
    "quoted lines": lambda: (b'"\n"' * (1 << 18) for _ in range(LARGE)),
    "a long cell": lambda: rows(lambda _: b"x" * (1 << 20), LARGE),
    "rows": lambda: rows(lambda _: FIRST * 10_000, 4 * LARGE),
    "signed rows": lambda: rows(lambda k: signed_row(k)[1], SIGNED),
}
CARDS = {
    "signed": lambda: [signed(signed_row(k)[0]) for k in range(SIGNED)],
    "lists": lambda: [[]] * 300_000,
    "objects": lambda: [{"": 0}] * 120_000,
    "long texts": lambda: ["x" * 100_000] * 9,
    "equal": lambda: [signed(of_row(0, "")[0])] * 45_000,
}


def submissions(folder: Path) -> None:
    """Writes submissions of up to a megabyte, of every kind of rows with a card that is small, and of every card."""
    cards = {name: make() for name, make in CARDS.items()}
    contents = {name: packed(pieces()) for name, pieces in CONTENTS.items()}
    for rows_name, card_name in {*((name, "signed") for name in CONTENTS), *(("rows", name) for name in CARDS)}:
        made = folder / f"{rows_name}, {card_name}"
        made.mkdir()
        card = {"entry": ENTRY, "code": CODE, "policy": "", "scenarios": {}, "versions": {"code and agents": CODE[:12]}}
        (made / CARD).write_text(json.dumps(card | {"episodes": cards[card_name]}))
        (made / ROWS).write_bytes(contents[rows_name])
        assert (made / ROWS).stat().st_size < SMALL


def archive(file: Path, name: str, kind: int) -> Path:
    """Writes a zip of a member that unpacks to zeros alone."""
    with zipfile.ZipFile(file, "w", kind) as members, members.open(name, "w", force_zip64=True) as member:
        for _ in range(LARGE):
            member.write(bytes(1 << 20))
    with zipfile.ZipFile(file, "a") as members:
        members.writestr("policy.pth", b"")
    return file


def forged(file: Path) -> Path:
    """Writes over the size that a zip's first member declares."""
    content = file.read_bytes()
    size = (LARGE << 20).to_bytes(4, "little")
    place = content.rindex(b"PK\1\2", 0, content.rindex(b"policy.pth"))
    place = content.rindex(b"PK\1\2", 0, place) if content.count(b"PK\1\2") > 1 else place
    file.write_bytes(content[:place] + content[place:].replace(size, (1000).to_bytes(4, "little"), 1))
    return file


@pytest.mark.skipif(sys.platform != "linux", reason="the system tells of memory otherwise")
def test_a_small_file_takes_no_large_memory(tmp_path: Path) -> None:
    submissions(tmp_path)
    for kind in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2):
        archive(tmp_path / f"model_{kind}.zip", "data", kind)
    forged(archive(tmp_path / "forged.zip", "data", zipfile.ZIP_DEFLATED))
    (tmp_path / "run").mkdir()
    archive(tmp_path / "run" / "trajectories.npz", "00000/poses.npy", zipfile.ZIP_LZMA)
    done = subprocess.run([sys.executable, PEAKS, tmp_path], capture_output=True, text=True, check=True)
    *wrong, verified, read = done.stdout.splitlines()
    assert wrong == []
    assert int(verified) < MOST
    assert int(read) - int(verified) < LARGE << 20, "one was unpacked whole"


@pytest.mark.skipif(sys.platform != "linux", reason="the system tells of memory otherwise")
def test_an_honest_entry_takes_no_large_memory() -> None:
    entry = Path(__file__).parents[2] / "docs" / "leaderboard" / "lqr_tuned"
    words = [str(entry), "--sample", "2"]
    assert "driven again" in CliRunner().invoke(verify, words).output  # which may compile
    done = subprocess.run([sys.executable, PEAKS, *words], capture_output=True, text=True, check=True)
    assert int(done.stdout.splitlines()[-1]) < MOST
