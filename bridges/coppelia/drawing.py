"""Drawing objects: points and lines of clients, shown in the window."""

import dataclasses
import math

from wayfield.bridges.coppelia.constants import DRAWING_CYCLIC, DRAWING_ITEMS, DRAWING_KIND

MAX_DRAWINGS = 1024
MAX_ITEMS = 100_000  # of one drawing object
MAX_NUMBERS = 4_000_000  # of all together
_DEFAULT_ITEMS = 1000


@dataclasses.dataclass(eq=False)
class Drawing:
    """A drawing object: items of one kind and colour."""

    kind: int
    size: float  # of points in pixels, of spheres and cubes in m
    tolerance: float  # m; an item nearer than this to another is not added
    parent: int  # handle of the object that it is attached to; -1: none
    most: int
    cyclic: bool
    colour: tuple[float, float, float]
    items: list[list[float]] = dataclasses.field(default_factory=list)

    @property
    def width(self) -> int:
        """Returns the number of coordinates of an item."""
        return DRAWING_ITEMS[self.kind]

    def add(self, item: list[float]) -> int:
        """Returns 1 where the item was added; 0 where the object is full, or another item is within the tolerance."""
        if self.tolerance > 0.0 and any(math.dist(item[:3], other[:3]) < self.tolerance for other in self.items):
            return 0
        if len(self.items) >= self.most:
            if not self.cyclic:
                return 0
            del self.items[0]
        self.items.append(item)
        return 1


class Drawings:
    """The drawing objects by handle. They are no objects of the scene and stay after a stop."""

    def __init__(self) -> None:
        self.drawings: dict[int, Drawing] = {}
        self._next = 1

    def add(
        self, kind: int, size: float, tolerance: float, parent: int, most: int, colour: tuple[float, float, float]
    ) -> int:
        """Returns the handle of a new drawing object.

        Raises:
            ValueError: if the kind is unknown, or a limit is exceeded.
        """
        if kind & DRAWING_KIND not in DRAWING_ITEMS:
            raise ValueError(f"drawing object type {kind & DRAWING_KIND} is unknown")
        most = most or _DEFAULT_ITEMS
        if not 0 < most <= MAX_ITEMS:
            raise ValueError(f"a drawing object has at most {MAX_ITEMS:,} items")
        if len(self.drawings) >= MAX_DRAWINGS:
            raise ValueError(f"there are {MAX_DRAWINGS} drawing objects, which is the most")
        handle = self._next
        self._next += 1
        self.drawings[handle] = Drawing(
            kind & DRAWING_KIND, size, tolerance, parent, most, bool(kind & DRAWING_CYCLIC), colour
        )
        return handle

    @property
    def full(self) -> bool:
        """Returns whether all drawing objects together are full."""
        return sum(len(each.items) * each.width for each in self.drawings.values()) >= MAX_NUMBERS
