"""The rows behind published tables, as the repository keeps them: what the tables need, packed.

Numbers have six digits, which is more than any table shows; the tables are made from the rows as they are kept.
"""

import csv
import io
import lzma
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from wayfield.benchmarks.contests import ALL_CONTESTS, COST, Contest
from wayfield.benchmarks.leaderboards.entries import COMPARED
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.system.checks import MOST_BYTES
from wayfield.system.readers import of_path, reader
from wayfield.system.unpacking import xz_rows

SUFFIX = ".csv.xz"
DIGITS = 6

_NAMED = (
    *("suite", "contest", "family", "scenario", "robot", "disturbance", "policy", "gains_name", "gains", "dynamics"),
    *("actuators", "seed", "episode", "split", "tier", "speed", "agent_seed", "knows", "parameters", "learned_from"),
    "failure_cost",
)
_EVERYWHERE = ("success", "collision", "left_corridor", "timeout", "mean_speed", "time")


def measured(contest: Contest, split: str) -> tuple[str, ...]:
    """Returns the metrics that tables show of the rows of a split; of all but the compared ones few."""
    shown = [each.metric for each in contest.columns] if split in COMPARED else []
    of_cost = [contest.spec.cost.metric, contest.cost.metric, *([contest.gap.metric] if contest.gap else ())]
    return tuple(dict.fromkeys(name for name in (*_EVERYWHERE, *shown, *of_cost) if name != COST))


def thinned(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Returns the columns of contests that are kept, as text, numbers rounded; what is not kept is empty."""
    wanted = {
        (contest.name, split): measured(contest, split)
        for contest in ALL_CONTESTS.values()
        for split in {row["split"] for row in rows}
    }
    columns = (*_NAMED, *dict.fromkeys(name for names in wanted.values() for name in names))
    episodes = Episodes.of(rows)
    shown = [wanted[pair] for pair in zip(episodes["contest"], episodes["split"], strict=True)]
    texts = {name: episodes.texts(name) for name in _NAMED}
    for name in columns[len(_NAMED) :]:
        values = episodes.numbers(name).tolist()
        texts[name] = [_rounded(value) if name in stored else "" for value, stored in zip(values, shown, strict=True)]
    return texts


def _rounded(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.{DIGITS}g}"


def packed(columns: Mapping[str, Sequence[str]]) -> bytes:
    """Returns the content of a file of rows; column by column, which packs better than row by row."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([name, *cells] for name, cells in columns.items())
    return lzma.compress(text.getvalue().encode(), preset=9 | lzma.PRESET_EXTREME)


def unpacked(content: bytes, source: str) -> list[dict[str, str]]:
    """Returns the rows of a file's content, as text.

    Raises:
        ValueError: if it is damaged, or no such table; the message names the source.
    """
    columns: dict[str, list[str]] = {}
    try:
        for name, *cells in xz_rows(content, MOST_BYTES, MOST_BYTES):
            if name in columns:
                raise ValueError(f"column {name:.60} comes twice")
            if not cells or len(cells) != len(next(iter(columns.values()), cells)):
                raise ValueError("its columns differ in length")
            columns[name] = cells
    except (lzma.LZMAError, EOFError, csv.Error, ValueError) as error:
        raise ValueError(f"{source} holds no packed rows: {error}") from None
    if not columns:
        raise ValueError(f"{source} holds no packed rows: it is empty")
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


_SAMPLE = packed({"policy": ["lqr", "mpc"], "success": ["1", "0"]})


def _write_sample(folder: Path) -> None:
    (folder / f"rows{SUFFIX}").write_bytes(_SAMPLE)


@reader("rows behind published tables", f"rows{SUFFIX}", _write_sample, of_path)
def read_packed(file: Path) -> list[dict[str, str]]:
    """Returns the rows of a file, as text.

    Raises:
        ValueError: as `unpacked`.
        OSError: if it cannot be opened.
    """
    return unpacked(file.read_bytes(), str(file))
