"""Driving by the keyboard, beside a policy's ghost: wayfield play"""

import dataclasses
import math
import os
import sys
from collections.abc import Sequence
from typing import Any, ClassVar

import click
import numpy as np
import pygame
from numpy.typing import NDArray

from wayfield.benchmarks.figures.one_drive import Drive, Place, place_options
from wayfield.envs.rendering import NoDisplay, Renderer, Scene
from wayfield.envs.single import FPS
from wayfield.envs.tasks.briefing import Briefing
from wayfield.system.command_line import Finite, OneLineErrors, say

_AHEAD, _LEFT, _ASIDE = 0, 1, 2  # what keys ask for: forward, to turn left, to go left
_ARROWS = {
    pygame.K_UP: (_AHEAD, 1.0),
    pygame.K_DOWN: (_AHEAD, -1.0),
    pygame.K_w: (_AHEAD, 1.0),
    pygame.K_s: (_AHEAD, -1.0),
    pygame.K_LEFT: (_LEFT, 1.0),
    pygame.K_RIGHT: (_LEFT, -1.0),
}
# Where the robot cannot go sideways A and D turn it.
KEYS = {
    False: _ARROWS | {pygame.K_a: (_LEFT, 1.0), pygame.K_d: (_LEFT, -1.0)},
    True: _ARROWS | {pygame.K_a: (_ASIDE, 1.0), pygame.K_d: (_ASIDE, -1.0)},
}
_TO_DRIVE = {
    False: "arrows or W A S D   drive and turn",
    True: "W A S D   drive in any direction      left, right   turn",
}
_NO_DISPLAY = (
    "there is no display to open a window on (DISPLAY or WAYLAND_DISPLAY); `wayfield render` films without one"
)
_TO_RULE = "R again      N next scenario      P pause      H hide this      Esc quit"


@dataclasses.dataclass(frozen=True)
class Hands:
    """A policy whose command follows the keys that are held."""

    observes: tuple[type, ...]  # whatever the environment gives: it looks at nothing
    speed: float  # m/s
    yaw_rate: float  # rad/s
    held: set[int] = dataclasses.field(default_factory=set, compare=False)  # codes of keys

    knows: ClassVar[str] = "sensors"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory."""
        return np.empty((briefing.num_envs, 0))

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t): opposite keys cancel, and a diagonal is no faster than a straight line."""
        stick = np.zeros(3)
        for key in self.held:
            axis, sign = KEYS[briefing.robot.holonomic].get(key, (_AHEAD, 0.0))
            stick[axis] = np.clip(stick[axis] + sign, -1.0, 1.0)
        planar = self.speed * stick[[_AHEAD, _ASIDE]] / max(1.0, math.hypot(stick[_AHEAD], stick[_ASIDE]))
        twist = np.array([*planar, self.yaw_rate * stick[_LEFT]])
        return np.tile(twist[list(briefing.robot.twist_axes)], (briefing.num_envs, 1))


class Game:
    """The player's robot, and ghosts in the same scenario from the same start, with the same disturbances."""

    def __init__(self, place: Place, ghosts: Sequence[str], speed: float, yaw_rate: float) -> None:
        """Raises click.UsageError if there is no such place, or a ghost cannot drive there."""
        env = place.make(ghosts[0] if ghosts else None)
        if env.action_space.shape and len(env.action_space.shape) > 1:
            raise click.UsageError(f"ENV_ID {env.spec.id!r} has a team of {len(env.action_space.low)}; --set team=1")
        kind = env.unwrapped.task.layout.kind
        self.hands = Hands((kind,), speed, yaw_rate)
        self.mine = Drive(env, self.hands, "you")
        self.ghosts = [Drive(place.make(ghosts[0]), place.policy(text, env), text) for text in ghosts]
        self.seed, self.index = place.seed, place.index
        self.shown = True  # whether the keys are explained
        self.over = False
        self.begin()

    @property
    def drives(self) -> list[Drive]:
        """Returns the player's and the ghosts'."""
        return [self.mine, *self.ghosts]

    def begin(self) -> None:
        """Starts the episode; nothing moves before a key is pressed."""
        self.hands.held.clear()
        self.waits = True
        for drive in self.drives:
            drive.begin(self.seed, self.index)

    def next(self) -> None:
        """Starts the next episode: the next scenario of the bank, or the next seed's."""
        there = len(self.mine.single.task.scenarios)
        self.seed += 1
        if self.index is not None:
            self.index = (self.index + 1) % there
        self.begin()

    def hear(self, event: pygame.event.Event) -> None:
        """Handles an event of the keyboard or the window."""
        driving = KEYS[self.mine.single.task.robot.holonomic]
        if event.type == pygame.QUIT:
            self.over = True
        elif event.type == pygame.WINDOWFOCUSLOST:
            self.hands.held.clear()  # the keys are let go of elsewhere
        elif event.type == pygame.KEYUP:
            self.hands.held.discard(event.key)
        elif event.type != pygame.KEYDOWN:
            return
        elif event.key in driving:
            self.hands.held.add(event.key)
            self.waits = False
        elif event.key == pygame.K_ESCAPE:
            self.over = True
        elif event.key == pygame.K_r:
            self.begin()
        elif event.key == pygame.K_n:
            self.next()
        elif event.key == pygame.K_p:
            self.waits = not self.waits
        elif event.key == pygame.K_h:
            self.shown = not self.shown

    def step(self) -> str:
        """Drives all for a control period; returns what there is to tell once the player's episode has ended."""
        if self.waits or self.mine.ended:
            return ""
        for drive in self.drives:
            drive.step()
        return self.standings() if self.mine.ended else ""

    def standings(self) -> str:
        """Returns how all stand."""
        return f"seed {self.seed}: " + "; ".join(f"{each.name}: {each.status}" for each in self.drives)

    def scene(self) -> Scene:
        """Returns what the window shows."""
        scene = self.mine.scene()
        state = "drive to start the clock" if self.waits and not self.mine.steps else "paused" if self.waits else ""
        if self.mine.ended:
            state = f"{self.mine.status}: R again, N next"
        robot = self.mine.single.task.robot
        # they cover a part of the world: not while it is driven in
        standing = self.waits or bool(self.mine.ended)
        notes = (_TO_DRIVE[robot.holonomic], _TO_RULE) if self.shown and standing else ()
        return dataclasses.replace(
            scene,
            ghosts=tuple(each.ghost() for each in self.ghosts),
            caption=f"{scene.caption}   {state}",
            notes=notes,
        )

    def close(self) -> None:
        """Closes the environments."""
        for drive in self.drives:
            drive.env.close()


def run(game: Game, renderer: Renderer) -> None:
    """Plays until the player has enough: one control period a frame, in real time."""
    while not (game.over or renderer.over):
        renderer.draw(game.scene())
        for event in pygame.event.get():
            game.hear(event)
        line = game.step()
        if line:
            say(line)


class _Play(OneLineErrors):
    interrupted = "interrupted"


@click.command("play", cls=_Play)
@place_options
@click.option(
    "--ghost",
    "ghosts",
    metavar="POLICY",
    multiple=True,
    help="A policy that drives from the same start: a name, or as in `wayfield render`; may be repeated.",
)
@click.option(
    "--speed", type=Finite(0.0, min_open=True, usual=10.0), default=0.6, show_default=True, help="Target speed, m/s."
)
@click.option(
    "--yaw-rate", type=Finite(0.0, min_open=True, usual=40.0), default=1.5, show_default=True, help="Yaw rate, rad/s."
)
@click.option("--size", type=click.IntRange(300, 4000), default=800, show_default=True, help="Size of the window, px.")
def main(place: Place, ghosts: tuple[str, ...], speed: float, yaw_rate: float, size: int) -> None:
    """Drives a robot by the keyboard in a window.

    ENV_ID is an environment's, such as wayfield/DiffDriveGoalObstacles-v0; by default a path to follow, or the first
    ghost's task. The keys are shown: arrows or W A S D; bases that can go sideways do with A and D. The clock starts
    with the first key. Ghosts and robot do not touch each other.
    """
    shown = any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER")))
    if sys.platform == "linux" and not shown:
        raise click.ClickException(_NO_DISPLAY)  # at once, not after the kernels have been compiled
    game = Game(place, ghosts, speed, yaw_rate)
    renderer = Renderer("human", FPS, size)
    try:
        run(game, renderer)
    except NoDisplay:
        raise click.ClickException(_NO_DISPLAY) from None
    except pygame.error as error:
        raise click.ClickException(f"no window can be opened: {error}") from None
    finally:
        renderer.close()
        game.close()
