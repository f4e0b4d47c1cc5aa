"""A world of a team as PettingZoo's ParallelEnv."""

import re
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from wayfield.envs.batch import Results
from wayfield.envs.single import FPS
from wayfield.envs.tasks.specs import CROWDS
from wayfield.envs.teams import TeamEnv, TeamRows, seed_worlds
from wayfield.system.checks import MOST_STEPS, choose, shown, whole
from wayfield.system.checks import seed as check_seed
from wayfield.system.extras import installs

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise DependencyNotInstalled(f"wayfield.parallel_env needs PettingZoo: {installs('multi')}") from error


class ParallelWorld(ParallelEnv[str, NDArray[np.float32], NDArray[np.float32]]):  # type: ignore[misc]
    """One world: agents "robot_0", "robot_1", ...; a robot that has ended is no agent any more.

    World w of the native vector of seed s is this world of seed s + w, bit for bit.

    Args:
        env_id: a registered id of a team.
        max_episode_steps: control periods after which all are truncated; None: as registered.
        kwargs: keyword arguments of the environment, but `ends`.

    Raises:
        ValueError: if the id is none of a team's, or a keyword is wrong.
    """

    def __init__(self, env_id: str, max_episode_steps: int | None = None, **kwargs: Any) -> None:
        ids = [each for spec in CROWDS.values() for each in spec.ids.values()]
        choose("env_id", env_id, ids)
        if kwargs.get("ends", "leave") != "leave":
            raise ValueError(f'ends={kwargs["ends"]!r}: agents of PettingZoo leave; ends must be "leave"')
        env: Any = gymnasium.make(env_id, **kwargs)
        limit = env.spec.max_episode_steps if max_episode_steps is None else max_episode_steps
        whole("max_episode_steps", limit, 1, MOST_STEPS)
        self._env: TeamEnv = env.unwrapped
        self._limit = int(limit)
        self.task = self._env.task
        stem = env_id.partition("/")[2].replace("-", "_")
        self.metadata = {
            "name": "wayfield_" + re.sub(r"(?<=[a-z])(?=[A-Z])", "_", stem).lower(),
            "render_modes": self._env.metadata["render_modes"],
            "render_fps": FPS,
            "is_parallelizable": True,
        }
        self.render_mode = self._env.render_mode
        self._rows = self._env.rows or TeamRows(self.task, self.task.team)
        self._env.batch = self._rows.batch
        self.possible_agents = [f"robot_{r}" for r in range(self.task.team)]
        self.agents: list[str] = []
        most = self.task.options.max_action.astype(np.float32)
        self.observation_spaces: dict[str, gymnasium.spaces.Box] = dict.fromkeys(
            self.possible_agents, self.task.layout.space
        )
        self.action_spaces = {
            agent: gymnasium.spaces.Box(-most, most, dtype=np.float32) for agent in self.possible_agents
        }
        places = self._rows.batch.own.near_places
        self.state_space = gymnasium.spaces.Box(-np.inf, np.inf, (7 * places.shape[2],), np.float32)

    def observation_space(self, agent: str) -> gymnasium.spaces.Box:
        """Returns the space of an agent's observations: the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.spaces.Box:
        """Returns the space of an agent's actions: the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[np.float32]], dict[str, dict[str, Any]]]:
        """Starts an episode of all agents; options["scenario"] chooses as in `wayfield.envs.single.SingleEnv.reset`.

        Raises:
            TypeError, ValueError: as `SingleEnv.reset`.
        """
        check_seed("seed", seed)
        # with which PettingZoo's own checks of an environment begin
        scenarios = self._rows.batch.chosen_scenarios(None if options == {"options": 1} else options)
        seed_worlds(self._rows.generators, self._rows.seeds, [None if seed is None else int(seed)], self.task.team)
        self._env._generators = self._rows.generators
        self.agents = list(self.possible_agents)
        results = Results(self.task, self.task.team)
        self._rows.begin(np.arange(self.task.team), results, scenarios)
        self._env._begin_frames()
        return self._of_agents(results.observations), self._infos(results)

    def step(self, actions: dict[str, NDArray[Any]]) -> tuple[dict[str, Any], ...]:
        """Moves all agents by one control period; returns observations, rewards, ends, truncations and infos.

        Actions of robots that have ended are of no effect.

        Raises:
            TypeError, ValueError: if the actions are not those of all agents, or one is none of the action space's
                shape and finite; nothing has moved then.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded("all agents have ended: call reset before step")
        if not isinstance(actions, Mapping):
            raise TypeError(f"actions must be a dict of one an agent, got {shown(actions)}")
        for agent in actions:
            choose("agent", agent, self.possible_agents)
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"actions lack {missing[0]!r}; there must be one for each of {', '.join(self.agents)}")
        batch = self._rows.batch
        joint = np.zeros((self.task.team, *batch.action_shape))
        for r, agent in enumerate(self.possible_agents):
            if agent in self.agents:
                joint[r] = batch.checked(actions[agent], batch.action_shape)
        results, terminated, truncated = self._rows.step(joint, self._limit)
        if self.render_mode is not None:
            self._env._note_position()
        rewards = results.numbers[-1].tolist()
        said = (
            self._of_agents(results.observations),
            {agent: rewards[self._row(agent)] for agent in self.agents},
            {agent: bool(terminated[self._row(agent)]) for agent in self.agents},
            {agent: bool(truncated[self._row(agent)]) for agent in self.agents},
            self._infos(results),
        )
        self.agents = [agent for agent in self.agents if self._rows.alive[self._row(agent)]]
        return said

    def state(self) -> NDArray[np.float32]:
        """Returns all bodies of the world, 7 numbers each: x, y (m), cos, sin of the heading, vx, vy (m/s), present."""
        own = self._rows.batch.own
        now = own.near_places[own.clocks[0, 0], 0]
        names = ("x", "y", "cos", "sin", "vx", "vy", "present")
        return np.column_stack([now[name] for name in names]).astype(np.float32).ravel()

    def render(self) -> Any:
        """Returns a frame of the world in "rgb_array" mode."""
        return self._env.render()

    def close(self) -> None:
        """Closes the window."""
        self._env.close()

    @staticmethod
    def _row(agent: str) -> int:
        return int(agent.partition("_")[2])

    def _of_agents(self, rows: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        return {agent: rows[self._row(agent)].copy() for agent in self.agents}

    def _infos(self, results: Results) -> dict[str, dict[str, Any]]:
        infos = {name: list(rows) if rows.ndim > 1 else rows.tolist() for name, rows in results.infos().items()}
        return {agent: {name: row[self._row(agent)] for name, row in infos.items()} for agent in self.agents}
