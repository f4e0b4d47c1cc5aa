"""The agents that ship: trained with PPO by `train.py`, ten seeds a task and robot, each a folder of `agents/`."""

import dataclasses
import functools
import re
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following
from wayfield.envs.briefing import Briefing
from wayfield.policies.agent import Agent, load_agent
from wayfield.policies.policy import check_gain, check_whole

TASKS = {path_following.Observation: "path_following", goal_reaching.Observation: "goal_reaching"}


@dataclasses.dataclass(frozen=True)
class Ppo:
    """Drives with the agent of its seed that ships for the task and the robot it is put in.

    What the network sees and does is stated in the agent's card and in `features`. Learned from the training split of
    the scenarios; serves the robots that `shipped` names.
    """

    seed: int = 0  # of the training run
    speed: float = 0.0  # m/s, the most that it drives; 0: the one that it was validated at

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (path_following.Observation, goal_reaching.Observation)

    def __post_init__(self) -> None:
        check_whole(self, "seed")
        check_gain(self, "speed", least=0.0)

    def agent(self, briefing: Briefing) -> Agent:
        """Returns the agent for a briefing.

        Raises:
            ValueError: if none ships for the task and robot, or none of this seed.
        """
        return _loaded(TASKS[briefing.layout.kind], briefing.robot.name, self.seed, self.speed)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the agent's empty memory.

        Raises:
            ValueError: if no agent ships for task, robot and seed, or its card asks for another scan or control period.
        """
        return self.agent(briefing).reset(briefing)

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        return self.agent(briefing).act(observation, briefing, memory)


def shipped(task: str, robot: str) -> dict[int, Path]:
    """Returns the folders of the agents that ship for a task ("path_following", "goal_reaching") and robot, by seed."""
    home = Path(str(resources.files("wayfield.policies"))) / "agents" / f"{task}_{robot}"
    found = {int(each.name[5:]): each for each in home.glob("seed_*") if re.fullmatch(r"seed_\d+", each.name)}
    return dict(sorted(found.items()))


@functools.lru_cache(maxsize=128)
def _loaded(task: str, robot: str, seed: int, speed: float) -> Agent:
    folders = shipped(task, robot)
    if seed not in folders:
        there = f"seeds {', '.join(map(str, folders))}" if folders else "none"
        raise ValueError(f"no agent of seed {seed} ships for {task} with {robot}; there are {there}")
    return load_agent(folders[seed], **({"speed": speed} if speed else {}))
