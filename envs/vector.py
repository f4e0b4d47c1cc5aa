"""The gymnasium.vector.VectorEnv shell: a batch of many robots, stepped by one compiled call."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from wayfield.envs.batch import Batch, Results
from wayfield.envs.robots.records import Array, Flags
from wayfield.envs.single import SingleEnv, check_keywords
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.constraints import Constraint
from wayfield.system.checks import MOST_ENVS, MOST_STEPS, MOST_THREADS, choose, shown, whole
from wayfield.system.checks import seed as check_seed

_BATCH_KEYWORDS = ("num_envs", "max_episode_steps", "autoreset_mode", "num_threads")
Step = tuple[NDArray[np.float32], Array, Flags, Flags, dict[str, Any]]
Seeds = int | Sequence[int | None] | NDArray[np.integer[Any]] | None
AUTORESET_MODES = {"NextStep": AutoresetMode.NEXT_STEP, "SameStep": AutoresetMode.SAME_STEP}


def chosen(rows: NDArray[np.bool_], values: NDArray[Any], others: NDArray[Any]) -> NDArray[Any]:
    """Returns the values (b, ...) of some rows, and the others of the rest."""
    return np.where(rows.reshape(-1, *(1,) * (values.ndim - 1)), values, others)


class NativeVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Many robots of one registered environment; row i, seeded seed + i, equals the single environment bit for bit.

    Args:
        single: the registered class; its task and spaces serve the whole batch.
        num_envs: number of robots.
        max_episode_steps: the clock, counted here because no TimeLimit wrapper is applied; None is no clock.
        autoreset_mode: "NextStep" (an ended robot is reset by the step after, which moves nothing and is no
            transition) or "SameStep" (reset at once; info has `final_obs` and `final_info`).
        num_threads: threads that share the robots out; the results are the same for every number, bit for bit. More
            than one pays from some hundred robots on; where several processes work side by side, leave it at 1.
    """

    def __init__(
        self,
        single: Callable[..., SingleEnv],
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        num_threads: int = 1,
        **kwargs: Any,
    ) -> None:
        whole("num_envs", num_envs, 1, MOST_ENVS)
        whole("num_threads", num_threads, 1, MOST_THREADS)
        if max_episode_steps is not None:
            whole("max_episode_steps", max_episode_steps, 1, MOST_STEPS)
        if isinstance(autoreset_mode, AutoresetMode):
            autoreset_mode = autoreset_mode.value
        choose("autoreset_mode", autoreset_mode, AUTORESET_MODES)
        self.autoreset_mode = AUTORESET_MODES[autoreset_mode]
        check_keywords(single, kwargs, _BATCH_KEYWORDS)
        env = single(**kwargs)
        self.metadata = {**env.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode, self.frame_size = env.render_mode, env.frame_size
        if self.render_mode == "human":
            raise ValueError('render_mode="human" shows one robot: use gymnasium.make, or "rgb_array" here')
        self.task = env.task
        env.close()
        self.num_envs = num_envs
        self.max_episode_steps = max_episode_steps
        most = env.task.options.max_action.astype(np.float32)
        self.single_observation_space = env.task.layout.space
        self.single_action_space = gymnasium.spaces.Box(-most, most, dtype=np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.batch = Batch(env.task, num_envs, num_threads)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._shape = (num_envs, *self.batch.action_shape)
        self._all = np.ones(num_envs, np.bool_)
        self._ended = np.zeros(num_envs, np.bool_)
        self._renderers: list[Any] = []
        self._together = 1  # rows of one world, which are seeded together
        self._beside = True  # whether ended robots may begin anew while others move
        # (b,) who is left where it stands, neither moved nor begun anew: what steps tell of it means nothing
        self.resting = np.zeros(num_envs, np.bool_)

    def __getstate__(self) -> dict[str, Any]:
        """Returns what pickle and copy take: the state, mid-episode too, and the generators."""
        return vars(self) | {"_renderers": []}

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Returns the generators of the rows."""
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Returns the seeds of the rows."""
        return tuple(self._seeds)

    def reset(
        self, *, seed: Seeds = None, options: dict[str, Any] | Sequence[dict[str, Any] | None] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts an episode in every row; row i is seeded seed + i. See gymnasium.vector.VectorEnv.reset.

        `options={"scenario": k}` starts the scenario with index k of the bank, or k[i] in row i, instead of drawn ones;
        later resets of ended episodes draw again. A list of such dicts has one a row.
        """
        if isinstance(options, list | tuple) and len(options) == self.num_envs:
            scenarios = self.batch.chosen_of_each(options)
        else:
            scenarios = self.batch.chosen_scenarios(options)
        if isinstance(seed, np.ndarray):
            seed = seed.tolist()
        if isinstance(seed, int | np.integer):
            check_seed("seed", seed)
            check_seed(f"seed (of the last of {self.num_envs} robots)", int(seed) + self.num_envs - 1)
            seeds: list[int | None] = [int(seed) + i // self._together for i in range(self.num_envs)]
        elif seed is None or isinstance(seed, list | tuple | range):
            seeds = [None] * self.num_envs if seed is None else list(seed)
        else:
            raise ValueError(f"seed must be an int, a list of {self.num_envs} ints, or None, got {shown(seed)}")
        if len(seeds) == self.num_envs // self._together:
            seeds = [each for each in seeds for _ in range(self._together)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be an int or {self.num_envs} of them, got {len(seeds)}")
        for i, each in enumerate(seeds):
            check_seed(f"seed[{i}]", each)
        self._seed([None if each is None else int(each) for each in seeds])
        results = Results(self.task, self.num_envs)
        self.batch.reset(np.arange(self.num_envs), self._generators, results, scenarios)
        self._ended[:] = self.resting[:] = False
        return results.observations, self._info(results)

    def _seed(self, seeds: list[int | None]) -> None:
        """Seeds the rows; None leaves a generator as it is, or takes a fresh one where there is none."""
        if not self._generators:
            self._generators, self._seeds = map(list, zip(*map(seeding.np_random, seeds), strict=True))
            return
        for i, each in enumerate(seeds):
            if each is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(each)

    def step(self, actions: NDArray[np.float32]) -> Step:
        """Moves every robot by one control period; see gymnasium.vector.VectorEnv.step."""
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before step")
        if type(actions) is not np.ndarray or actions.dtype.kind != "f" or actions.shape != self._shape:
            actions = self.batch.checked(actions, self._shape)
        batch = self.batch
        batch.actions[:] = actions
        np.logical_or(self._ended, self.resting, out=batch.skip)
        results = Results(self.task, self.num_envs)
        info: dict[str, Any] = {}
        meanwhile = partial(self._meanwhile, self._ended, results, info)
        batch.step(self._generators, results, meanwhile if self._beside else None)
        if not self._beside:
            meanwhile()
        if self.max_episode_steps is None:
            truncated = np.zeros(self.num_envs, np.bool_)
        else:
            truncated = batch.states["steps"] >= self.max_episode_steps
        terminated = results.flags[-1]
        ended = (terminated | truncated) > self.resting  # and not
        return self._with_rows_begun(ended, results, terminated, truncated, info)

    def _with_rows_begun(
        self, ended: Flags, results: Results, terminated: Flags, truncated: Flags, info: dict[str, Any]
    ) -> Step:
        """Returns what a step gives; rows that have ended begin anew, now or with the next step."""
        rewards = results.numbers[-1]
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            self._ended = ended
            return results.observations, rewards, terminated, truncated, info
        rows = np.flatnonzero(ended)
        if len(rows):
            info |= self._last_of(ended, results)
            rewards, terminated = rewards.copy(), terminated.copy()
            self._begin(rows, results)
        return results.observations, rewards, terminated, truncated, info

    def _begin(self, rows: NDArray[np.int64], results: Results) -> None:
        """Begins rows anew."""
        self.batch.reset(rows, self._generators, results)

    def _last_of(self, ended: NDArray[np.bool_], results: Results) -> dict[str, Any]:
        """Returns what the robots that have ended saw last and what was told of them, under Gymnasium's names."""
        seen = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended).tolist():
            seen[i] = results.observations[i].copy()
        last = {"final_info": self._info(results, ended), "_final_info": ended.copy()}
        return {"final_obs": seen, "_final_obs": ended} | last

    def _meanwhile(self, ended: NDArray[np.bool_], results: Results, info: dict[str, Any]) -> None:
        """Resets the robots that have ended and fills the info, whose arrays others may still be writing."""
        again = np.flatnonzero(ended > self.resting)  # and not
        if len(again):
            self.batch.reset(again, self._generators, results)
        info.update(self._info(results))

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns a frame (h, w, 3) of each robot in "rgb_array" mode."""
        if self.render_mode is None:
            return None
        from wayfield.envs.rendering import Renderer

        if not self._renderers:
            fps = self.metadata["render_fps"]
            self._renderers = [Renderer("rgb_array", fps, self.frame_size) for _ in range(self.num_envs)]
        nothing = np.empty((0, 2))
        return tuple(r.draw(self.batch.scene(i, nothing, {})) for i, r in enumerate(self._renderers))

    def close_extras(self, **kwargs: Any) -> None:
        """Closes the renderers; with dynamics="coppelia", leaves the robot standing."""
        if "batch" not in vars(self):  # arguments were refused: Gymnasium closes what was never made
            return
        self.batch.close()
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """Returns what base and task allow: see `SingleEnv.constraints`."""
        return self.task.constraints

    def briefing(self, knows: str) -> Briefing:
        """Returns the briefing of the episodes that were just reset, for a policy that declares `knows`."""
        return self.batch.briefing(knows)

    def _info(self, results: Results, mask: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Returns Gymnasium's vector info: an array and a mask for each name; rows outside the mask hold zero."""
        info: dict[str, Any] = {}
        rows = self._all.copy() if mask is None else mask
        for name, values in results.infos().items():
            info[name] = values if mask is None else chosen(rows, values, np.zeros_like(values))
            info[f"_{name}"] = rows
        return info


def vector_of(single: type[SingleEnv], shell: type[NativeVectorEnv] = NativeVectorEnv) -> type[NativeVectorEnv]:
    """Returns the registered class of many robots of a class, whose name is that with "Vector" behind it."""

    def __init__(self: NativeVectorEnv, num_envs: int = 1, **kwargs: Any) -> None:
        shell.__init__(self, single, num_envs, **kwargs)

    name = f"{single.__name__}Vector"
    about = f"Many `{single.__name__}` robots stepped by one compiled call; the same keyword arguments."
    members = {"__init__": __init__, "__doc__": about, "__module__": single.__module__, "__qualname__": name}
    return type(name, (shell,), members)
