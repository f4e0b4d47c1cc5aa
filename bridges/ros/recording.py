"""Messages as an MCAP file, as ROS 2 records them: rosbags and Foxglove read it, and `ros2 bag play` does."""

import os
import re
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

_PLAIN = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}


def _written(kind: str) -> tuple[str, str]:
    """Returns a field's type as a .msg file has it, and the type of what it holds."""
    if result := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind):
        inner, held = _written(result[1])
        return f"{inner}[{f'<={result[2]}' if result[2] else ''}]", held
    if result := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        inner, held = _written(result[1])
        return f"{inner}[{result[2]}]", held
    plain = _PLAIN.get(kind, kind)
    return plain, plain


def definition(message: Any, find: Any) -> str:
    """Returns the definition of a message and of all that it holds, as .msg files joined by lines of "=".

    Args:
        message: its class, as rosidl generates them.
        find: from a type such as "std_msgs/Header" to its class.
    """
    texts, waiting, seen = [], [("", message)], {""}
    while waiting:
        name, cls = waiting.pop(0)
        lines = [f"{'=' * 80}\nMSG: {name}"] if name else []
        for field, kind in cls.get_fields_and_field_types().items():
            wrote, held = _written(kind)
            lines.append(f"{wrote} {field}")
            if "/" in held and held not in seen:
                seen.add(held)
                waiting.append((held, find(held)))
        texts.append("\n".join(lines))
    return "\n".join(texts) + "\n"


class Recorder:
    """An MCAP file that grows beside its name, as FILE.part, and takes it once it is closed.

    Raises:
        ValueError: if the name does not end in .mcap.
        FileExistsError: if there is such a file.
        OSError: if it cannot be written.
    """

    def __init__(self, file: str | Path) -> None:
        self.file = Path(file)
        if self.file.suffix != ".mcap":
            raise ValueError(f"--record {str(file)!r} must end in .mcap")
        if self.file.exists():
            raise FileExistsError(f"--record {file}: there is such a file; choose another name")
        self.part = self.file.with_name(self.file.name + ".part")
        self._stream = open(self.part, "wb")  # noqa: SIM115  as long as the recording
        self._writer: Any = Writer(self._stream, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library="wayfield")
        self._channels: dict[str, int] = {}
        self.count = 0

    def add(self, topic: str, kind: str, text: str) -> None:
        """Adds a topic of messages of a type such as "nav_msgs/msg/Odometry" with its definition."""
        schema = self._writer.register_schema(kind, "ros2msg", text.encode())
        self._channels[topic] = self._writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": ""})

    def __contains__(self, topic: str) -> bool:
        return topic in self._channels

    def write(self, topic: str, time: float, message: bytes) -> None:
        """Writes a serialized message of a time (s)."""
        nanoseconds = round(1e9 * time)
        self._writer.add_message(self._channels[topic], nanoseconds, message, nanoseconds, self.count)
        self.count += 1

    def close(self) -> None:
        """Ends the file and gives it its name."""
        self._writer.finish()
        self._stream.close()
        os.replace(self.part, self.file)
