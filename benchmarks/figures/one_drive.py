"""One robot in one scenario, chosen by a command line, and a ghost of another policy beside it."""

import dataclasses
import functools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np

from wayfield.benchmarks.contests import CONTESTS, TEAMS
from wayfield.benchmarks.entrants.own_policies import own_policy, source_and_gains
from wayfield.envs.rendering import Ghost, Scene
from wayfield.envs.robots import Robot, shipped_name
from wayfield.envs.robots.robot_option import robot_option
from wayfield.envs.scenarios import TASKS
from wayfield.envs.scenarios.files import kind_of
from wayfield.envs.tasks.specs import CROWDS, EVERY, TaskSpec, spec_of
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies import POLICIES, load_agent, make
from wayfield.policies.learned.agent import CARD
from wayfield.policies.parts.policy import Policy, observation_of
from wayfield.policies.parts.tuned import tuned_set
from wayfield.policies.paths.lookahead import Lookahead
from wayfield.policies.pilot import Pilot
from wayfield.system.checks import choose
from wayfield.system.command_line import SEED

IDS = tuple(name for spec in EVERY.values() for name in spec.ids.values())
GAINS = ("tuned", "default")
_SETTING = "KEY=VALUE"
_ENDS = {"success": "arrived", "collision": "touched something"}  # of a team's robots


@dataclasses.dataclass(frozen=True)
class Place:
    """The chosen environment and episode; None is the environment's own default."""

    env_id: str | None
    scenario: str | None
    index: int | None  # of the bank; None: drawn
    robot: Robot | None
    actuators: str
    dynamics: str | None
    disturbance: str | None
    settings: tuple[str, ...]  # other arguments of the environment, key=value
    seed: int
    gains: str  # one of GAINS, of policies that are named

    def make(self, policy: str | None, seconds: float = 0.0) -> Any:
        """Returns the environment, which notes the trail.

        Where no id is given it is that of the policy's task, for the robot; scans are those of the contests.

        Args:
            seconds: that its time limit is no shorter than.

        Raises:
            click.UsageError: naming what is wrong with the options.
        """
        env_id = self._env_id(policy)
        options = {name: getattr(self, name) for name in ("scenario", "robot", "actuators", "dynamics", "disturbance")}
        given = {name: value for name, value in options.items() if value is not None}
        try:
            suite = TEAMS if spec_of(env_id) in CROWDS.values() else CONTESTS[spec_of(env_id).suite]
            size = suite.spec.repertoire.size_of(self.scenario or "")
            own = gymnasium.spec(env_id).max_episode_steps or 0
            steps = max(own if size == 1.0 else round(size * suite.spec.clock), math.ceil(seconds / CONTROL_PERIOD))
            clock = {"max_episode_steps": steps} if steps != own else {}
            kwargs = {**suite.env_kwargs, **suite.seen(size), **clock, **given, **dict(map(_setting, self.settings))}
            return gymnasium.make(env_id, render_mode="rgb_array", **kwargs)
        except (TypeError, ValueError) as error:
            raise click.UsageError(str(error)) from None
        except ModuleNotFoundError as error:
            raise click.ClickException(str(error)) from None

    def _env_id(self, policy: str | None) -> str:
        if self.env_id is not None:
            name = self.env_id if "/" in self.env_id else f"wayfield/{self.env_id}"
            try:
                choose("ENV_ID", name, IDS)
            except ValueError as error:
                raise click.UsageError(str(error)) from None
            return name
        spec = TASKS["path_following"]
        if policy is not None:
            made = self.policy(policy)
            read = [each for each in TASKS.values() if observation_of(each) in made.observes]
            if made.knows == "bodies":
                read = list(CROWDS.values())
            spec = next(filter(self._is_of, read), read[0] if read else spec)
        return spec.ids[self.robot is not None and self.robot.holonomic]

    def _is_of(self, spec: TaskSpec) -> bool:
        """Returns whether the scenario is one of a task, by its name or by what its file holds."""
        if self.scenario is None:
            return True
        name = re.split("[/@]", self.scenario)[0]
        known = name in spec.presets or name in spec.families
        return known or (Path(self.scenario).is_file() and kind_of(self.scenario) == spec.kind)

    def policy(self, text: str, env: Any = None) -> Policy:
        """Returns the policy of a text: a name, module:Class, model.zip, or the folder of an agent; gains behind it.

        Raises:
            click.UsageError: if there is none, or a gain is wrong.
        """
        try:
            source, gains = source_and_gains(text)
            if (Path(source) / CARD).is_file():
                return load_agent(source, **gains)
            if ":" in source or source.lower().endswith(".zip"):
                own = own_policy(text)
                return own.make(own.gains)
            choose("policy", source, POLICIES)
            tuned: dict[str, Any] = {}
            if self.gains == "tuned" and env is not None:
                task = env.unwrapped.task
                named = shipped_name(task.robot)
                best = tuned_set(source, task.spec.suite, named) if isinstance(named, str) else None
                tuned = dict(best.gains) if best is not None else {}
            return make(source, **tuned | gains)
        except (OSError, TypeError, ValueError) as error:
            raise click.UsageError(f"{text!r}: {error}" if text not in str(error) else str(error)) from None


def _setting(text: str) -> tuple[str, Any]:
    source, gains = source_and_gains(f"_ {text}")
    del source
    if len(gains) != 1:
        raise ValueError(f"--set {text!r} must be one {_SETTING}")
    if "render_mode" in gains:
        raise ValueError("--set render_mode is not needed: frames are drawn in any case")
    return next(iter(gains.items()))


def place_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives a command the options of a `Place`, which it receives as its first argument."""

    @functools.wraps(command)
    def with_place(**given: Any) -> Any:
        names = [field.name for field in dataclasses.fields(Place)]
        return command(Place(**{name: given.pop(name) for name in names}), **given)

    options = [
        click.argument("env_id", required=False),
        click.option("--scenario", metavar="NAME", help="A name, a split such as clutter_10/test, or a file."),
        click.option("--index", type=click.IntRange(min=0), help="The scenario of its bank.  [default: drawn]"),
        robot_option("As `wayfield robots` lists them, or a data sheet."),
        click.option("--actuators", metavar="TIER", default="lagged", show_default=True, help="ideal, lagged or slow."),
        click.option("--dynamics", metavar="PLANT", help="kinematic, pymunk, mujoco or coppelia."),
        click.option("--disturbance", metavar="LEVEL", help='From "light" to "severe".'),
        click.option("--set", "settings", multiple=True, metavar=_SETTING, help="Another argument of the environment."),
        click.option("--seed", type=SEED, default=0, show_default=True, help="Of the episode."),
        click.option("--gains", type=click.Choice(GAINS), default=GAINS[0], show_default=True, help="Of policies."),
    ]
    for option in reversed(options):
        with_place = option(with_place)
    return with_place


class Drive:
    """A robot on its way: the environment, the policy at the wheel, and how it ended."""

    def __init__(self, env: Any, policy: Policy, name: str = "") -> None:
        """Raises click.UsageError if the policy cannot drive there.

        Args:
            name: of the policy, where it is shown beside others.
        """
        self.name = name
        self.env = env
        self.single = env.unwrapped
        try:
            self.pilot = Pilot(policy, env)
        except (TypeError, ValueError) as error:
            raise click.UsageError(str(error)) from None
        self.seen: Any = None
        self.steps = 0
        self.ended = ""  # in a word, once it has

    def begin(self, seed: int, index: int | None) -> None:
        """Starts an episode; click.UsageError if there is no such scenario, or the policy cannot drive there."""
        try:
            self.seen, _ = self.env.reset(seed=seed, options=None if index is None else {"scenario": index})
            self.pilot.reset()
        except (TypeError, ValueError) as error:
            raise click.UsageError(str(error)) from None
        self.steps, self.ended = 0, ""

    def step(self) -> None:
        """Drives for a control period, unless it has ended; click.ClickException if the policy fails."""
        if self.ended:
            return
        try:
            action = self.pilot.act(self.seen)
        except ValueError as error:
            raise click.ClickException(str(error)) from None
        self.seen, _, terminated, truncated, info = self.env.step(action)
        self.steps += 1
        if terminated or truncated:
            self.ended = self._how(info)

    def _how(self, info: dict[str, Any]) -> str:
        """Returns how an episode ended, in words: of a team how many arrived and touched something."""
        flags = [name for name in self.single.task.flag_names if np.any(info[name])]
        if np.ndim(info.get("success", 0)):
            counts = [f"{int(info[name].sum())} {word}" for name, word in _ENDS.items()]
            return f"of {len(info['success'])} robots {', '.join(counts)}"
        return flags[0].replace("_", " ") if flags else "the clock ran out"

    @property
    def pose(self) -> tuple[float, float, float]:
        """Returns x, y, heading."""
        state = self.single.batch.states[0]
        return float(state["x"]), float(state["y"]), float(state["heading"])

    @property
    def status(self) -> str:
        """Returns how it stands, in words."""
        seconds = self.steps * self.single.task.options.dt
        return f"{self.ended} after {seconds:.2f} s" if self.ended else f"under way for {seconds:.2f} s"

    def scene(self) -> Scene:
        """Returns what is seen now, with the look-ahead point where the policy has one."""
        policy = self.pilot.policy
        self.single.marks = chased(self.pilot, self.single) if isinstance(policy, Lookahead) else {}
        scene: Scene = dataclasses.replace(self.single.scene(), name=self.name)
        return scene

    def ghost(self) -> Ghost:
        """Returns the robot and its trail as a ghost in the scene of another."""
        return Ghost(self.single.task.robot, self.pose, self.single.scene().trail, self.name)


def chased(pilot: Pilot, single: Any) -> dict[str, tuple[float, float]]:
    """Returns document A's markers: the look-ahead point, and the path point that is being chased."""
    policy = pilot.policy
    assert isinstance(policy, Lookahead)
    state = single.batch.states[0]
    pose = np.array([[state["x"], state["y"], state["heading"]]])
    x, y, *_ = policy.errors(pose, state["arc_length"][None], pilot.briefing)[0]
    (px, py, heading), ahead = pose[0], policy.lookahead_distance
    sine, cosine = np.sin(heading), np.cos(heading)
    return {
        "lookahead": (float(px + ahead * cosine), float(py + ahead * sine)),
        "reference": (float(px + cosine * x - sine * y), float(py + sine * x + cosine * y)),
    }
