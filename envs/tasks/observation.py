"""The layout of a flat observation: which named field stands where, and the space that follows from it."""

import dataclasses
import functools
from typing import Any, Generic, NamedTuple, TypeVar

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.envs.tasks.specs import TaskSpec

Fields = TypeVar("Fields", bound=tuple[Any, ...])


class Field(NamedTuple):
    """One named field of an observation."""

    name: str
    shape: tuple[int, ...]
    low: float | ArrayLike
    high: float | ArrayLike

    @property
    def size(self) -> int:
        """Returns how many numbers the field takes in the flat observation."""
        return int(np.prod(self.shape, dtype=int))


@dataclasses.dataclass(frozen=True)
class Layout(Generic[Fields]):
    """The fields of an observation in their order, and the NamedTuple that they unpack into."""

    kind: type[Fields]
    fields: tuple[Field, ...]
    task: TaskSpec | None = None  # that they belong to; None: no task

    @functools.cached_property
    def size(self) -> int:
        """Returns the length of the flat observation."""
        return sum(field.size for field in self.fields)

    @functools.cached_property
    def _places(self) -> tuple[tuple[slice, tuple[int, ...]], ...]:
        """Returns where each field stands, and its shape: to work it out took longer than most laws."""
        ends = np.cumsum([field.size for field in self.fields]).tolist()
        return tuple((slice(end - field.size, end), field.shape) for field, end in zip(self.fields, ends, strict=True))

    @property
    def space(self) -> gymnasium.spaces.Box:
        """Returns the float32 Box of the flat observation."""
        low = np.concatenate([np.broadcast_to(f.low, f.shape).ravel() for f in self.fields])
        high = np.concatenate([np.broadcast_to(f.high, f.shape).ravel() for f in self.fields])
        return gymnasium.spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)

    def unpack(self, observation: NDArray[Any]) -> Fields:
        """Returns the named fields, views of shape (..., *field.shape) into observations of shape (..., size).

        Raises:
            ValueError: if the last axis is not `size` long.
        """
        if observation.shape[-1] != self.size:
            raise ValueError(f"an observation of {self.kind.__name__} has {self.size} numbers, got {observation.shape}")
        batch = observation.shape[:-1]
        return self.kind(*[observation[..., place].reshape(batch + shape) for place, shape in self._places])

    def pack(self, fields: Fields) -> NDArray[np.float32]:
        """Returns the flat observation (..., size) of named fields; the inverse of `unpack`."""
        pieces = []
        for field, value in zip(self.fields, fields, strict=True):
            array = np.asarray(value, dtype=np.float32)
            batch = array.shape[: array.ndim - len(field.shape)]
            pieces.append(array.reshape((*batch, field.size)))
        return np.concatenate(pieces, axis=-1)
