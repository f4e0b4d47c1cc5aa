"""Films: `wayfield render`, of any policy in any scenario; and a few representative cases of a run as mp4."""

import dataclasses
import io
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.episodes.rollout import make_policy
from wayfield.benchmarks.figures.one_drive import Drive, Place, place_options
from wayfield.benchmarks.records.cases import Case
from wayfield.envs.rendering import Ghost, Renderer, Scene
from wayfield.envs.single import FPS
from wayfield.system.command_line import Finite, OneLineErrors, say
from wayfield.system.storage import write_whole

LONGEST = 800  # steps of a film of a run
MOST_GHOSTS = 40  # of one robot in a picture
_FILM_PX, _PICTURE_PX = 640, 1000
_COLOURS = 63  # of a GIF, beside the one that lets the frame before shine through


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
    name = "-".join(re.findall(r"[\w.]+", f"{case.contest} {case.family} {case.policy} {case.gains_text}"))
    drive = Drive(env, make_policy(case, seed))
    drive.begin(seed, None)
    folder.mkdir(parents=True, exist_ok=True)
    write_film([drive], folder / f"{name}.mp4")
    env.close()


@dataclasses.dataclass(frozen=True)
class Moment:
    """What is seen of an episode between two of its steps."""

    scene: Scene
    last: bool  # whether the film ends here


def moments(drives: Sequence[Drive], seconds: float) -> Iterator[Moment]:
    """Yields what an episode that has begun shows, from before its first step until it ends, for so long at most.

    Each must be drawn before the next is asked for, since a scene looks into the environment.

    Args:
        drives: the robot that is filmed, then those that are seen as its ghosts.
    """
    first, *others = drives
    most = max(1, round(seconds / first.single.task.options.dt))
    for k in range(most + 1):
        scene = dataclasses.replace(first.scene(), ghosts=tuple(other.ghost() for other in others))
        last = bool(first.ended) or k == most
        yield Moment(scene, last)
        if last:
            return
        for drive in drives:
            drive.step()


class Way:
    """The whole way of an episode, for a picture of it."""

    def __init__(self, dt: float) -> None:
        self._dt = dt  # s, between two moments
        self._poses: list[tuple[float, float, float]] = []
        self._low, self._high = np.full(2, np.inf), np.full(2, -np.inf)  # of all that the frames show
        self._last: Scene | None = None

    def note(self, scene: Scene) -> None:
        """Notes a moment."""
        self._poses.append(scene.pose)
        # a frame of a large world moves with the robot
        self._low, self._high = np.fmin(self._low, scene.bounds[:2]), np.fmax(self._high, scene.bounds[2:])
        self._last = scene

    def picture(self, size_px: int) -> NDArray[np.uint8]:
        """Returns one frame (h, w, 3): the last moment, and the robot at even times before as ghosts."""
        last = self._last
        assert last is not None
        every = max(round(1.0 / self._dt), len(self._poses) // MOST_GHOSTS)
        # of a team the ways are seen
        team = any(not body.person for body in last.bodies)
        before = () if team else tuple(Ghost(last.robot, pose) for pose in self._poses[:-1:every])
        bounds = (*self._low.tolist(), *self._high.tolist())
        whole = dataclasses.replace(last, bounds=bounds, ghosts=(*before, *last.ghosts))
        return _frame(whole, Renderer("rgb_array", FPS, size_px))


def write_film(
    drives: Sequence[Drive], file: Path, size_px: int | None = None, pace: float = 1.0, seconds: float = 3600.0
) -> None:
    """Writes a film of an episode that has begun as .mp4 or .gif, or its whole way as .png, whole or not at all.

    Frames go to the file as they are drawn: a long film takes no more memory than a short one.

    Args:
        drives: as for `moments`.
        size_px: of the longer side of a frame; None: 640, of a picture 1000.
        pace: how many seconds of the robot's a second of the film shows.
        seconds: of the robot's, at most.

    Raises:
        OSError: if the file cannot be written; what was there before still is.
    """
    dt, suffix = drives[0].single.task.options.dt, file.suffix.lower()
    if suffix == ".png":
        way = Way(dt)
        for moment in moments(drives, seconds):
            way.note(moment.scene)
        write_whole(file, _png(way.picture(size_px or _PICTURE_PX)))
        return
    skip = max(1, round(pace))  # viewers show at most some 20 frames a second
    frames = _frames(moments(drives, seconds), Renderer("rgb_array", FPS, size_px or _FILM_PX), skip, dt)
    write_whole(file, _FILMS[suffix](frames, dt * skip / pace))


def _frames(seen: Iterable[Moment], renderer: Renderer, skip: int, dt: float) -> Iterator[NDArray[np.uint8]]:
    """Yields a frame of every so manieth moment, and the last for as long as a second of the film."""
    for k, moment in enumerate(seen):
        if moment.last or k % skip == 0:
            frame = _frame(moment.scene, renderer)
            yield from [frame] * (max(1, round(1.0 / (dt * skip))) if moment.last else 1)


def _png(frame: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    content = io.BytesIO()
    Image.fromarray(frame).save(content, "PNG")
    return content.getvalue()


def gif(frames: Iterable[NDArray[np.uint8]], period: float) -> Iterator[bytes]:
    """Yields a GIF piece by piece, of frames (h, w, 3) with the colours of the first, each shown for a period (s).

    PIL keeps all frames until it writes the first; so only its headers and its coder of one frame are used.
    """
    from PIL import GifImagePlugin, Image

    shown: NDArray[np.uint8] | None = None  # indices of colours
    due, written = 0.0, 0  # ms, when the frame that waits ends, and how much of that is written
    waiting: tuple[Any, tuple[int, int]] | None = None

    def piece() -> Iterator[bytes]:
        assert waiting is not None
        length = 10 * round((due - written) / 10)  # the format counts in hundredths of a second
        kwargs = {"duration": length, "transparency": _COLOURS, "disposal": 1}
        yield from GifImagePlugin.getdata(waiting[0], waiting[1], **kwargs)

    for frame in frames:
        image = Image.fromarray(frame)
        if shown is None:
            colours = image.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE)  # of few pixels too
            palette = ((colours.getpalette() or []) + [255] * 3 * _COLOURS)[: 3 * _COLOURS] + [255] * 3
        indices = np.asarray(image.quantize(palette=colours, dither=Image.Dither.NONE))
        changed = np.ones_like(indices, np.bool_) if shown is None else indices != shown
        if shown is None or changed.any():
            if waiting is not None:
                yield from piece()
                written += 10 * round((due - written) / 10)
            rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
            area = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
            seen = np.where(changed, indices, _COLOURS).astype(np.uint8)[area]
            part = Image.frombytes("P", seen.shape[::-1], seen.tobytes())
            part.putpalette(palette)
            if shown is None:
                yield from GifImagePlugin.getheader(part.copy(), info={"loop": 0})[0]
            waiting, shown = (part, (int(columns[0]), int(rows[0]))), indices
        due += 1000.0 * period
    if waiting is not None:
        yield from piece()
    yield b";"


def _mp4(frames: Iterable[NDArray[np.uint8]], period: float) -> Iterator[bytes]:
    """Yields an mp4 piece by piece, once all frames are encoded."""
    from moviepy.video.io.ffmpeg_writer import FFMPEG_VideoWriter

    with tempfile.TemporaryDirectory() as folder:
        made, writer = Path(folder) / "film.mp4", None
        for frame in frames:
            if writer is None:
                size = frame.shape[1::-1]
                writer = FFMPEG_VideoWriter(str(made), size, 1.0 / period, "libx264", pixel_format="yuv420p")
            writer.write_frame(frame)
        if writer is not None:
            writer.close()
        with made.open("rb") as stream:
            while content := stream.read(2**20):
                yield content


_FILMS = {".mp4": _mp4, ".gif": gif}
FORMATS = (*_FILMS, ".png")


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
@click.option("--ghost", "ghosts", metavar="POLICY", multiple=True, help="Another beside it; may be repeated.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help=".mp4, .gif or .png.")
@click.option(
    "--seconds",
    type=Finite(0.0, 3600.0, min_open=True),
    help="At most; may be longer than the time limit, the default.",
)
@click.option("--size", type=click.IntRange(100, 4000), help="Pixels of the longer side.  [default: 640; .png 1000]")
@click.option("--pace", type=Finite(0.1, 100.0), default=1.0, show_default=True, help="Times real time.")
@click.option("--force", is_flag=True, help="Replace the file if there is one.")
def main(place: Place, policy: str, ghosts: tuple[str, ...], out: Path, **given: Any) -> None:
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
    for text in (policy, *ghosts):
        env = place.make(policy, given["seconds"] or 0.0)
        drives.append(Drive(env, place.policy(text, env), text))
        drives[-1].begin(place.seed, place.index)
    write_film(drives, out, given["size"], given["pace"], given["seconds"] or 3600.0)
    say(f"{'; '.join(f'{each.name}: {each.status}' for each in drives)}; written to {out}")
