"""Serves a scene to CoppeliaSim's clients: python -m wayfield.bridges.coppelia --help"""

import functools
import logging
import signal
import sys
import time
from pathlib import Path
from typing import Any

from wayfield.system.extras import installs

try:
    import cbor2  # noqa: F401
    import click
    import zmq  # noqa: F401
except ModuleNotFoundError as missing:
    sys.exit(f"coppelia: {missing.name} is missing: {installs('coppelia')}")

from wayfield.bridges.coppelia.models import MODELLED
from wayfield.bridges.coppelia.scene_files import run_setup
from wayfield.bridges.coppelia.scenes import DOCUMENT_A, SCENES, Conditions, make_world
from wayfield.bridges.coppelia.server import LOCAL, LOG, PORT, Server
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.system.checks import unread
from wayfield.system.command_line import Choice, Finite, OneLineErrors

RENDER_MODES = ("none", "human")
TRACKS = {"coppelia": None, "wayfield": -ROBOTS["p3dx"].wheel_positions[0][1]}


class Track(Finite):
    """A half track in metres, or the name of one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Returns the half track, m; None for that of CoppeliaSim's model."""
        return TRACKS[value] if value in TRACKS else super().convert(value, param, ctx)


@click.command("coppelia", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--scene",
    default=DOCUMENT_A,
    show_default=True,
    metavar="NAME|FILE",
    help=f"{', '.join(SCENES)}; a path or goal scenario or family; or the file of a scenario or of a scene.",
)
@click.option(
    "--index", "number", type=click.IntRange(min=0), default=0, help="Which scenario of a family.  [default: 0]"
)
@click.option("--robot", type=Choice("--robot", MODELLED), help="The robot.  [default: the scene's, mostly p3dx]")
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0 takes a free one.")
@click.option("--host", default="127.0.0.1", show_default=True, help="The address to bind.")
@click.option(
    "--speed",
    type=Finite(0.0, 1e6),
    default=1.0,
    show_default=True,
    help="Simulation seconds per second while no client steps; 0: no pacing.",
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
    "half_track",
    type=Track(0.02, 1.0),
    default="coppelia",
    show_default=True,
    metavar="coppelia|wayfield|METRES",
    help="Half track of the p3dx: 0.1655 m of CoppeliaSim's model, document A's 0.1905 m, or another.",
)
@click.option("--dt", type=Finite(1e-3, 1.0), default=CONTROL_PERIOD, show_default=True, help="The time step, s.")
@click.option(
    "--legacy",
    metavar="FOLDER",
    help="Writes sim and vrep there, which bring scripts for the legacy remote API to the server, and ends.",
)
@click.option(
    "--setup", metavar="SCRIPT.py", help="A script of yours that is run once, with `sim`, before the first client."
)
@click.option("--start", is_flag=True, help="Starts the simulation at once, as the play button does.")
@click.option(
    "--real-time", is_flag=True, help="Stepped passes follow the wall clock too, so that they can be watched."
)
@click.option(
    "--render",
    type=Choice("--render", RENDER_MODES),
    default="none",
    show_default=True,
    help="human: a window; the server runs on when you close it.",
)
def main(
    scene: str,
    robot: str | None,
    port: int,
    host: str,
    speed: float,
    legacy: str | None,
    setup: str | None,
    start: bool,
    real_time: bool,
    render: str,
    **driven: Any,
) -> None:
    """Serves a scene on CoppeliaSim's ZeroMQ remote API; scripts for CoppeliaSim run unchanged.

    The log goes to stderr, one line per event. Ctrl-C ends the server.
    """
    if legacy is not None:
        _write_legacy(Path(legacy))
        return
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    conditions = Conditions(robot, **driven)
    own_track = None if robot not in (None, "p3dx") else conditions.half_track
    load = functools.partial(_load, conditions=conditions._replace(half_track=own_track, number=0))
    try:
        world = make_world(scene, conditions)
    except OSError as error:
        raise click.UsageError(f"--scene {scene!r} cannot be read: {unread(scene, error)}") from None
    except ValueError as error:
        raise click.UsageError(f"--scene: {error}") from None
    window = None
    if render == "human":
        from gymnasium.error import DependencyNotInstalled

        try:
            from wayfield.bridges.coppelia.window import Window
        except DependencyNotInstalled as error:
            raise click.ClickException(str(error)) from None
        window = Window()
    server = Server(world, host, port, speed, load, real_time)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.stop())
    if host not in LOCAL:
        LOG.warning("%s is served to every host that can reach it: the protocol has no authentication", host)
    LOG.info("scene %s, %s, on %s:%d", world.scene.name, conditions.dynamics, host, server.port)
    if setup is not None:
        try:
            run_setup(setup, server)
        except (Exception, SystemExit) as error:
            raise click.UsageError(f"--setup {setup!r}: {type(error).__name__}: {error}") from error
    if start:
        world.start()
        server.schedule(time.monotonic())
    server.serve(None if window is None else functools.partial(window.show, server))
    if window is not None:
        window.close()
    LOG.info("ended")


def _write_legacy(folder: Path) -> None:
    """Writes the stand-in for the legacy remote API into a folder, unless another module of the name is there."""
    text = (Path(__file__).parent / "legacy.py").read_text(encoding="utf-8")
    try:
        files = [_place_of(folder, name, text) for name in ("sim", "vrep")]
        for file in files:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise click.UsageError(f"--legacy {str(folder)!r}: {error.strerror or error}") from None
    click.echo(f"{files[0]} and {files[1]}: scripts in {folder} that `import sim` or `import vrep` drive the server")
    for file in files:
        if file.parent != folder:
            click.echo(f"{file.parent}.py of CoppeliaSim stays; delete the folder {file.parent} to import it again")


def _place_of(folder: Path, name: str, text: str) -> Path:
    """Returns the file that `import NAME` shall find: beside CoppeliaSim's own NAME.py a package, found before it."""
    package, module = folder / name / "__init__.py", folder / f"{name}.py"
    for file in (package, module):
        content = file.read_text(encoding="utf-8", errors="replace") if file.exists() else text
        if not content.startswith(text[:80]):
            if file == module and "def simxStart" in content:
                return package
            raise click.UsageError(f"--legacy: {file} is there and not ours; move it away, or choose another folder")
    return package if package.exists() else module


def _load(name: str, conditions: Conditions) -> Any:
    return make_world(name, conditions, files=False)


if __name__ == "__main__":
    main()
