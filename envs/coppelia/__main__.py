"""Serves a scene to CoppeliaSim's clients: python -m wayfield.envs.coppelia --help"""

import functools
import logging
import math
import signal
import sys
from typing import Any

try:
    import cbor2  # noqa: F401
    import click
    import zmq  # noqa: F401
except ModuleNotFoundError as missing:
    sys.exit(f'coppelia: {missing.name} is missing: pip install "wayfield[coppelia]"')

from wayfield.envs.command_line import Choice, OneLineErrors
from wayfield.envs.coppelia.models import MODELLED
from wayfield.envs.coppelia.scenes import DOCUMENT_A, SCENES, Conditions, make_world
from wayfield.envs.coppelia.server import LOCAL, LOG, PORT, Server
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.task import CONTROL_PERIOD

RENDER_MODES = ("none", "human")
TRACKS = {"coppelia": None, "wayfield": -ROBOTS["p3dx"].wheel_positions[0][1]}


class Number(click.ParamType):  # type: ignore[type-arg]  # generic in the newest releases of click alone
    """A number within bounds."""

    name = "number"

    def __init__(self, field: str, low: float, high: float) -> None:
        self.field, self.low, self.high = field, low, high

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Returns the number, or fails."""
        del param, ctx
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not self.low <= number <= self.high:
            raise click.UsageError(f"{self.field} {value!r} must be a number from {self.low:g} to {self.high:g}")
        return number


class Track(Number):
    """A half track in metres, or whose it is."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Returns the half track, None for that of CoppeliaSim's model, or fails."""
        return TRACKS[value] if value in TRACKS else super().convert(value, param, ctx)


@click.command("coppelia", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--scene",
    default=DOCUMENT_A,
    show_default=True,
    metavar="NAME|FILE",
    help=f"{', '.join(SCENES)}; a path or goal scenario or family of the environments; or a scenario file.",
)
@click.option("--index", type=click.IntRange(min=0), default=0, help="Which scenario of a family.  [default: 0]")
@click.option("--robot", type=Choice("--robot", MODELLED), help="The robot.  [default: the scene's, mostly p3dx]")
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0 takes a free one.")
@click.option("--host", default="127.0.0.1", show_default=True, help="The address that is served.")
@click.option(
    "--speed",
    type=Number("--speed", 0.0, math.inf),
    default=1.0,
    show_default=True,
    help="Seconds of simulation in a second while nobody steps; 0: as fast as it goes.",
)
@click.option(
    "--dynamics",
    type=Choice("--dynamics", ("kinematic", "pymunk")),
    default="kinematic",
    show_default=True,
    help="The plant.",
)
@click.option(
    "--actuators", type=Choice("--actuators", ACTUATORS), default="ideal", show_default=True, help="The actuator tier."
)
@click.option(
    "--track",
    type=Track("--track", 0.02, 1.0),
    default="coppelia",
    show_default=True,
    metavar="coppelia|wayfield|METRES",
    help="Half track of the p3dx: 0.1655 m of CoppeliaSim's model, document A's 0.1905 m, or another.",
)
@click.option(
    "--dt", type=Number("--dt", 1e-3, 1.0), default=CONTROL_PERIOD, show_default=True, help="The time step, s."
)
@click.option(
    "--render", type=Choice("--render", RENDER_MODES), default="none", show_default=True, help="human: a window."
)
def main(
    scene: str,
    index: int,
    robot: str | None,
    port: int,
    host: str,
    speed: float,
    track: float | None,
    render: str,
    **driven: Any,
) -> None:
    """Serves a scene on CoppeliaSim's ZeroMQ remote API: its scripts drive the robot in it unchanged.

    The log goes to stderr, a line an event. Ctrl-C ends it.
    """
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    conditions = Conditions(robot, half_track=track, number=index, **driven)
    own_track = None if robot not in (None, "p3dx") else track
    load = functools.partial(_load, conditions=conditions._replace(half_track=own_track, number=0))
    try:
        world = make_world(scene, conditions)
    except OSError as error:
        raise click.UsageError(f"--scene {scene!r} cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise click.UsageError(f"--scene: {error}") from None
    window = None
    if render == "human":
        from gymnasium.error import DependencyNotInstalled

        try:
            from wayfield.envs.coppelia.window import Window
        except DependencyNotInstalled as error:
            raise click.ClickException(str(error)) from None
        window = Window()
    server = Server(world, host, port, speed, load)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.stop())
    if host not in LOCAL:
        LOG.warning("%s is served to everybody who can reach it: the protocol knows no passwords", host)
    LOG.info("scene %s, %s, on %s:%d", world.scene.name, conditions.dynamics, host, server.port)
    server.serve(None if window is None else functools.partial(window.show, server))
    if window is not None:
        window.close()
    LOG.info("ended")


def _load(name: str, conditions: Conditions) -> Any:
    return make_world(name, conditions, files=False)


if __name__ == "__main__":
    main()
