"""One episode as an MCAP file, for Foxglove and whatever else reads it: poses, scan, obstacles, commands, numbers.

Messages are JSON under the names of Foxglove's schemas (https://docs.foxglove.dev/docs/sdk/schemas), so that a viewer
draws them without any settings; the frame "map" is the world's, "base" the robot's.
"""

import io
import json
import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from wayfield.benchmarks.episodes.recorder import Episode
from wayfield.envs.robots import Robot
from wayfield.system.readers import reader
from wayfield.system.storage import write_whole

_LIBRARY = "wayfield"  # in the header of the files that are ours
_INFINITE = "1e999"  # JSON has no infinity; every parser that reads a double makes one of this
_HEIGHT, _THIN = 0.5, 0.01  # m, of what is drawn of obstacles
_SHAPES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
_GREY = {"r": 0.4, "g": 0.4, "b": 0.45, "a": 0.9}
_BLUE = {"r": 0.0, "g": 0.45, "b": 0.7, "a": 0.9}
_GREEN = {"r": 0.0, "g": 0.6, "b": 0.5, "a": 0.9}

# topic: the schema's name and the fields that a message has
TOPICS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "/tf": ("foxglove.FrameTransform", {"parent_frame_id": "string", "child_frame_id": "string"}),
    "/scan": ("foxglove.LaserScan", {"frame_id": "string", "ranges": "array"}),
    "/scene": ("foxglove.SceneUpdate", {"entities": "array"}),
    "/action": ("wayfield.Action", {"action": "array"}),
    "/told": ("wayfield.Info", {"reward": "number"}),
}


def _stamp(seconds: float) -> dict[str, int]:
    nanoseconds = round(1e9 * seconds)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}


def _pose(x: float, y: float, heading: float, z: float = 0.0) -> dict[str, Any]:
    return {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * heading), "w": math.cos(0.5 * heading)},
    }


class _File:
    """An MCAP file with our topics."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channels = {}
        for topic, (name, fields) in TOPICS.items():
            properties = {field: {"type": kind} for field, kind in fields.items()}
            schema = json.dumps({"type": "object", "title": name, "properties": properties}).encode()
            number = writer.register_schema(name, "jsonschema", schema)
            self._channels[topic] = writer.register_channel(topic, "json", number)

    def say(self, topic: str, seconds: float, message: Mapping[str, Any]) -> None:
        """Writes a message that holds at a time of the episode."""
        time = round(1e9 * seconds)
        text = json.dumps(message).replace("Infinity", _INFINITE)
        self._writer.add_message(self._channels[topic], time, text.encode(), time)


def _shape(obstacle: NDArray[np.void]) -> dict[str, Any]:
    """Returns an obstacle as a cylinder or a cube; a wall is a thin cube."""
    pose = _pose(float(obstacle["x"]), float(obstacle["y"]), math.atan2(obstacle["sin"], obstacle["cos"]), _HEIGHT / 2)
    if obstacle["radius"] > 0.0:
        wide = 2.0 * float(obstacle["radius"])
        size = {"x": wide, "y": wide, "z": _HEIGHT}
        return {"cylinders": [{"pose": pose, "size": size, "bottom_scale": 1.0, "top_scale": 1.0, "color": _GREY}]}
    long, across = (2.0 * float(obstacle[name]) for name in ("half_length", "half_width"))
    size = {"x": max(long, _THIN), "y": max(across, _THIN), "z": _HEIGHT}
    return {"cubes": [{"pose": pose, "size": size, "color": _GREY}]}


def _hull(robot: Robot) -> dict[str, Any]:
    """Returns the hull of a robot, a cylinder or a cube that goes with it."""
    length, width = robot.hull_box or (2.0 * robot.hull_radius,) * 2
    size = {"x": length, "y": width, "z": _HEIGHT}
    shape = {"pose": _pose(robot.hull_x, 0.0, 0.0, _HEIGHT / 2), "size": size, "color": _BLUE}
    round_ = {"cylinders": [{**shape, "bottom_scale": 1.0, "top_scale": 1.0}]}
    entity = _entity("hull", 0.0, round_ if robot.hull_box is None else {"cubes": [shape]})
    return entity | {"frame_id": "base", "frame_locked": True}


def _line(points: NDArray[np.float64]) -> dict[str, Any]:
    """Returns a polyline (n, 2) on the floor."""
    return {
        "type": 0,
        "pose": _pose(0.0, 0.0, 0.0),
        "thickness": 0.02,
        "scale_invariant": False,
        "points": [{"x": x, "y": y, "z": 0.0} for x, y in points.tolist()],
        "color": _GREEN,
        "colors": [],
        "indices": [],
    }


def _entity(name: str, seconds: float, shapes: Mapping[str, Any]) -> dict[str, Any]:
    """Returns an entity that stays until one of its name takes its place."""
    empty: dict[str, list[Any]] = {each: [] for each in _SHAPES}
    return {
        "timestamp": _stamp(seconds),
        "frame_id": "map",
        "id": name,
        "lifetime": _stamp(0.0),
        "frame_locked": False,
        "metadata": [],
        **empty,
        **shapes,
    }


def _still(base: Any) -> list[dict[str, Any]]:
    """Returns what does not move: the hull's path, or the goals with their headings."""
    entities = []
    drawn = base.task.drawing(base.batch.states[0])
    if drawn.get("path") is not None:
        entities.append(_entity("path", 0.0, {"lines": [_line(drawn["path"])]}))
    for k, (x, y, heading) in enumerate(np.asarray(drawn.get("goals", np.empty((0, 3)))).tolist()):
        arrow = {
            "pose": _pose(x, y, 0.0 if math.isnan(heading) else heading),
            "shaft_length": 0.2,
            "shaft_diameter": 0.05,
            "head_length": 0.1,
            "head_diameter": 0.1,
            "color": _GREEN,
        }
        entities.append(_entity(f"goal {k}", 0.0, {"arrows": [arrow]}))
    return entities


def _sample_mcap(folder: Path) -> None:
    with open(folder / "first.mcap", "wb") as stream:
        writer: Any = Writer(stream, compression=CompressionType.LZ4)
        writer.start(library=_LIBRARY)
        writer.finish()


@reader("MCAP of an episode", "first.mcap", _sample_mcap)
def is_ours(file: str | Path) -> bool:
    """Returns whether a file is an MCAP file that `write_mcap` has written, by its header.

    Raises:
        OSError: if it cannot be opened.
    """
    if not Path(file).is_file():
        return False
    with open(file, "rb") as stream:
        try:
            return bool(make_reader(stream).get_header().library == _LIBRARY)
        except (McapError, StopIteration, ValueError, struct.error, EOFError):
            return False


def write_mcap(file: Path, env: gymnasium.Env[Any, Any], episode: Episode, about: Mapping[str, Any]) -> None:
    """Writes an episode, driven again from its seed and actions, as an MCAP file; whole or not at all.

    Args:
        env: the single environment that the episode belongs to; it is reset.
        about: what stands in the file of the episode, such as its policy.

    Raises:
        ValueError: if the environment does not do again what was recorded.
        OSError: if the file cannot be written.
    """
    base: Any = env.unwrapped
    with io.BytesIO() as stream:
        writer: Any = Writer(stream, compression=CompressionType.LZ4)
        writer.start(library=_LIBRARY)
        writer.add_metadata("episode", {name: str(value) for name, value in about.items()})
        said = _File(writer)
        seen, info = env.reset(seed=episode.start.seed, options={"scenario": episode.start.scenario})
        reward, dt = 0.0, base.task.options.dt
        last: bytes = b""
        for step in range(len(episode.actions) + 1):
            if not np.array_equal(seen, episode.observations[step]):
                raise ValueError(f"{file}: the environment drives differently from step {step} on")
            time = step * dt
            state = base.batch.states[0]
            pose = _pose(float(state["x"]), float(state["y"]), float(state["heading"]))
            said.say("/tf", time, {"timestamp": _stamp(time), "parent_frame_id": "map", "child_frame_id": "base",
                                   "translation": pose["position"], "rotation": pose["orientation"]})  # fmt: skip
            field = base.batch.states["field"][0]
            obstacles = base.batch.known_obstacles[field, : int(base.task.obstacle_counts(base.batch.states)[0])]
            if obstacles.tobytes() != last or not step:
                last = obstacles.tobytes()
                entities = [_entity(f"obstacle {k}", time, _shape(each)) for k, each in enumerate(obstacles)]
                entities += [_hull(base.task.robot), *_still(base)] if not step else []
                said.say("/scene", time, {"deletions": [], "entities": entities})
            _say_scan(said, base, time, seen)
            said.say("/told", time, {"reward": float(reward), **{name: _plain(value) for name, value in info.items()}})
            if step < len(episode.actions):
                said.say("/action", time, {"action": episode.actions[step].tolist()})
                seen, reward, _, _, info = env.step(episode.actions[step])  # type: ignore[assignment]
        writer.finish()
        write_whole(file, stream.getvalue())


def _say_scan(said: _File, base: Any, time: float, seen: NDArray[np.float32]) -> None:
    ranges = getattr(base.task.layout.unpack(seen), "ranges", np.empty(0))
    if not len(ranges):
        return
    angles = base.task.beam_angles
    returned = ranges < np.float32(base.task.max_range)
    said.say(
        "/scan",
        time,
        {
            "timestamp": _stamp(time),
            "frame_id": "base",
            "pose": _pose(0.0, 0.0, 0.0),
            "start_angle": float(angles[0]),
            "end_angle": float(angles[-1]),
            # a beam without a return is infinite, as REP 117 has it
            "ranges": np.where(returned, ranges, np.inf).tolist(),
            "intensities": [],
        },
    )


def _plain(value: Any) -> float | bool | None:
    """Returns a number as JSON has it: what is not finite is null."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    return float(value) if math.isfinite(value) else None
