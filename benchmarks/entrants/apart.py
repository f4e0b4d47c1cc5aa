"""A policy of the user's own in a process of its own, to which goes what a policy may see, and nothing else.

Environments, scenarios and the rows that it is compared with stay in the process that asks. What is asked is pickled;
answers are JSON and plain numbers, since to unpickle what another process sends is to run it.
"""

import json
import multiprocessing
import sys
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.benchmarks.episodes.rollout import faults_of
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.policy import Policy
from wayfield.system.checks import shown

SECONDS = 10.0  # of a decision for all robots of a batch
FIRST_SECONDS = 120.0  # of a load and of a first decision, which may compile
_MOST = 2**26  # bytes of an answer
_COUNTED = np.dtype([("no_path", np.int64)])  # what is known here of a memory that stays there


class Apart:
    """An `Entrant` whose policy is imported, loaded and asked in a process of its own; use it as a context.

    Args:
        source: as `own_policy` takes it.
        seconds: that a decision may take.

    Raises:
        ValueError: in one line, as `own_policy`, and where a policy does not answer in time.
    """

    def __init__(self, source: str, seconds: float = SECONDS) -> None:
        context = multiprocessing.get_context("spawn")
        self._seconds = seconds
        self._end, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(source, theirs), daemon=True)
        self._process.start()
        theirs.close()
        self.name = source.partition(" ")[0]
        about = self._request(FIRST_SECONDS, "load")
        self.name, self.gains_name, self.digest = (str(about[key]) for key in ("name", "gains_name", "digest"))
        self.gains: Mapping[str, Any] = dict(about["gains"])
        self._about = about

    def __enter__(self) -> "Apart":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()
        self._end.close()

    def make(self, gains: Mapping[str, Any]) -> Policy:
        """Returns the policy, which is there already."""
        del gains  # those that it was named with
        return _RemotePolicy(self, str(self._about["knows"]), _types(self._about["observes"]))

    def cruising(self, speed: float) -> None:
        """Returns None: entries drive with the gains that they were named with."""
        del speed

    def described(self) -> tuple[str, str]:
        """Returns how many numbers it is made of and what they were learned from, as it says."""
        parameters, learned = self._about["described"]
        return str(parameters), str(learned)

    def request(self, first: bool, *words: Any) -> tuple[dict[str, Any], NDArray[np.float64]]:
        """Returns the answer to a request, and its numbers."""
        answer = self._request(FIRST_SECONDS if first else self._seconds, *words)
        return answer, np.frombuffer(self._received(self._seconds, words[0]))

    def _request(self, seconds: float, *words: Any) -> dict[str, Any]:
        try:
            self._end.send(words)
        except OSError:
            raise self._ended() from None
        answer = self._received(seconds, words[0])
        try:
            reply = json.loads(answer)
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{self.name!r}: {words[0]} gave no answer that can be read: {error}") from None
        if not isinstance(reply, dict) or "error" in reply:
            raise ValueError(str(reply["error"]) if isinstance(reply, dict) else f"{self.name!r} says {shown(reply)}")
        return reply

    def _received(self, seconds: float, what: str) -> bytes:
        try:
            if not self._end.poll(seconds):
                self._process.kill()
                raise TimeoutError
            return self._end.recv_bytes(_MOST)
        except TimeoutError:
            raise ValueError(f"{self.name!r}: {what} took over {seconds:g} s; no decision may") from None
        except (EOFError, OSError):
            raise self._ended() from None

    def _ended(self) -> ValueError:
        self._process.join(20.0)
        return ValueError(f"{self.name!r}: its process ended with status {self._process.exitcode}")


class _RemotePolicy:
    """The policy of another process, as it is asked here."""

    def __init__(self, entrant: Apart, knows: str, observes: tuple[type, ...]) -> None:
        self._entrant, self.knows, self.observes, self._first = entrant, knows, observes, True

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what stands for the memory here: how often each robot's policy fell back on something else."""
        self._entrant.request(True, "reset", briefing)
        return np.zeros(briefing.num_envs, _COUNTED)

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns its twists (b, t), and counts in the memory; ValueError if they are none, as `Checked` has them."""
        answer, twists = self._entrant.request(self._first, "act", observation)
        self._first = False
        if twists.size != briefing.num_envs * len(briefing.robot.twist_axes) or not np.isfinite(twists).all():
            raise ValueError(f"{self._entrant.name!r}: act sent {twists.size} numbers that are no twists")
        memory["no_path"] = answer["faults"]
        return twists.reshape(briefing.num_envs, -1)


def _types(names: list[str]) -> tuple[type, ...]:
    """Returns those of the named types that are observations of ours."""
    loaded = {name: module for name, module in sys.modules.items() if name.startswith("wayfield.envs.")}
    classes = [getattr(loaded.get(each.rpartition(".")[0]), each.rpartition(".")[2], None) for each in names]
    return tuple(each for each in classes if isinstance(each, type))


# ---- in the other process


def _serve(source: str, end: Connection) -> None:
    """Answers until nobody asks any more: each time JSON, and the numbers that belong to it, as bytes."""
    policy: Any = None
    briefing: Any = None
    memory: Any = None
    while True:
        numbers = b""
        try:
            what, *given = end.recv()
            if what == "load":
                entrant = own_policy(source)
                policy = entrant.make(entrant.gains)
                answer: dict[str, Any] = {name: getattr(entrant, name) for name in ("name", "gains_name", "digest")}
                answer |= {"gains": dict(entrant.gains), "described": entrant.described(), "knows": policy.knows}
                answer["observes"] = [f"{each.__module__}.{each.__name__}" for each in policy.observes]
            elif what == "reset":
                (briefing,) = given
                memory = policy.reset(briefing)
                answer = {}
            else:
                numbers = np.ascontiguousarray(policy.act(*given, briefing, memory)).tobytes()
                answer = {"faults": [faults_of(memory, i) for i in range(len(memory))]}
        except EOFError:
            return
        except ValueError as error:
            answer, numbers = {"error": str(error)}, b""
        end.send_bytes(json.dumps(answer).encode())
        if "error" not in answer and what != "load":
            end.send_bytes(numbers)
