"""Agents by their seed: those that ship, five or ten a task and robot, or those of a folder that `train.py` wrote."""

import contextlib
import dataclasses
import functools
import re
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following, trajectory_tracking
from wayfield.envs.robots import Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.agent import PACE_TIME, PATIENCE, Agent, body_of, load_agent
from wayfield.policies.parts.gain import Gains, gain
from wayfield.system.checks import LAST_SEED


@dataclasses.dataclass(frozen=True)
class Ppo(Gains):
    """Drives with the agent of its seed that ships for the task and the robot it is put in, or with one of your own.

    What the network sees and does is stated in the agent's card and in `features`. Learned from the training split of
    the scenarios; those that ship serve the robots that `shipped` names. Where a law has a part in it, `Agent` says so:
    it ends the way to a goal, and drives on where the network makes no way to a dock or along a path.
    """

    seed: int = gain(0, "1", "of the training run", most=LAST_SEED)
    speed: float = gain(0.0, "m/s", "the mean on a path, to a goal the most; 0: as validated", least=0.0)
    home: str = gain("", "", "of training runs, as train.py's --out; '': the agents that ship", words="a folder")
    pace_time: float = gain(PACE_TIME, "s", "in which it makes up what it is late by, on a path; 0: never", least=0.0)
    patience: float = gain(
        PATIENCE, "s", "without way to a dock or along a path, after which a law drives; 0: never", least=0.0
    )

    observes: ClassVar[tuple[type, ...]] = (
        path_following.Observation,
        trajectory_tracking.Observation,
        goal_reaching.Observation,
    )
    among: ClassVar[str] = ""  # behind the task, in the names of the folders of agents among bodies
    privileged: ClassVar[str] = "sensors"  # the privileged information of those that ship

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.home, str) or (self.home and not trained(self.home)):
            raise ValueError(f"Ppo: home must be a folder of training runs, with seed_N/best in it, got {self.home!r}")

    @property
    def knows(self) -> str:
        """Returns its privileged information: of agents of one's own, what their card says.

        Raises:
            ValueError: if the folder holds no agent of the seed, or a damaged one.
        """
        return self._own.knows if self.home else self.privileged

    def agent(self, briefing: Briefing) -> Agent:
        """Returns the agent for a briefing.

        Raises:
            ValueError: if none ships for the task and robot, or none of this seed.
        """
        task, robot = briefing.task.name, body_of(briefing.robot).name
        if self.home:
            if self._own.card["task"] != task:
                raise ValueError(f"{self.home} holds agents for {self._own.card['task']}, not for {task}")
            return self._own
        return shipped_agent(self.agents_of(task), robot, self.seed, **self._gains)

    @classmethod
    def agents_of(cls, task: str) -> str:
        """Returns under which name the agents of a task, by its name, ship that this policy drives with."""
        return f"{task}_{cls.among}" if cls.among else task

    def trained_with(self, robot: Robot) -> bool:
        """Returns whether an agent of one's own was trained with a robot as it is; see `Agent.trained_with`."""
        return bool(self.home) and self._own.trained_with(robot)

    @functools.cached_property
    def _own(self) -> Agent:
        return _loaded(trained(self.home), self.seed, f"is in {self.home}", **self._gains)

    @property
    def _gains(self) -> dict[str, float]:
        return {"speed": self.speed, "pace_time": self.pace_time, "patience": self.patience}

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the agent's empty memory.

        Raises:
            ValueError: if no agent ships for task, robot and seed, or its card asks for another scan or control period.
        """
        return self.agent(briefing).reset(briefing)

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        return self.agent(briefing).act(observation, briefing, memory)


_instead: dict[str, Path] = {}


@contextlib.contextmanager
def in_place_of(name: str, home: Path) -> Iterator[None]:
    """Lets agents of one's own, in a folder of training runs, drive in this process where those that ship would.

    Args:
        name: of the folder of those that ship, a task and a robot.
    """
    _instead[name] = home
    shipped_agent.cache_clear()
    try:
        yield
    finally:
        del _instead[name]
        shipped_agent.cache_clear()


def shipped(task: str, robot: str) -> dict[int, Path]:
    """Returns the folders of the agents that ship for a task, as `Ppo.agents_of` names it, and robot, by seed."""
    name = f"{task}_{robot}"
    if name in _instead:
        return trained(str(_instead[name]))
    return _by_seed(Path(str(resources.files("wayfield.policies"))) / "agents" / name)


@functools.lru_cache(maxsize=128)
def shipped_agent(task: str, robot: str, seed: int, speed: float = 0.0, **gains: float) -> Agent:
    """Returns the agent of a seed that ships for a task, as `Ppo.agents_of` names it, and robot.

    Args:
        speed: m/s, the most that it drives; 0: the one that it was validated at.
        gains: others of `load_agent`.

    Raises:
        ValueError: if none ships for them, or none of this seed, or its folder is damaged.
    """
    return _loaded(shipped(task, robot), seed, f"ships for {task} with {robot}", speed, **gains)


def trained(home: str) -> dict[int, Path]:
    """Returns the folders of the best agents of the training runs in a folder, by seed."""
    runs = {seed: folder / "best" for seed, folder in _by_seed(Path(home)).items()}
    return {seed: folder for seed, folder in runs.items() if folder.is_dir()}


def _by_seed(home: Path) -> dict[int, Path]:
    result = {int(each.name[5:]): each for each in home.glob("seed_*") if re.fullmatch(r"seed_(0|[1-9]\d*)", each.name)}
    return dict(sorted(result.items()))


def _loaded(folders: dict[int, Path], seed: int, what: str, speed: float, **gains: float) -> Agent:
    if seed not in folders:
        there = f"seeds {', '.join(map(str, folders))}" if folders else "none"
        raise ValueError(f"no agent of seed {seed} {what}; there are {there}")
    return load_agent(folders[seed], **gains, **({"speed": speed} if speed else {}))
