"""A search that several processes or machines do together: a study of Optuna in a journal file, or in a database."""

import contextlib
import dataclasses
import datetime
import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import optuna
from optuna.storages.journal import JournalFileBackend

from wayfield.benchmarks.contests.contest import Score
from wayfield.system.readers import reader
from wayfield.system.reading import parsed_object

_ENQUEUED = 30.0  # s, that the process that made a study has for its first sets
_LOST = 10.0  # times as long as the longest set took, after which one that is under way counts as its process's last
_LEAST = 60.0  # s, of that
_LONGEST = 1_000_000  # bytes of a line
_FRAMES, _SCORE, _GAINS = "frames", "score", "gains"


class NoStudy(ValueError):
    """A study cannot be opened; the message names it."""


class SharedStudy:
    """The sets of a search, of this process and of others, each driven once.

    Args:
        where: a file, which is made where there is none, or the URL of a database, such as sqlite:///found.db or
            postgresql://host/name.
        name: of the search: another one in the same place is another study.
        starts: sets that are tried first.

    Raises:
        NoStudy: if there is something else in that place, or nothing can be written there.
    """

    def __init__(self, where: str, name: str, starts: Sequence[Mapping[str, float]]) -> None:
        self.where = where
        with self._named():
            storage: Any = where
            if "://" not in where:
                _checked_journal(where)
                storage = optuna.storages.JournalStorage(JournalFileBackend(where))
            # of no seed: processes that draw alike would try the same sets
            sampler = optuna.samplers.TPESampler()
            try:
                self.study = optuna.create_study(storage=storage, sampler=sampler, study_name=name)
                for start in starts:
                    self.study.enqueue_trial(dict(start))
            except optuna.exceptions.DuplicatedStudyError:
                self.study = optuna.load_study(storage=storage, sampler=sampler, study_name=name)
                late = time.monotonic() + _ENQUEUED
                while len(self.study.trials) < len(starts) and time.monotonic() < late:
                    time.sleep(0.1)

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # of whatever database
            message = " ".join(str(error).split()).removeprefix(f"{self.where}: ")[:300] or type(error).__name__
            raise NoStudy(f"--study {self.where!r} cannot be used: {message}") from None

    @property
    def frames(self) -> int:
        """Returns the frames that were driven for the search, by all."""
        return sum(trial.user_attrs.get(_FRAMES, 0) for trial in self.study.trials)

    @property
    def begun(self) -> int:
        """Returns how many sets were begun, by all."""
        return sum(trial.state != optuna.trial.TrialState.WAITING for trial in self.study.trials)

    def tell(self, trial: optuna.Trial, score: Score, gains: Mapping[str, Any]) -> None:
        """Keeps what became of a set."""
        trial.set_user_attr(_FRAMES, score.frames)
        trial.set_user_attr(_SCORE, json.dumps(dataclasses.asdict(score)))  # as text: databases know no NaN
        trial.set_user_attr(_GAINS, json.dumps(dict(gains)))
        self.study.tell(trial, score.value)

    def scored(self) -> list[tuple[Score, dict[str, Any]]]:
        """Returns the sets that were driven, in the order in which they were begun."""
        state = optuna.trial.TrialState.COMPLETE
        done = [trial for trial in self.study.trials if trial.state == state and _SCORE in trial.user_attrs]
        return [(Score(**json.loads(trial.user_attrs[_SCORE])), json.loads(trial.user_attrs[_GAINS])) for trial in done]

    def others(self) -> int:
        """Returns how many sets other processes are driving; those of processes that are gone are left out in time."""
        trials = self.study.trials
        lengths = [trial.duration.total_seconds() for trial in trials if trial.duration is not None]
        most = datetime.timedelta(seconds=max(_LEAST, _LOST * max(lengths, default=0.0)))
        running = [trial for trial in trials if trial.state == optuna.trial.TrialState.RUNNING]
        now = datetime.datetime.now()
        return sum(trial.datetime_start is not None and now - trial.datetime_start < most for trial in running)


_SAMPLE = {"found.journal": '{"op_code": 0, "worker_id": "a", "study_name": "b", "directions": [1]}\n'}


@reader("journal of a search", "found.journal", _SAMPLE)
def _checked_journal(file: str) -> dict[str, Any]:
    """Returns the first entry of a journal, nothing where there is none yet: what is opened as one is written to.

    Raises:
        ValueError: if a file is there that is no journal; the message names it.
    """
    if not os.path.lexists(file) or not os.path.getsize(file):
        return {}
    with open(file, "rb") as stream:
        line = stream.readline(_LONGEST)
    if not isinstance(entry := parsed_object(line, file), dict) or "op_code" not in entry:
        raise ValueError(f"{file}: it is there, and no journal of a search")
    return entry
