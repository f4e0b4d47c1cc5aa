"""One robot for other programs: `wayfield robot NAME --mjcf FILE`."""

import io
from pathlib import Path

import click

from wayfield.envs.robots import Robot
from wayfield.envs.robots.mjcf import WHEELS, mjcf
from wayfield.envs.robots.robot_option import RobotChoice
from wayfield.envs.tasks.task import plant_class
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

_KINDS = tuple(dict.fromkeys(kind for kinds in WHEELS.values() for kind in kinds))


@click.command("robot", cls=OneLineErrors)
@click.argument("robot", type=RobotChoice("robot"))
@click.option("--mjcf", "model", type=click.Path(dir_okay=False), help="Write MuJoCo's model (MJCF) here.")
@click.option("--picture", type=click.Path(dir_okay=False), help="Write MuJoCo's picture (PNG) here; needs mujoco.")
@click.option("--wheels", metavar="KIND", help=f"{', '.join(_KINDS)}.  [default: the first that the drive has]")
def robot(robot: Robot, model: str | None, picture: str | None, wheels: str | None) -> None:
    """Writes a model of ROBOT, by name or data sheet, for other programs."""
    if model is None and picture is None:
        raise click.UsageError("nothing to write: give --mjcf FILE or --picture FILE")
    for option, file, ending in (("--mjcf", model, ".xml"), ("--picture", picture, ".png")):
        if file is not None and not file.lower().endswith(ending):
            raise click.UsageError(f"{option} {file!r} must end in {ending}")
    try:
        text = mjcf(robot, wheels)
        if picture is not None:
            _draw(robot, wheels, picture)
    except (ValueError, ImportError, RuntimeError) as error:
        raise click.UsageError(str(error)) from None
    if model is not None:
        write_whole(Path(model), text.encode())
    click.echo(f"wrote {', '.join(each for each in (model, picture) if each)}")


def _draw(robot: Robot, wheels: str | None, file: str) -> None:
    """Writes the picture of a robot."""
    from PIL import Image

    plant_class("mujoco")  # says what is missing
    from wayfield.envs.mujoco_plant import portrait

    stream = io.BytesIO()
    Image.fromarray(portrait(robot, wheels)).save(stream, "PNG")
    write_whole(Path(file), stream.getvalue())
