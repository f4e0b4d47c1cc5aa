"""Films: `wayfield render`, of any policy in any scenario; and a few representative cases of a run as mp4."""

import dataclasses
import io
import logging
import os
import re
import tempfile
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.episodes.rollout import make_policy
from wayfield.benchmarks.figures.one_drive import Drive, Place, chased, place_options
from wayfield.benchmarks.records.cases import Case
from wayfield.envs.rendering import Ghost, Renderer, Scene
from wayfield.envs.single import FPS
from wayfield.policies.lookahead import Lookahead
from wayfield.policies.pilot import Pilot
from wayfield.system.command_line import Finite, OneLineErrors, say
from wayfield.system.storage import write_whole

LONGEST = 800  # steps of a film of a run
MOST_GHOSTS = 40  # of one robot in a picture


def film(folder: Path, cases: Iterable[Case], dynamics: str, actuators: str, seed: int) -> None:
    """Writes an mp4 of the first episode of each case that is to be filmed, of the first case if none is."""
    cases = list(cases)
    for case in [case for case in cases if case.filmed] or cases[:1]:
        _film(folder, case, dynamics, actuators, seed)


def _film(folder: Path, case: Case, dynamics: str, actuators: str, seed: int) -> None:
    env = gymnasium.make(
        case.env_id,
        max_episode_steps=min(case.max_episode_steps, LONGEST),
        render_mode="rgb_array",
        scenario=case.scenario,
        dynamics=dynamics,
        actuators=actuators,
        **case.env_kwargs,
    )
    name = "-".join(re.findall(r"[\w.]+", f"{case.document} {case.experiment} {case.policy} {case.gains_text}"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the folder exists already
        recorded = gymnasium.wrappers.RecordVideo(env, str(folder), name_prefix=name, disable_logger=True)
    logging.getLogger("moviepy").setLevel(logging.ERROR)
    pilot = Pilot(make_policy(case, seed), recorded)
    observation, _ = recorded.reset(seed=seed)
    pilot.reset()
    ended = False
    while not ended:
        if isinstance(pilot.policy, Lookahead):
            single: Any = recorded.unwrapped
            single.marks = chased(pilot, single)
        observation, _, terminated, truncated, _ = recorded.step(pilot.act(observation))
        ended = terminated or truncated
    recorded.close()  # type: ignore[no-untyped-call]


@dataclasses.dataclass(frozen=True)
class Film:
    """What was seen of an episode."""

    scenes: tuple[Scene, ...]  # from before the first step on, a control period apart
    poses: tuple[tuple[float, float, float], ...]  # of the robot in each
    dt: float  # s, between two
    told: str  # how it ended, in words

    def __len__(self) -> int:
        return len(self.scenes)


def filmed(drive: Drive, ghost: Drive | None, seconds: float) -> Film:
    """Returns what an episode that has begun shows until it ends, of a ghost beside it too, for so long at most."""
    dt = drive.single.task.options.dt
    scenes, poses = [], []
    last = max(1, round(seconds / dt))
    for k in range(last + 1):
        scene = drive.scene()
        if ghost is not None:
            scene = dataclasses.replace(scene, ghosts=(ghost.ghost(),))
        scenes.append(scene)
        poses.append(drive.pose)
        if drive.ended or k == last:
            break
        drive.step()
        if ghost is not None:
            ghost.step()
    return Film(tuple(scenes), tuple(poses), dt, drive.told)


def picture(film: Film, size_px: int) -> NDArray[np.uint8]:
    """Returns the whole way in one frame (h, w, 3): the last moment, and the robot at even times before as ghosts."""
    last = film.scenes[-1]
    every = max(round(1.0 / film.dt), len(film) // MOST_GHOSTS)
    # of a team the ways are seen
    team = any(not body.person for body in last.bodies)
    before = () if team else tuple(Ghost(last.robot, pose) for pose in film.poses[:-1:every])
    # a frame of a large world moves with the robot: all that any of them shows
    lows, highs = np.split(np.array([scene.bounds for scene in film.scenes]), 2, axis=1)
    bounds = (*lows.min(axis=0).tolist(), *highs.max(axis=0).tolist())
    whole = dataclasses.replace(last, bounds=bounds, ghosts=(*before, *last.ghosts))
    return _frame(whole, Renderer("rgb_array", FPS, size_px))


def write_film(film: Film, file: Path, size_px: int, pace: float) -> None:
    """Writes a film as .mp4 or .gif, or the whole way as .png, whole or not at all.

    Args:
        size_px: of the longer side of a frame.
        pace: how many seconds of the robot's a second of the film shows.

    Raises:
        OSError: if the file cannot be written; what was there before still is.
    """
    write_whole(file, FORMATS[file.suffix.lower()](film, size_px, pace))


def _png(film: Film, size_px: int, pace: float) -> bytes:
    from PIL import Image

    del pace
    content = io.BytesIO()
    Image.fromarray(picture(film, size_px)).save(content, "PNG")
    return content.getvalue()


def _gif(film: Film, size_px: int, pace: float) -> bytes:
    from PIL import Image

    # viewers show at most some 20 frames a second, and the format counts in hundredths
    skip = max(1, round(pace))
    renderer = Renderer("rgb_array", FPS, size_px)
    return gif([Image.fromarray(_frame(scene, renderer)) for scene in _every(film, skip)], film.dt * skip / pace)


def gif(frames: Sequence[Any], period: float) -> bytes:
    """Returns a GIF of pictures of PIL with the colours of the last, each shown for a period (s)."""
    from PIL import Image

    colours = frames[-1].quantize(64)
    flat = [frame.quantize(palette=colours, dither=Image.Dither.NONE) for frame in frames]
    content = io.BytesIO()
    kwargs = {"append_images": flat[1:], "duration": round(1000 * period), "loop": 0, "optimize": True}
    flat[0].save(content, "GIF", save_all=True, **kwargs)
    return content.getvalue()


def _mp4(film: Film, size_px: int, pace: float) -> bytes:
    from moviepy import ImageSequenceClip

    skip = max(1, round(pace))
    renderer = Renderer("rgb_array", FPS, size_px)
    frames = [_frame(scene, renderer) for scene in _every(film, skip)]
    logging.getLogger("moviepy").setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "film.mp4"
        clip = ImageSequenceClip(frames, fps=pace / (film.dt * skip))
        clip.write_videofile(str(made), codec="libx264", audio=False, logger=None)
        return made.read_bytes()


FORMATS = {".mp4": _mp4, ".gif": _gif, ".png": _png}


def _every(film: Film, skip: int) -> list[Scene]:
    """Returns every so manieth scene, and the last for as long as a second of the film."""
    return [*film.scenes[:-1:skip], *[film.scenes[-1]] * round(1.0 / (film.dt * skip))]


def _frame(scene: Scene, renderer: Renderer) -> NDArray[np.uint8]:
    drawn = renderer.draw(scene)
    assert drawn is not None
    return drawn


@click.command("render", cls=OneLineErrors)
@place_options
@click.option(
    "--policy",
    metavar="POLICY",
    required=True,
    help="A name, with gains as key=value behind it in the same word; module:Class or model.zip of your own; or the "
    "folder of an agent.",
)
@click.option("--ghost", metavar="POLICY", help="Another that drives beside it.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help=".mp4, .gif or .png.")
@click.option("--seconds", type=Finite(0.0, 3600.0, min_open=True), help="At most.  [default: the clock]")
@click.option("--size", type=click.IntRange(100, 4000), help="Pixels of the longer side.  [default: 640; .png 1000]")
@click.option("--pace", type=Finite(0.1, 100.0), default=1.0, show_default=True, help="Times the robot's.")
@click.option("--force", is_flag=True, help="Replace the file if there is one.")
def main(place: Place, policy: str, ghost: str | None, out: Path, **given: Any) -> None:
    """Films a policy in a scenario, or draws its whole way as one picture.

    ENV_ID is an environment's, such as wayfield/DiffDriveGoalObstacles-v0; by default that of the policy's task for the
    robot.
    """
    if out.suffix.lower() not in FORMATS:
        raise click.UsageError(f"--out {str(out)!r} must end in {', '.join(FORMATS)}")
    if os.path.lexists(out) and not given["force"]:
        raise click.UsageError(f"--out {str(out)!r} is there already; --force replaces it")
    if not out.absolute().parent.is_dir():
        raise click.UsageError(f"--out {str(out)!r} cannot be written: there is no folder {out.absolute().parent}")
    drives = []
    for text in filter(None, (policy, ghost)):
        env = place.make(policy)
        drives.append(Drive(env, place.policy(text, env)))
        drives[-1].begin(place.seed, place.index)
    film = filmed(drives[0], drives[1] if ghost else None, given["seconds"] or 3600.0)
    write_film(film, out, given["size"] or (1000 if out.suffix.lower() == ".png" else 640), given["pace"])
    also = f"; {ghost}: {drives[1].told}" if ghost else ""
    say(f"{policy}: {film.told}{also}; written to {out}")
