"""The gymnasium.Env shell: a batch of one robot."""

import dataclasses
import inspect
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy import empty, float32, ndarray
from numpy.typing import NDArray

from wayfield.envs.batch import Batch, Results
from wayfield.envs.robots import Robot
from wayfield.envs.robots.doubts import tell
from wayfield.envs.tasks.arguments import Arguments
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.constraints import NAMES, Constraint
from wayfield.envs.tasks.task import CONTROL_PERIOD, Task
from wayfield.system.checks import choose, refuse, shown, suggestion, whole
from wayfield.system.checks import seed as check_seed
from wayfield.system.objects import FileNote

Array = NDArray[np.float32]
FPS = round(1.0 / CONTROL_PERIOD)
_LEAST_SIDE, _MOST_SIDE = 32, 4096  # px
_KEPT = {"render_mode", "frame_size", "constraints"}  # arguments that are attributes, too


class SingleEnv(gymnasium.Env[Any, Any]):
    """One robot of a task. Subclasses are the registered classes: keyword arguments and documentation."""

    metadata: dict[str, Any] = {  # noqa: RUF012  as gymnasium.Env declares it
        "render_modes": ["rgb_array", "human"],
        "render_fps": FPS,
    }

    def __new__(cls, *args: Any, **kwargs: Any) -> "SingleEnv":
        """Returns a bare environment; TypeError if a keyword is none of the class."""
        check_keywords(cls, kwargs)
        return super().__new__(cls)

    arguments: ClassVar[type[Arguments]]
    asks: ClassVar[type[Task]]
    robots: ClassVar[tuple[str, ...]]  # the first is the default
    _read: ClassVar[set[str]] = set()  # names of arguments that are no attributes

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Gives a class the signature of its arguments, which editors show; one with its own `__init__` keeps that."""
        super().__init_subclass__(**kwargs)
        own = cls.__init__ is SingleEnv.__init__ and hasattr(cls, "arguments")
        cls.__signature__ = inspect.signature(cls.arguments) if own else None  # type: ignore[attr-defined]
        cls._read = set(inspect.signature(cls.arguments).parameters) - _KEPT if own else set()

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuses the names of arguments, which were read when it was made: episodes would go on as before."""
        if name in self._read:
            raise AttributeError(
                f"{name} is read when the environment is made: gymnasium.make(id, {name}=...); "
                'reset(options={"scenario": k}) chooses among the scenarios that it has'
            )
        super().__setattr__(name, value)

    def __init__(self, **named: Any) -> None:
        arguments = self.arguments(**named)
        self.task = self.asks(arguments, arguments.options(self.robots))
        if said := arguments.doubt():
            warnings.warn(said, FileNote, stacklevel=2)
        if isinstance(arguments.robot, Robot):  # made in Python; files have been told of
            tell(arguments.robot, f"robot {arguments.robot.name!r}")
        self._choose_frames(arguments.render_mode, arguments.frame_size)
        self._lay_out()

    def _lay_out(self) -> None:
        """Makes the spaces and what a step needs."""
        task = self.task
        self.observation_space = task.layout.space
        most = task.options.max_action.astype(np.float32)
        self.action_space = gymnasium.spaces.Box(-most, most, dtype=np.float32)
        self.batch = Batch(task, 1)
        self.marks: dict[str, tuple[float, float]] = {}
        self._shape = self.batch.action_shape
        self._observation_shape = (1, task.layout.size)
        self._wire()
        self._names = (*task.info_names, *task.flag_names)
        self._first = np.zeros(1, np.int64)
        self._tells = task.options.constraints
        self._generators: list[np.random.Generator] = []
        self._trail: list[tuple[float, float]] = []
        self._renderer: Any = None

    def _choose_frames(self, render_mode: str | None, frame_size: Sequence[int]) -> None:
        """Takes the render mode and the size (px, width and height) of all frames; ValueError if one is wrong."""
        if render_mode is not None:
            choose("render_mode", render_mode, self.metadata["render_modes"])
        if not isinstance(frame_size, list | tuple) or len(frame_size) != 2:
            refuse("frame_size", frame_size, "two whole numbers, (width, height) in pixels")
        for i, side in enumerate(frame_size):
            whole(f"frame_size[{i}]", side, _LEAST_SIDE, _MOST_SIDE)
        self.render_mode = render_mode
        self.frame_size = (int(frame_size[0]), int(frame_size[1]))

    def _wire(self) -> None:
        """Makes the arrays that a step writes, and views into them: making one takes a tenth of a step."""
        self._results = Results(self.task, 1)
        self._action = self.batch.actions[0]
        self._numbers = self._results.numbers[:, 0]
        self._flags = self._results.flags[:, 0]

    def __getstate__(self) -> dict[str, Any]:
        """Returns what pickle and copy take: the state, mid-episode too, and the generator; no window."""
        views = ("_results", "_action", "_numbers", "_flags")
        return {name: value for name, value in vars(self).items() if name not in views} | {"_renderer": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._wire()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Starts an episode; see gymnasium.Env.reset.

        `options={"scenario": k}` starts the scenario with index k of the bank instead of a drawn one.

        Raises:
            TypeError, ValueError: if the seed is no whole number from 0 to 2^128 - 1, or the options are wrong; the
                episode goes on as before.
        """
        check_seed("seed", seed)
        seed = None if seed is None else int(seed)
        scenarios = self.batch.chosen_scenarios(options)
        super().reset(seed=seed)
        self._generators = [self.np_random]
        results = self._results
        results.observations = np.empty_like(results.observations)
        self.batch.reset(self._first, self._generators, results, scenarios)
        self._begin_frames()
        values = self._numbers.tolist()[:-1] + self._flags.tolist()[:-1]
        return results.observations[0], dict(zip(self._names, values, strict=True)) | self._constraint_info()

    def _constraint_info(self) -> dict[str, Any]:
        """Returns the values (k,) of the constraints, and whether one is violated, where the info shall have them."""
        if not self.task.options.constraints:
            return {}
        return dict(zip(NAMES, (self._results.constraints[0].copy(), self._results.violated.item()), strict=True))

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Moves the robot by one control period; see gymnasium.Env.step. The clock is the TimeLimit wrapper's.

        Raises:
            TypeError, ValueError: if the action is not a finite array of the action space's shape. Values outside the
                space are allowed: the wheels saturate, as a real base would.
        """
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before step")
        if type(action) is not ndarray or action.dtype.kind != "f" or action.shape != self._shape:
            action = self.batch.checked(action, self._shape)
        self._action[:] = action
        results = self._results
        results.observations = observations = empty(self._observation_shape, float32)
        self.batch.step(self._generators, results)
        if self.render_mode is not None:
            self._note_position()
        numbers = self._numbers.tolist()
        reward = numbers.pop()
        flags = self._flags.tolist()
        terminated = flags.pop()
        # zip without strict: the names were counted when the arrays were made, and this is a tenth of the step
        info = dict(zip(self._names, numbers + flags))  # noqa: B905
        if self._tells:
            info |= self._constraint_info()
        return observations[0], reward, terminated, False, info

    def render(self) -> Any:
        """Returns an (h, w, 3) uint8 frame in "rgb_array" mode; "human" mode draws by itself.

        When the user closes the window, drawing stops, and the episode goes on; after `close` the next frame opens a
        new window.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs a render mode: gymnasium.make(id, render_mode="rgb_array")')
            return None
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before render")
        return self._draw()

    def close(self) -> None:
        """Closes its own window; with dynamics="coppelia", leaves the robot standing."""
        self.batch.close()
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """Returns what base and task allow, as data, in the order of `info["constraint_values"]`."""
        return self.task.constraints

    def briefing(self, knows: str) -> Briefing:
        """Returns the briefing of the episode that was just reset, for a policy that declares `knows`."""
        return self.batch.briefing(knows)

    def _begin_frames(self) -> None:
        """Forgets the marks and the trails of the episode before, and notes where the next one begins."""
        self.marks, self._trail = {}, []
        if self.render_mode is not None:
            self._note_position()

    def _note_position(self) -> None:
        state = self.batch.states[0]
        self._trail.append((float(state["x"]), float(state["y"])))
        if self.render_mode == "human":
            self._draw()

    def scene(self) -> Any:
        """Returns the rendering.Scene of this moment; the trail is there where there is a render mode."""
        return self.batch.scene(0, np.array(self._trail).reshape(-1, 2), self.marks)

    def _draw(self) -> Any:
        from wayfield.envs.rendering import Renderer

        if self._renderer is None:
            self._renderer = Renderer(str(self.render_mode), FPS, self.frame_size)
        return self._renderer.draw(self.scene())


def check_keywords(env: Callable[..., SingleEnv], keywords: Iterable[str], further: Iterable[str] = ()) -> None:
    """Raises TypeError, naming the environment's class and the nearest keyword, at the first that it does not take.

    Args:
        env: the class.
        further: keywords that are taken beside those of the class.
    """
    if getattr(env, "__init__", None) is not SingleEnv.__init__:  # a subclass of the user's will say so itself
        return
    fields = dataclasses.fields(env.arguments)  # type: ignore[attr-defined]
    known = (*(each.name for each in fields), *further)
    for word in keywords:
        if word not in known:
            if word == "seed":
                raise TypeError("a seed is for reset: env.reset(seed=3), or env.seed(3) of a VecEnv")
            # what gymnasium.make takes itself is no keyword of the class, but what some mean
            near, name = (
                suggestion(word, (*known, "max_episode_steps", "num_envs")),
                getattr(env, "__name__", "the environment"),
            )
            # Python's own words: TorchRL tries a keyword of its own, and leaves it out where the error has them
            said = f"{name} got an unexpected keyword argument {shown(word)}"
            raise TypeError(f"{said}.{near} Choose from {', '.join(known)}.")
