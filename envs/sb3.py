"""Native vector environments, of one kind or of several side by side, as one VecEnv of stable-baselines3."""

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.tasks.constraints import NAMES
from wayfield.envs.teams import TeamVectorEnv
from wayfield.envs.vector import NativeVectorEnv, chosen
from wayfield.system.checks import shown
from wayfield.system.extras import installs

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise DependencyNotInstalled(f"wayfield.envs.sb3 needs stable-baselines3: {installs('train')}") from error

Array = NDArray[np.float64]
_OWN = ("np_random", "np_random_seed")  # of a vector environment: one a row
_ALTERNATIVE = (
    "robots of a batch are no objects; make them with stable_baselines3.common.env_util.make_vec_env(env_id, num_envs)"
)

_GIVEN = "NativeVecEnv takes an id and the environment's keywords: NativeVecEnv(env_id, 4, robot='husky')"
_OF_MAKE_VEC_ENV = {
    "env_kwargs", "wrapper_class", "wrapper_kwargs", "vec_env_cls", "vec_env_kwargs", "monitor_dir", "monitor_kwargs",
    "start_index", "start_method",
}  # fmt: skip


def _joined(pieces: list[NDArray[Any]]) -> NDArray[Any]:
    """Returns the rows of all pieces: those of a single one as they are, since every step makes its own.

    Rows that are shorter than others are filled up with zeros.
    """
    if len(pieces) == 1:
        return pieces[0]
    width = max(piece.shape[-1] for piece in pieces)
    if pieces[0].ndim < 2 or all(piece.shape[-1] == width for piece in pieces):
        return np.concatenate(pieces)
    return np.concatenate([np.pad(piece, ((0, 0), (0, width - piece.shape[-1]))) for piece in pieces])


def _dicts(infos: Mapping[str, NDArray[Any]], rows: Any = slice(None)) -> list[dict[str, Any]]:
    """Returns the info of each of some rows as a dict of its own, from an array a name."""
    columns = [list(each) if each.ndim > 1 else each.tolist() for each in (values[rows] for values in infos.values())]
    return [dict(zip(infos, row, strict=True)) for row in zip(*columns, strict=True)]


_SAVED_AS = {"delayed": "asked"}  # arrays that states of trainings have by another name


def _taken(name: str, arrays: Mapping[str, NDArray[Any]], there: NDArray[Any]) -> NDArray[Any]:
    """Returns an array of a name like one that is there, from its bytes; ValueError if they are too many or too few."""
    content = arrays[name].tobytes()
    if len(content) != there.nbytes:
        raise ValueError(f"{name} has {len(content)} bytes; it must have {there.nbytes}")
    return np.frombuffer(content, there.dtype).reshape(there.shape)


class NativeVecEnv(VecEnv):
    """Robots of one environment id for stable-baselines3, all stepped by one compiled call: `PPO("MlpPolicy", env)`.

    Row i, seeded seed + i, is the single environment of that seed: observations, rewards, ends, `reset_infos`,
    `set_options`, `terminal_observation` and `TimeLimit.truncated` are those of DummyVecEnv. The info of a row whose
    episode ends holds all that the task tells (`success`, `collision`, ...), `is_success` and, as Monitor writes it,
    `episode`; so `rollout/ep_rew_mean` and `rollout/success_rate` are logged, `evaluate_policy` reports true rewards
    behind VecNormalize, and VecMonitor may take its `info_keywords` from there. Infos of other rows are empty, for
    speed, unless `full_infos` is set; what all rows were told in the last step stands in `infos`, an array a name.

    Args:
        worlds: how many robots; or how many with which further keyword arguments, for each of several worlds, whose
            rows stand one after the other. Observation spaces must agree. The action space has room for what the
            fastest robot can do; what is too fast for another is slowed down to what that can, in the same direction.
        ragged: whether scans may have different numbers of beams; shorter observations are filled up with zeros.
        full_infos: whether the infos of all rows hold all that the task tells, in every step.
        kwargs: keyword arguments of the environment, and max_episode_steps.

    Raises:
        ValueError: if the worlds differ in their observation spaces, or there are none.
    """

    def __init__(
        self,
        env_id: str,
        worlds: int | Sequence[tuple[int, Mapping[str, Any]]] = 1,
        ragged: bool = False,
        full_infos: bool = False,
        **kwargs: Any,
    ) -> None:
        for word in {"num_envs", "n_envs"} & kwargs.keys():
            raise TypeError(f"{word} is called worlds here: NativeVecEnv(env_id, {shown(kwargs[word])})")
        for word in _OF_MAKE_VEC_ENV & kwargs.keys():
            raise TypeError(f"{word} is of make_vec_env; {_GIVEN}, or {_ALTERNATIVE}")
        if not isinstance(env_id, str | EnvSpec):
            raise TypeError(f"env_id is {shown(env_id)}; {_GIVEN}; environments that are made go into DummyVecEnv")
        for word in {"autoreset_mode", "vectorization_mode"} & kwargs.keys():
            raise TypeError(f"{word} is not for NativeVecEnv, whose rows begin anew at once, as those of every VecEnv")
        if not isinstance(worlds, Sequence):
            worlds = [(worlds, {})]
        pairs = (isinstance(each, Sequence) and len(each) == 2 and isinstance(each[1], Mapping) for each in worlds)
        if not worlds or not all(pairs):
            wanted = "a number of robots, or at least one (number, keyword arguments)"
            raise ValueError(f"worlds must be {wanted}, got {shown(worlds)}")
        self.parts: list[NativeVectorEnv] = []
        for count, own in worlds:
            part = gymnasium.make_vec(
                env_id,
                count,
                vectorization_mode="vector_entry_point",
                autoreset_mode="SameStep",
                **{**kwargs, **own},
            )
            assert isinstance(part, NativeVectorEnv)
            if isinstance(part, TeamVectorEnv) and part.waits:
                raise ValueError(
                    f'{env_id} with ends="leave" has robots that wait; ends must be "respawn", so that all rows live'
                )
            self.parts.append(part)
        first = max(self.parts, key=lambda part: part.single_observation_space.shape or ())
        for part in self.parts:
            if not ragged and part.single_observation_space != first.single_observation_space:
                raise ValueError(f"the worlds of {env_id} must have one observation space")
        # stable-baselines3 clips actions to it: that of a slow robot would hold back the others
        actions: list[Any] = [part.single_action_space for part in self.parts]
        fastest = np.max([each.high for each in actions], axis=0)
        self.task = self.parts[0].task
        ends = np.cumsum([part.num_envs for part in self.parts]).tolist()
        self.rows = [slice(end - part.num_envs, end) for end, part in zip(ends, self.parts, strict=True)]
        self.infos: dict[str, NDArray[Any]] = {}
        self.full_infos = full_infos
        self._actions: NDArray[Any] = np.empty(0)
        self._returns = np.zeros(ends[-1])
        self._since = time.time()
        super().__init__(ends[-1], first.single_observation_space, gymnasium.spaces.Box(-fastest, fastest))
        self.metadata = self.parts[0].metadata

    def reset(self) -> NDArray[np.float32]:
        """Starts an episode in every row, with the seeds and options that `seed` and `set_options` were given before.

        Raises:
            TypeError, ValueError: if the options are not a dict for all rows or a list of one a row, or one is wrong.
        """
        options: Any = self._options
        if not isinstance(options, list | tuple) or len(options) != self.num_envs:
            raise ValueError(f"options must be a dict, or a list of {self.num_envs}, got {shown(options)}")
        pieces = []
        for part, rows in zip(self.parts, self.rows, strict=True):
            seeds = self._seeds[rows] if self._seeds[rows.start] is not None else None
            pieces.append(part.reset(seed=seeds, options=options[rows]))
        self._reset_seeds()
        self._reset_options()
        self.infos = self._joined_infos([info for _, info in pieces])
        self.reset_infos = _dicts(self.infos)
        self._returns[:] = 0.0
        return _joined([observations for observations, _ in pieces])

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions (num_envs, ...) of the next step; ValueError if there are more or fewer."""
        if not hasattr(actions, "__len__") or len(actions) != self.num_envs:
            raise ValueError(f"actions must have {self.num_envs} rows, one a robot, got {shown(actions)}")
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Moves every robot by one control period; one whose episode ends starts the next at once."""
        observations, rewards, terminated, truncated, last = self.advance(self._actions)
        ended = terminated | truncated
        self._returns += rewards
        infos: list[dict[str, Any]]
        if self.full_infos:
            infos = _dicts(last | {"TimeLimit.truncated": np.zeros(self.num_envs, np.bool_)})
        else:
            infos = [{} for _ in range(self.num_envs)]
        rows = np.flatnonzero(ended)
        if len(rows):
            seconds = round(time.time() - self._since, 6)
            begun = self._joined_infos([step[4] for step in self._steps], last=False)
            lasts = _dicts(last | {"TimeLimit.truncated": ~terminated}, rows)
            for i, info, first in zip(rows.tolist(), lasts, _dicts(begun, rows), strict=True):
                info["terminal_observation"] = self.final_observation(i)
                info["is_success"] = info["success"]
                steps = round(info["time"] / self.task.options.dt)
                info["episode"] = {"r": round(self._returns.item(i), 6), "l": steps, "t": seconds}
                infos[i], self.reset_infos[i] = info, first
            self._returns[rows] = 0.0
        return observations, rewards.astype(np.float32), ended, infos

    def advance(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.float32], Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, NDArray[Any]]]:
        """Returns observations, rewards, terminated, truncated and info of the step, all rows together.

        Where an episode ended, the observation is the next one's first; all else belongs to the step.
        """
        self._steps: list[tuple[Any, ...]] = [
            part.step(actions[rows]) for part, rows in zip(self.parts, self.rows, strict=True)
        ]
        observations, rewards, terminated, truncated = (_joined([step[k] for step in self._steps]) for k in range(4))
        self.infos = self._joined_infos([step[4] for step in self._steps])
        return observations, rewards, terminated, truncated, self.infos

    def final_observation(self, i: int) -> NDArray[np.float32]:
        """Returns the last observation of the episode of row i that the last step ended."""
        k = self._part(i)
        last: NDArray[np.float32] = self._steps[k][4]["final_obs"][i - self.rows[k].start]
        missing = self.observation_space.shape[0] - len(last)  # type: ignore[index]
        return np.pad(last, (0, missing)) if missing else last  # which would take a third of a step

    def final_observations(self, ended: NDArray[np.int64]) -> NDArray[np.float32]:
        """Returns the last observations (n, size) of the rows that the last step ended."""
        return np.stack([self.final_observation(i) for i in ended.tolist()])

    def _joined_infos(self, infos: list[dict[str, Any]], last: bool = True) -> dict[str, NDArray[Any]]:
        """Returns an array a name: where an episode has ended, what was told last, or what the next one begins with."""
        joined = {}
        more = NAMES if self.task.options.constraints else ()
        for name in (*self.task.info_names, *self.task.flag_names, *more):
            pieces = []
            for info in infos:
                values = info[name]
                if last and "_final_info" in info:
                    values = chosen(info["_final_info"], info["final_info"][name], values)
                pieces.append(values)
            joined[name] = _joined(pieces)
        return joined

    def close(self) -> None:
        """Closes the parts."""
        for part in self.parts:
            part.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Returns a frame of each robot, for `render_mode="rgb_array"`."""
        return [frame for part in self.parts for frame in part.render() or [None] * part.num_envs]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Returns True for each row if it is Monitor that is asked for, whose `episode` the infos have."""
        return [issubclass(Monitor, wrapper_class) for _ in self._each(indices)]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute of each row: its own space or generator, all else of the vector that it is a row of."""
        values = []
        for k, i in self._each(indices):
            part = self.parts[k]
            value = getattr(part, f"single_{attr_name}" if hasattr(part, f"single_{attr_name}") else attr_name)
            if attr_name in _OWN and not value:
                raise gymnasium.error.ResetNeeded(f"call reset before {attr_name}")
            values.append(value[i] if attr_name in _OWN else value)
        return values

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuses: robots of a batch have no attributes of their own."""
        raise NotImplementedError(f"set_attr({attr_name!r}): {_ALTERNATIVE}")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuses: robots of a batch have no methods of their own."""
        raise NotImplementedError(f"env_method({method_name!r}): {_ALTERNATIVE}")

    def _each(self, indices: Any) -> list[tuple[int, int]]:
        """Returns the part of each of the rows asked for, and its row there; IndexError if there is no such row."""
        rows = [range(self.num_envs)[i] for i in self._get_indices(indices)]
        return [(k := self._part(i), i - self.rows[k].start) for i in rows]

    def _part(self, i: int) -> int:
        """Returns which world row i belongs to."""
        return next(k for k, rows in enumerate(self.rows) if i < rows.stop)

    # ---- all that decides what comes next, as plain arrays and numbers

    ARRAYS = ("states", "obstacles", "noise", "delayed", "columns")

    def arrays(self) -> dict[str, NDArray[np.uint8]]:
        """Returns the bytes of all robots' states."""
        return {
            f"world_{k}.{_SAVED_AS.get(name, name)}": np.frombuffer(getattr(part.batch, name).tobytes(), np.uint8)
            for k, part in enumerate(self.parts)
            for name in self.ARRAYS
        } | {
            f"world_{k}.own_{j}": np.frombuffer(each.tobytes(), np.uint8)
            for k, part in enumerate(self.parts)
            for j, each in enumerate(part.batch.own)
        }

    def generators(self) -> list[Any]:
        """Returns the states of the robots' random generators."""
        return [generator.bit_generator.state for part in self.parts for generator in part.np_random]

    def restore(self, arrays: Mapping[str, NDArray[Any]], generators: Iterable[Any]) -> None:
        """Puts all robots back into the states that `arrays` and `generators` returned.

        Raises:
            ValueError: naming the array or the field, if a state cannot be one of these robots.
        """
        remaining = iter(generators)
        for k, part in enumerate(self.parts):
            saved = {
                name: _taken(f"world_{k}.{_SAVED_AS.get(name, name)}", arrays, getattr(part.batch, name))
                for name in self.ARRAYS
            }
            own = tuple(_taken(f"world_{k}.own_{j}", arrays, each) for j, each in enumerate(part.batch.own))
            # makes the generators, and all that a scenario decides
            part.reset(seed=0, options={"scenario": part.task.scenario_of(saved["states"])})
            part.batch.put_back(saved, own)
            for generator in part.np_random:
                generator.bit_generator.state = next(remaining)
