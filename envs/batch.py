"""The step order, written once: a batch of robots of one task, whether it holds one robot or thousands."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.sensing import BEAM_NOISE_COLUMN, ROOM, Lidar, beam_directions, scan_ranges
from wayfield.envs.tasks import constraints
from wayfield.envs.tasks.briefing import KNOWS, MAPPED, Briefing, Surroundings
from wayfield.envs.tasks.stepping import COMMAND, DRIVE, JUDGE
from wayfield.envs.tasks.task import PLANTS, Task, plant_class
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.grid_scans import SCRATCH, WORDS, scan_grid
from wayfield.system.checks import choose, memory, shown
from wayfield.system.compiled import machine_code
from wayfield.system.sharing import PART
from wayfield.system.threads import thread_pool

# The arrays that hold all that decides what comes next, but for the generators and the plant.
STATE_ARRAYS = ("states", "obstacles", "columns", "skip", "noise", "delayed")

# Rows of noise drawn at once for a robot: large enough that drawing is cheap, small enough to stay in the cache.
NOISE_BLOCK = 64

_OF_SCENARIO = ("scenario", "num_obstacles", "field", "num_blocks")  # of a state, as a reset leaves them
_FARTHEST = 1e6  # m, rad, m/s, rad/s: of what a state holds

ALONE = np.empty(0, np.int64)  # shares where no other thread takes rows
_FIRST = np.arange(1)


class Results:
    """The arrays that a step writes: fresh ones each time, so that what the caller keeps is never overwritten."""

    def __init__(self, task: Task, num_envs: int) -> None:
        self.observations = np.empty((num_envs, task.layout.size), np.float32)
        # the info values, then the reward; the info flags, then whether the episode ended
        self.numbers = np.empty((len(task.info_names) + 1, num_envs))
        self.flags = np.empty((len(task.flag_names) + 1, num_envs), np.bool_)
        self._task = task
        self.tells = task.options.constraints
        if self.tells:  # a row a robot
            self.constraints = np.empty((num_envs, len(task.constraints)))
            self.violated = np.empty(num_envs, np.bool_)

    def infos(self) -> dict[str, NDArray[Any]]:
        """Returns the info, an array a name: a row a robot."""
        values: dict[str, NDArray[Any]] = dict(zip(self._task.info_names, self.numbers, strict=False))
        values.update(zip(self._task.flag_names, self.flags, strict=False))
        if self.tells:
            values.update(zip(constraints.NAMES, (self.constraints, self.violated), strict=True))
        return values

    def take(self, rows: NDArray[np.int64], others: "Results") -> None:
        """Writes what others hold of some rows."""
        self.observations[rows] = others.observations[rows]
        self.numbers[:, rows] = others.numbers[:, rows]
        self.flags[:, rows] = others.flags[:, rows]
        if self.tells:
            self.constraints[rows], self.violated[rows] = others.constraints[rows], others.violated[rows]


class Batch:
    """The state of `num_envs` robots of a task, and the two things that can be done to it: reset and step.

    Every robot draws from the generator it is given, in the same order whether it is alone or one of many: rows of a
    batch equal single environments bit for bit, and so they do whatever the number of threads that share them out.
    """

    def __init__(self, task: Task, num_envs: int, num_threads: int = 1) -> None:
        self.task = task
        self.num_envs = num_envs
        self.num_threads = num_threads
        self.action_shape = task.options.max_action.shape
        disturbance = task.options.disturbance
        drops = disturbance.range_dropout > 0.0
        noises = ("position_noise", "encoder_noise", "range_noise")
        self.noisy = drops or any(task.params[name][0] > 0.0 for name in noises)
        rows = NOISE_BLOCK if self.noisy else 1
        columns = BEAM_NOISE_COLUMN + task.num_beams * (1 + drops) + task.noise_columns
        # two observations are alive at a time, and a briefing holds the obstacles once more
        each = (
            task.state_dtype.itemsize
            + (2 if task.shared_obstacles is None else 1) * OBSTACLE.itemsize * task.max_obstacles
            + 8 * (rows * columns + 2 * task.layout.size + task.options.num_requested)
        )
        memory(
            f"num_envs={num_envs} (with {task.max_obstacles} obstacles, {task.num_beams} beams and an observation of "
            f"{task.layout.size} numbers)",
            num_envs * each,
        )
        self.states = np.zeros(num_envs, task.state_dtype)
        shared = task.shared_obstacles
        self.obstacles = np.zeros((num_envs, task.max_obstacles), OBSTACLE) if shared is None else shared
        # behind an action, where the base has a delay, the earlier actions
        count = len(task.options.max_action)
        self.columns = np.zeros((num_envs, count + task.options.num_requested))
        self.actions = self.columns[:, :count]
        self.skip = np.zeros(num_envs, np.bool_)
        self.noise = np.zeros((num_envs, rows, columns))
        # a drawn shove or drift takes a time and a direction
        self.draws = 1 + task.draws + (2 if disturbance.displaces else 0)
        self.delayed = np.zeros((disturbance.action_delay, num_envs, *self.action_shape))  # oldest first
        self.own: Any = task.own_arrays(num_envs)
        self._constraints = task.constraints if task.options.constraints else ()
        self._inputs = (
            *(task.params, self.states, self.obstacles, self.columns, self.noise, self.skip),
            *(*task.world, *self.own),
        )
        # fewer rows are done sooner than another thread is woken
        self._alone = num_threads == 1 or num_envs < 2 * PART
        results = Results(task, 1)
        outputs = (results.observations, results.numbers, results.flags)
        self._step_rows = machine_code(task.step_rows, 0, 0, ALONE, *self._inputs, *outputs)
        draws = np.empty((1, self.draws))
        self._reset_rows = machine_code(
            task.reset_rows,
            *(task.params, self.states, self.obstacles, _FIRST, draws, self.noise, *task.world, *self.own, *outputs),
        )
        dynamics = task.options.dynamics
        self.plant: Any = plant_class(dynamics)(task, num_envs) if dynamics in PLANTS else None
        self._phases = COMMAND | DRIVE | JUDGE if self.plant is None else COMMAND

    def __reduce__(self) -> tuple[Any, ...]:
        """Returns what pickle and copy make a batch in the same state from: machine code is looked up anew.

        Raises:
            TypeError: with a simulator outside of this process, which cannot be copied.
        """
        if self.task.options.dynamics == "coppelia":
            raise TypeError('dynamics="coppelia" cannot be copied: the simulator is outside of this process')
        return (
            Batch,
            (self.task, self.num_envs, self.num_threads),
            {name: getattr(self, name) for name in (*STATE_ARRAYS, "own", "plant")},
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name in STATE_ARRAYS:
            getattr(self, name)[...] = state[name]  # in place: the step's arguments are these arrays
        for array, content in zip(self.own, state["own"], strict=True):
            array[...] = content
        self.plant = state["plant"]

    def put_back(self, arrays: Mapping[str, NDArray[Any]], own: tuple[NDArray[Any], ...] = ()) -> None:
        """Takes over an earlier state of a batch that has just been reset to the scenarios of that state.

        Args:
            arrays: arrays of `STATE_ARRAYS`, which may come from a file: kernels index by them, and look at no bounds.
            own: those of the task, as `own_arrays` makes them, which may too.

        Raises:
            ValueError: naming the field, if a value cannot be one of a robot in its scenario; nothing is taken over.
        """
        states = arrays["states"]
        last = self.task.last_indices(states["scenario"]) | {"noise_row": NOISE_BLOCK if self.noisy else 2**62}
        for name in states.dtype.names or ():
            values = states[name]
            if values.dtype.kind == "f":
                good = (np.abs(values) <= _FARTHEST) | ((values == np.inf) & (name in ("clearance", "gap")))
            elif name in _OF_SCENARIO:
                good = self.task.same_world(name, values, self.states[name])
            else:
                good = (values <= last.get(name, 2**62)) & (values >= (-1 if name == "shove_step" else 0))
            if not good.all():
                i = int(good.argmin())
                raise ValueError(
                    f"{name} of robot {i} is {values[i]}, which no robot has in scenario {states['scenario'][i]}"
                )
        for name, array in arrays.items():
            numbers = array.view(np.float64) if array.dtype.names else array
            if name != "states" and not (np.abs(numbers) <= _FARTHEST).all():
                raise ValueError(f"{name} must hold numbers of at most {_FARTHEST:g} in size")
        given, mine = arrays["obstacles"], self.obstacles
        if self.task.shared_obstacles is None:  # some may be elsewhere, but go on as the scenarios say
            there = np.arange(mine.shape[1]) < self.states["num_obstacles"][:, None]
            given, mine = given["patrol"][there], mine["patrol"][there]
        if given.tobytes() != mine.tobytes():
            raise ValueError("obstacles are other ones than those of the scenarios")
        if own:
            self.task.check_own(own, self.own)
        for name, array in arrays.items():
            getattr(self, name)[...] = array  # in place: the step's arguments are these arrays
        for there, array in zip(self.own, own, strict=False):
            there[...] = array

    def close(self) -> None:
        """Lets go of what the plant holds outside of this process."""
        if self.task.options.dynamics == "coppelia":
            self.plant.close()

    def chosen_scenarios(self, options: Any) -> NDArray[np.int64] | None:
        """Returns the scenario (num_envs,) that the options of a reset choose for each robot; None when they do not.

        Raises:
            TypeError: if the options are no dict.
            ValueError: if a key is unknown, or the value is no index of the bank for every robot or every world.
        """
        chosen = self._chosen(options, self.num_envs)
        return None if chosen is None else self._agreed(chosen)

    def chosen_of_each(self, options: Sequence[Any]) -> NDArray[np.int64] | None:
        """Returns the same of options a robot; -1 for a robot whose own choose none, errors as of those for all."""
        each = [self._chosen(own, 1) for own in options]
        if all(own is None for own in each):
            return None
        return self._agreed(np.array([-1 if own is None else own.item() for own in each]))

    def _chosen(self, options: Any, robots: int) -> NDArray[np.int64] | None:
        if options is None:
            return None
        if not isinstance(options, Mapping):
            raise TypeError(f"options must be a dict or None, got {shown(options)}")
        if not options:
            return None
        for key in options:
            choose("options key", key, ("scenario",))
        last, worlds = len(self.task.scenarios) - 1, -(-robots // self.task.team)
        value = options["scenario"]
        try:
            chosen = np.asarray(value)
        except (ValueError, OverflowError, RecursionError):
            chosen = np.empty(0)
        indices = chosen.dtype.kind in "iu" and chosen.shape in ((), (worlds,), (robots,))
        if not indices or chosen.min() < 0 or chosen.max() > last:
            kinds = "an int" if worlds == 1 else f"an int or {worlds} ints"
            raise ValueError(f"options['scenario'] must be {kinds} from 0 to {last}, got {shown(value)}")
        return np.repeat(chosen.astype(np.int64), robots // chosen.size)

    def _agreed(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns the scenarios (num_envs,) as they are; ValueError if robots of one world have different ones."""
        worlds = chosen.reshape(-1, self.task.team)
        if (worlds != worlds[:, :1]).any():
            raise ValueError(f"options['scenario'] must be the same for all {self.task.team} robots of a world")
        return chosen

    @property
    def known_obstacles(self) -> NDArray[np.void]:
        """Returns the obstacles (rows, max_obstacles) as the scenarios have them; states["field"] is a robot's row."""
        obstacles = self.obstacles if self.task.shared_obstacles is None else self.task.fields
        assert obstacles is not None
        return obstacles

    def reset(
        self,
        rows: NDArray[np.int64],
        generators: Sequence[np.random.Generator],
        results: Results,
        scenarios: NDArray[np.int64] | None = None,
    ) -> None:
        """Starts an episode for each robot in `rows`, drawn from its generator, and writes its results.

        `scenarios` (num_envs,) takes the place of the draw of the scenario, where it is no -1; all else is drawn as
        without it.
        """
        self.delayed[:, rows] = 0.0
        self.columns[rows, self.actions.shape[1] :] = 0.0
        draws = np.empty((len(rows), self.draws))
        for j, i in enumerate(rows.tolist()):
            generators[i].random(out=draws[j])
            if self.noisy:
                generators[i].standard_normal(out=self.noise[i])
        if scenarios is not None:
            chosen = scenarios[rows]
            draws[:, 0] = np.where(chosen < 0, draws[:, 0], (chosen + 0.5) / len(self.task.scenarios))
        self._reset_rows(
            self.task.params,
            self.states,
            self.obstacles,
            rows,
            draws,
            self.noise,
            *self.task.world,
            *self.own,
            results.observations,
            results.numbers,
            results.flags,
        )
        if self.plant is not None:
            self.plant.reset(rows, self.states, self.obstacles)
        if self._constraints:
            self._tell_constraints(rows, np.zeros_like(self.actions), self._commands(), results)

    def step(
        self,
        generators: Sequence[np.random.Generator],
        results: Results,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Moves every robot that is not in `self.skip` by `self.actions` and writes its results.

        Args:
            meanwhile: done after it, or beside it by this thread where there are others: for the robots in `self.skip`.

        Raises:
            ValueError: if an action is not finite; nothing has moved then.
        """
        before = (self.actions.copy(), self._commands()) if self._constraints else None
        if len(self.delayed):
            self._delay_actions()
        if self.noisy:
            # not for a robot that is about to be reset: its reset draws a block of its own
            for i in np.flatnonzero((self.states["noise_row"] >= NOISE_BLOCK) & ~self.skip).tolist():
                generators[i].standard_normal(out=self.noise[i])
                self.states["noise_row"][i] = 0
        if self.plant is None:
            self._shared_out(self._phases, results, meanwhile)
        else:
            self._shared_out(self._phases, results)
            self.plant.drive(self.states, self.obstacles, self.columns, self.noise, self.skip)
            self._shared_out(JUDGE, results, meanwhile)
        if before is not None:
            self._tell_constraints(np.flatnonzero(~self.skip), *before, results)

    def _commands(self) -> NDArray[np.float64]:
        """Returns the last commands (num_envs, 3), m/s and rad/s."""
        return np.stack([self.states[name] for name in ("command_vx", "command_vy", "command_yaw_rate")], axis=1)

    def _tell_constraints(
        self, rows: NDArray[np.int64], actions: NDArray[np.float64], commands: NDArray[np.float64], results: Results
    ) -> None:
        """Writes the values of the constraints of some rows, whose requests and commands before were these."""
        numbers = constraints.evaluate(self._constraints, actions[rows], commands[rows], self.states[rows])
        results.constraints[rows], results.violated[rows] = numbers

    def _shared_out(self, phases: int, results: Results, meanwhile: Callable[[], None] | None = None) -> None:
        """Runs phases of a step, by several threads where there are some."""
        arrays = (*self._inputs, results.observations, results.numbers, results.flags)
        if self._alone:
            bad = self._step_rows(phases, 0, ALONE, *arrays)
            if bad >= 0:
                raise self._not_finite(bad)
            if meanwhile is not None:
                meanwhile()
            return
        if phases & COMMAND:  # before any robot has moved
            self._check_finite()
        thread_pool(self.num_threads).share(
            lambda thread, shares: self._step_rows(phases, thread, shares, *arrays), meanwhile
        )

    def _delay_actions(self) -> None:
        """Replaces the newest actions by those of some steps ago."""
        self._check_finite()
        late = self.delayed[0].copy()
        self.delayed[:-1] = self.delayed[1:]
        self.delayed[-1] = self.actions
        self.actions[:] = late

    def _check_finite(self) -> None:
        """Raises the error of the first robot, of those not in `self.skip`, whose action is not finite."""
        if np.isfinite(self.actions).all():  # robot by robot that takes a tenth of a step
            return
        finite = self.skip | np.isfinite(self.actions).all(axis=1)
        if not finite.all():
            raise self._not_finite(int(finite.argmin()))

    def _not_finite(self, i: int) -> ValueError:
        """Returns the error of a robot whose action is not finite."""
        return ValueError(
            f"action {self.actions[i].tolist()} of robot {i} is not finite; every component must be a number"
        )

    def checked(self, actions: Any, shape: tuple[int, ...]) -> NDArray[Any]:
        """Returns the actions as an array of the given shape.

        Raises:
            TypeError: if they are not real numbers.
            ValueError: if the shape is another.
        """
        try:
            array = np.asarray(actions)
        except (ValueError, OverflowError, RecursionError):
            pair = isinstance(actions, tuple) and len(actions) == 2
            hint = "; a pair must be unpacked: action, state = model.predict(observation)" if pair else ""
            raise ValueError(f"action must be an array of shape {shape}, got {shown(actions)}{hint}") from None
        if array.dtype.kind not in "fiu":
            raise TypeError(f"action must hold real numbers, got {array.dtype} from {shown(actions)}")
        if array.shape != shape:
            raise ValueError(f"action must have shape {shape}, got {array.shape}")
        return array

    def briefing(self, knows: str) -> Briefing:
        """Returns the briefing of the episodes now starting, for a policy that declares `knows`.

        Raises:
            ValueError: if `knows` is none of KNOWS.
        """
        choose("knows", knows, KNOWS)
        task = self.task
        fields = task.briefing_fields(self.states, knows)
        if knows in MAPPED:
            obstacles, scenario = self.known_obstacles[self.states["field"]], self.states["scenario"]
            counts = task.obstacle_counts(self.states)
            fields["map"] = Surroundings.of(obstacles, counts, task.grids, scenario)
        return Briefing(
            num_envs=self.num_envs,
            robot=task.robot,
            actuators=task.options.actuators,
            dt=task.options.dt,
            action_mode=task.options.action_mode,
            layout=task.layout,
            beam_angles=task.beam_angles,
            max_range=float(task.params["max_range"][0]),
            **fields,
        )

    def scene(
        self,
        i: int,
        trail: NDArray[np.float64],
        marks: dict[str, tuple[float, float]],
        trails: NDArray[np.float64] | None = None,
    ) -> Any:
        """Returns the rendering.Scene of robot i, with the path it drove (t, 2) and the points a controller marked.

        Args:
            trails: (t, n, 2) where all robots of its world were; None: their ways are not shown.
        """
        from wayfield.envs.rendering import Scene

        state = self.states[i]
        if self.own and not state["alive"]:  # its clock has stopped, its world's goes on
            state = state.copy()
            team: Any = self.task
            state["steps"] = self.own.clocks[i // team.team, 1]
        drawing = self.task.drawing(state)
        count = int(self.task.obstacle_counts(self.states[i : i + 1])[0])
        if self.task.num_beams:
            p = self.task.params[0]
            ranges = np.empty((self.num_envs, self.task.num_beams))
            lidar = Lidar(
                np.ascontiguousarray(beam_directions(self.task.beam_angles).T),
                p["first_beam"].item(),
                p["beam_step"].item(),
                p["max_range"].item(),
                np.empty(ROOM),
                np.empty(SCRATCH, np.float32),
                np.empty(WORDS, np.uint64),
            )
            pose = tuple(float(state[name]) for name in ("x", "y", "heading"))
            scan_ranges(lidar, self.obstacles, state["field"], count, state["num_blocks"], pose, ranges, i, 0)
            grids = self.task.grids
            if len(grids.cells):
                scan_grid(
                    grids.frames[state["scenario"]],
                    grids.cells,
                    pose,
                    lidar.beams,
                    ranges,
                    i,
                    0,
                    lidar.ways,
                    lidar.words,
                )
            drawing["ranges"] = ranges[i]
        if self.own:
            drawing |= self._company(i, trails)
        return Scene(
            robot=self.task.robot,
            pose=(float(state["x"]), float(state["y"]), float(state["heading"])),
            obstacles=self.known_obstacles[state["field"], :count],
            trail=trail,
            **(drawing | marks),
        )

    def _company(self, i: int, trails: NDArray[np.float64] | None) -> dict[str, Any]:
        """Returns the other bodies of robot i's world as fields of `rendering.Scene`, without its beams."""
        from wayfield.envs.rendering import OF_TEAM, Body, person

        robots, people = self.task.others(self.states, self.own, i)
        bodies = [
            Body(
                pose,
                self.task.robot.hull_radius,
                OF_TEAM[j % len(OF_TEAM)],
                goal=goal,
                trail=None if trails is None else trails[:, j],
                gone=gone,
            )
            for j, pose, goal, gone in robots
        ]
        bodies += [person(*each) for each in people.tolist()]
        return {"bodies": tuple(bodies), "ranges": None}
