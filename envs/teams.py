"""The environments of teams: single, native vector, and what both and PettingZoo's form are made of."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from wayfield.envs.batch import Batch, Results
from wayfield.envs.robots import robots_with
from wayfield.envs.single import SingleEnv
from wayfield.envs.tasks.arguments import arguments_table
from wayfield.envs.tasks.sheets import OMNI_ACTIONS, sheet_like
from wayfield.envs.team_worlds import TeamArguments, Teams
from wayfield.envs.vector import NativeVectorEnv, Seeds, Step, vector_of
from wayfield.system.checks import seed as check_seed

_MOST_TRAILS = 32  # robots whose ways are drawn
_NOTED = 4  # control periods, between two places of a trail


def spread(generator: np.random.Generator, seed: int, team: int) -> list[np.random.Generator]:
    """Returns a generator a robot of a world: the first has the world's own, each other one spawned from its seed."""
    return [generator] + [
        np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(r,)))) for r in range(team - 1)
    ]


def seed_worlds(generators: list[np.random.Generator], taken: list[int], seeds: list[int | None], team: int) -> None:
    """Seeds the worlds whose rows have these generators; None leaves one's as they are, or takes fresh ones.

    Args:
        generators: of all rows, or empty; changed in place.
        taken: the seeds that worlds have, changed in place.
    """
    fresh = not generators
    for w, each in enumerate(seeds):
        if fresh or each is not None:
            generator, seed = seeding.np_random(each)
            generators[w * team : (w + 1) * team] = spread(generator, seed, team)
            taken[w : w + 1] = [seed]


class TeamRows:
    """The robots of worlds whose episodes end one by one: a robot that has ended waits until its world is over."""

    def __init__(self, task: Teams, num_envs: int, num_threads: int = 1) -> None:
        self.task = task
        self.team = task.team
        self.batch = Batch(task, num_envs, num_threads)
        self.num_envs = num_envs
        self.generators: list[np.random.Generator] = []
        self.seeds: list[int] = []
        self.alive = np.zeros(num_envs, np.bool_)
        self.took_part = np.zeros(num_envs, np.bool_)
        self._last = Results(task, num_envs)  # of robots that wait: what their last step wrote

    def begin(self, rows: NDArray[np.int64], results: Results, scenarios: NDArray[np.int64] | None = None) -> None:
        """Begins whole worlds, given by all of their rows, and writes their results."""
        self.batch.reset(rows, self.generators, results, scenarios)
        self.alive[rows] = True
        self.took_part[rows] = True

    def step(
        self, actions: NDArray[Any], limit: int | None, meanwhile: Callable[[Results], None] | None = None
    ) -> tuple[Results, NDArray[np.bool_], NDArray[np.bool_]]:
        """Returns what a step wrote, and which robots were terminated and truncated in it.

        Args:
            limit: control periods after which all are truncated; None: there is no clock.
            meanwhile: done beside the step: for worlds all of whose robots have ended.

        Raises:
            ValueError: if the action of a robot that has not ended is not finite; nothing has moved then.
        """
        batch = self.batch
        batch.actions[:] = actions
        batch.skip[:] = ~self.alive
        moved = self.alive.copy()
        results = Results(self.task, self.num_envs)
        batch.step(self.generators, results, None if meanwhile is None else partial(meanwhile, results))
        waiting = np.flatnonzero(~moved & ~self.alive)
        if len(waiting):
            results.take(waiting, self._last)
        self.took_part = moved | self.alive
        terminated = results.flags[-1] & moved
        truncated = np.zeros(self.num_envs, np.bool_)
        if limit is not None:
            truncated = moved & (batch.states["steps"] >= limit) & ~terminated
        ended = np.flatnonzero(terminated | truncated)
        if len(ended):
            self.alive[ended] = False
            last = self._last
            last.take(ended, results)
            last.numbers[-1, ended] = 0.0
            last.flags[-1, ended] = False
        return results, terminated, truncated

    def over(self) -> NDArray[np.bool_]:
        """Returns whether each row's world is over: all of its robots have ended."""
        return np.repeat(~self.alive.reshape(-1, self.team).any(axis=1), self.team)


class TeamEnv(SingleEnv):
    """One world: a robot alone among others, or a team of n, whose rows are those of actions and observations.

    With several robots the reward is the mean over those that took part, and the episode is terminated when all have
    ended; `info` has an array a name, and "alive" says which robots took part in the step.
    """

    task: Teams
    rows: TeamRows | None

    def _lay_out(self) -> None:
        task, self.rows = self.task, None
        if task.team == 1:
            super()._lay_out()
            return
        most = task.options.max_action.astype(np.float32)
        self.rows = TeamRows(task, task.team)
        self.batch = self.rows.batch
        self.observation_space = batch_space(task.layout.space, task.team)
        self.action_space = batch_space(gymnasium.spaces.Box(-most, most, dtype=np.float32), task.team)
        self.marks = {}
        self._shape = (task.team, *self.batch.action_shape)
        self._generators = []
        self._trail = []
        self._trails: list[NDArray[np.float64]] = []
        self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        """Returns what pickle and copy take: the state, mid-episode too, and the generators; no window."""
        return super().__getstate__() if self.rows is None else vars(self) | {"_renderer": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if self.rows is None:
            self._wire()

    def _begin_frames(self) -> None:
        self._trails = []
        super()._begin_frames()

    def _note_position(self) -> None:
        """Notes where all robots are, now and then: a trail is drawn from few points."""
        if self.rows is None:
            super()._note_position()
            return
        states = self.batch.states
        if self.task.team <= _MOST_TRAILS and int(states["steps"].max()) % _NOTED == 0:
            self._trails.append(np.column_stack([states["x"], states["y"]]))
        if self.render_mode == "human":
            self._draw()

    def scene(self) -> Any:
        """Returns the rendering.Scene of this moment: of a team the first robot, with the others beside it."""
        if self.rows is None:
            return super().scene()
        trails = np.array(self._trails).reshape(-1, self.task.team, 2)
        return self.batch.scene(0, trails[:, 0], self.marks, trails)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode of the whole world; see `SingleEnv.reset`."""
        if self.rows is None:
            return super().reset(seed=seed, options=options)
        if self.task.ends != "leave":
            raise ValueError(f'ends={self.task.ends!r} is for native vectors, whose rows never wait; use "leave" here')
        check_seed("seed", seed)
        scenarios = self.batch.chosen_scenarios(options)
        gymnasium.Env.reset(self, seed=None if seed is None else int(seed))
        seed_worlds(self.rows.generators, self.rows.seeds, [None if seed is None else int(seed)], self.task.team)
        self._generators = self.rows.generators
        results = Results(self.task, self.task.team)
        self.rows.begin(np.arange(self.task.team), results, scenarios)
        self._begin_frames()
        return results.observations, self._infos(results)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Moves the world by one control period; see `SingleEnv.step`."""
        if self.rows is None:
            return super().step(action)
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before step")
        action = self.batch.checked(action, self._shape)
        results, _, _ = self.rows.step(action, None)
        if self.render_mode is not None:
            self._note_position()
        part = self.rows.took_part
        reward = float(results.numbers[-1][part].mean()) if part.any() else 0.0
        return results.observations, reward, not self.rows.alive.any(), False, self._infos(results)

    def _infos(self, results: Results) -> dict[str, Any]:
        assert self.rows is not None
        return results.infos() | {"alive": self.rows.took_part.copy()}


class TeamVectorEnv(NativeVectorEnv):
    """Many worlds stepped by one compiled call: row i is robot i mod n of world i div n, seeded seed + i div n.

    With `ends="leave"` a robot whose episode has ended waits, with reward 0, until all of its world have; their rows
    begin together. `info["alive"]` is the mask of robots in the step. With `ends="respawn"` each row is an
    environment of its own, as of one robot, and none waits.
    """

    task: Teams

    def __init__(self, single: Callable[..., SingleEnv], num_envs: int = 1, **kwargs: Any) -> None:
        super().__init__(single, num_envs, **kwargs)
        self._together = self.task.team
        self._beside = self.task.ends == "leave"
        self._waiting: TeamRows | None = None
        if self.task.team > 1 and self.task.ends == "leave":
            self._waiting = TeamRows(self.task, num_envs, self.batch.num_threads)
            self.batch = self._waiting.batch

    @property
    def waits(self) -> bool:
        """Returns whether robots whose episodes have ended wait for others."""
        return self._waiting is not None

    def _seed(self, seeds: list[int | None]) -> None:
        """Seeds the worlds by the seeds of their first rows."""
        if self._together == 1:
            super()._seed(seeds)
            return
        seed_worlds(self._generators, self._seeds, seeds[:: self._together], self._together)
        if self._waiting is not None:
            self._waiting.generators = self._generators

    def reset(
        self, *, seed: Seeds = None, options: dict[str, Any] | Sequence[dict[str, Any] | None] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts an episode in every world; world w is seeded seed + w. See `NativeVectorEnv.reset`.

        A list of seeds, or of scenarios, has one a world, or one a row; of seeds the first of each world counts.
        """
        observations, info = super().reset(seed=seed, options=options)
        if self._waiting is not None:
            self._waiting.alive[:] = True
            self._waiting.took_part[:] = True
            info["alive"], info["_alive"] = self._waiting.took_part.copy(), self._all.copy()
        return observations, info

    def step(self, actions: NDArray[np.float32]) -> Step:
        """Moves every robot that has not ended by one control period; see `NativeVectorEnv.step`."""
        waiting = self._waiting
        if waiting is None:
            return super().step(actions)
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before step")
        if type(actions) is not np.ndarray or actions.dtype.kind != "f" or actions.shape != self._shape:
            actions = self.batch.checked(actions, self._shape)
        again = np.flatnonzero(self._ended & ~self.resting)
        begin = partial(waiting.begin, again) if len(again) else None
        results, terminated, truncated = waiting.step(actions, self.max_episode_steps, begin)
        info = self._info(results)
        info["alive"], info["_alive"] = waiting.took_part.copy(), self._all.copy()
        return self._with_rows_begun(waiting.over() & ~self.resting, results, terminated, truncated, info)

    def _begin(self, rows: NDArray[np.int64], results: Results) -> None:
        (super()._begin if self._waiting is None else self._waiting.begin)(rows, results)


class OmniTeam(TeamEnv):
    __doc__ = f"""A team of omni robots in one world, each with a goal of its own.

    ## Description

    n robots of one kind reach goals of their own, see each other in their scans, and must touch nobody: neither what
    stands nor each other nor people. Control period 0.05 s. A row is a robot: the native vector has num_envs / n
    worlds, row i is robot i mod n of world i div n. A team of one among nobody is goal reaching, bit for bit.
    `gymnasium.make` makes one world: actions and observations have a row a robot, or none where the team is one.

    ## Action space

    A row a robot of {OMNI_ACTIONS}

    ## Observation space

    That of goal reaching, a row a robot: pose, twist, goal, goal heading error, waypoints left, ranges; the ranges end
    at the others' hulls too. With `sees="bodies"` there stand before the ranges 10 rows of 7 numbers: the nearest
    bodies within `sight` that no wall hides, the nearest first, in the body frame: x, y (m), v_x, v_y (m/s, over
    ground), radius (m), kind (1 robot, 2 person), seen (1; 0: the row is empty). They have the noise of a tracker: at
    nominal `noise` 0.02 m and 0.1 m/s, and a body is missed as often as a beam drops out.

    ## Rewards

    That of goal reaching for each row, of its own; the single world's is the mean over the robots that took part.

    ## Starting state

    Every robot at rest at its start. The world's scenario is drawn by its first row; world w is seeded seed + w.

    ## Episode end

    A robot's episode is terminated when it has reached its goal, or touched something: two bodies touch when the chords
    that they drive in a control period come nearer than their hulls; both stand where they were, or, in MuJoCo, brake.
    `ends="leave"`: who has arrived leaves the world, or stays as a disc with `parks=True`; who has collided stays. They
    wait, with reward 0, until all have ended, and `info["alive"]` says who took part. `ends="respawn"`, for training
    with native vectors: who has ended begins anew at once, at the first of 16 drawn starts that is clear by 0.3 m.
    Truncated after 2400 steps (120 s) in teams, 1200 (60 s) among people.

    ## Info

    That of goal reaching, and `gap` (m, the least distance of hulls to another body in this step), `touched` (0
    nothing, 1 what stands, 2 a robot, 3 a person) and the flag `caused` (whether it drove towards what it touched).

    ## Arguments

    {arguments_table(TeamArguments, holonomic=True)}

    ## Version history

    * v0: first version.
    """

    arguments = TeamArguments
    asks: ClassVar[type[Teams]] = Teams
    robots = robots_with(holonomic=True)


OmniTeamVector = vector_of(OmniTeam, TeamVectorEnv)


class DiffDriveTeam(OmniTeam):
    __doc__ = sheet_like(
        OmniTeam,
        "A team of differential drives in one world, each with a goal of its own.",
        arguments=TeamArguments,
        holonomic=False,
    )

    robots = robots_with(holonomic=False)


DiffDriveTeamVector = vector_of(DiffDriveTeam, TeamVectorEnv)
