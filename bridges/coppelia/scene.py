"""The tree of a scene's objects, and the search for paths such as /PioneerP3DX/ultrasonicSensor[3]."""

import dataclasses
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from wayfield.bridges.coppelia import frames
from wayfield.bridges.coppelia.constants import DUMMY, JOINT, PROXIMITY_SENSOR, SHAPE, VISION_SENSOR
from wayfield.bridges.coppelia.frames import ORIGIN, Pose

MAX_OBJECTS = 4096
MAX_LEVELS = 64  # of the tree
MAX_ALIAS = 128  # characters
MAX_PATH = 1024  # characters
_MAX_INDEX = MAX_OBJECTS  # of a match

KINDS = {
    SHAPE: "shape",
    JOINT: "joint",
    DUMMY: "dummy",
    PROXIMITY_SENSOR: "proximity sensor",
    VISION_SENSOR: "vision sensor",
}

# Names of the robot and its parts in older scripts and documents.
_OLD_MODELS = ("Pioneer3DX", "Pioneer_p3dx")
# Other names of the lidar's halves in scripts.
_OTHER_NAMES = {
    f"{kind}{side}": f"fastHokuyo_sensor{side}" for kind in ("sensor", "SICK_TiM310_sensor") for side in "12"
}
_OLD_SENSOR = re.compile(r"Pioneer_p3dx_ultrasonicSensor(\d{1,2})")


@dataclasses.dataclass(eq=False)
class Footprint:
    """The footprint of a shape: an obstacle to the hull and to sonars."""

    record: np.void  # OBSTACLE
    index: int = -1  # in the world's array of obstacles; -1: none


@dataclasses.dataclass(eq=False)
class Sonar:
    """A proximity sensor: its place in the robot's base frame."""

    x: float  # m
    y: float  # m
    bearing: float  # rad


@dataclasses.dataclass(eq=False)
class Object:
    """A node of the tree."""

    handle: int
    alias: str
    kind: int  # sceneobject_...
    parent: "Object | None" = None
    pose: Pose = ORIGIN  # relative to the parent; the child of a joint moves with it
    children: list["Object"] = dataclasses.field(default_factory=list)
    part: bool = False  # of the robot's model: fixed to it
    wheel: int = -1  # index of a joint among the robot's wheels
    primitive: tuple[int, tuple[float, float, float]] | None = None  # kind and sizes (m) of a shape
    footprint: Footprint | None = None
    sonar: Sonar | None = None
    scans: int = -1  # half of the lidar's beams, 0 right and 1 left, of a vision sensor
    size: float = 0.0  # m, of a dummy
    colour: tuple[float, float, float] | None = None
    created: bool = False  # while the simulation ran
    data: dict[str, Any] = dataclasses.field(default_factory=dict)

    def ancestors(self) -> Iterator["Object"]:
        """Yields the parent, its parent, and so on."""
        node = self.parent
        while node is not None:
            yield node
            node = node.parent

    def tree(self) -> Iterator["Object"]:
        """Yields the object and all below it, parents before children."""
        yield self
        for child in self.children:
            yield from child.tree()


class Scene:
    """The objects of a world by handle and as a tree.

    Handles are never reused. `placed` returns the poses of the base and of obstacles, which the plant moves.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.objects: dict[int, Object] = {}
        self.roots: list[Object] = []
        self.base: Object | None = None
        self.placed: Callable[[Object], Pose | None] = lambda _: None
        self.turned: Callable[[Object], float] = lambda _: 0.0  # angle of a joint, rad
        self._next = 16

    def add(self, alias: str, kind: int, parent: Object | None = None, pose: Pose = ORIGIN, **settings: Any) -> Object:
        """Returns a new object, the last child of its parent.

        Raises:
            ValueError: if the scene is full.
        """
        if len(self.objects) >= MAX_OBJECTS:
            raise ValueError(f"the scene has {MAX_OBJECTS} objects, which is the most")
        new = Object(self._next, alias, kind, parent, pose, **settings)
        self._next += 1
        self.objects[new.handle] = new
        self.siblings(new).append(new)
        return new

    def siblings(self, node: Object) -> list[Object]:
        """Returns the list that contains the object."""
        return self.roots if node.parent is None else node.parent.children

    def remove(self, node: Object) -> None:
        """Removes an object; its children keep their poses in the world and move up to its parent."""
        for child in list(node.children):
            self.attach(child, node.parent, keep=True)
        self.siblings(node).remove(node)
        del self.objects[node.handle]

    def attach(self, node: Object, parent: Object | None, keep: bool) -> None:
        """Makes an object the last child of a parent; `keep` keeps its pose in the world, else its relative pose."""
        pose = self.pose(node)
        self.siblings(node).remove(node)
        node.parent = parent
        self.siblings(node).append(node)
        if keep:
            node.pose = frames.composed(frames.inverse(self.frame(parent)), pose)

    def pose(self, node: Object) -> Pose:
        """Returns the pose of an object in the world; of a joint, that of its fixed frame."""
        placed = self.placed(node)
        if placed is not None:
            return placed
        if node.parent is None:
            return node.pose
        return frames.composed(self.frame(node.parent), node.pose)

    def frame(self, node: Object | None) -> Pose:
        """Returns the parent frame of an object's children, in the world; None is the world."""
        if node is None:
            return ORIGIN
        pose = self.pose(node)
        if node.kind != JOINT:
            return pose
        return frames.composed(pose, frames.yawed(0.0, 0.0, 0.0, self.turned(node)))

    def find(self, path: str, index: int = 0) -> Object | None:
        """Returns the object at a path, the `index`-th match, or None; intermediate levels may be omitted.

        A component is an alias with the wildcards * and ?; `name[i]` is the i-th match among siblings, `name{i}` the
        i-th in the whole search.

        Raises:
            ValueError: if the path is ill formatted.
        """
        if not path or path[0] not in "/.:" or len(path) > MAX_PATH:
            raise ValueError("ill formatted")
        components: list[tuple[str, int | None]] = []
        for text in path.lstrip("/.:").split("/"):
            match = re.fullmatch(r"([^\[\]{}]+)(?:\[(\d{1,6})\]|\{(\d{1,6})\})?", text)
            if match is None:
                raise ValueError("ill formatted")
            name, sibling, nth = match.groups()
            if nth is not None:
                index = int(nth)
            components.append((name, None if sibling is None else int(sibling)))
        if self.base is not None and components[0][0] in _OLD_MODELS:
            components[0] = (self.base.alias, components[0][1])
        if index > _MAX_INDEX:
            return None
        for result in self._matches(self.roots, components, 0, set()):
            if index == 0:
                return result
            index -= 1
        last, wanted = components[-1]
        if last in _OTHER_NAMES:
            components[-1] = _OTHER_NAMES[last], wanted
            return next(self._matches(self.roots, components, 0, set()), None)
        return None

    def find_old(self, name: str) -> Object | None:
        """Returns the object of a name from before CoppeliaSim 4.2, or None."""
        if self.base is None:
            return None
        if name in _OLD_MODELS:
            return self.base
        if name.removeprefix("Pioneer_p3dx_") in ("leftMotor", "rightMotor"):
            return self.find(f"/{self.base.alias}/{name.removeprefix('Pioneer_p3dx_')}")
        match = _OLD_SENSOR.fullmatch(name)
        if match is not None:
            return self.find(f"/{self.base.alias}/ultrasonicSensor", int(match[1]) - 1) if int(match[1]) > 0 else None
        # any other alias was a name of its own, with #0 for a copy
        plain = name.partition("#")[0]
        return self.find(f"/{plain}") if re.fullmatch(r"[\w .-]+", plain) else None

    def is_old(self, path: str) -> bool:
        """Returns whether a path or a name belongs to older scripts."""
        return path.lstrip("/.:").split("/")[0].startswith(_OLD_MODELS)

    def _matches(
        self, nodes: list[Object], components: list[tuple[str, int | None]], first: int, barren: set[tuple[int, int]]
    ) -> Iterator[Object]:
        """Yields the matches of the components from `first` on, below a list of siblings.

        `barren` holds the searches without a match: without it a deep tree of equal names takes exponential time.
        """
        name, wanted = components[first]
        count = 0
        for node in nodes:
            if not wild_match(name, node.alias):
                continue
            if wanted is None or count == wanted:
                if first + 1 == len(components):
                    yield node
                else:
                    yield from self._below(node, components, first + 1, barren)
            count += 1
        for node in nodes:
            if wanted is None or not wild_match(name, node.alias):
                yield from self._below(node, components, first, barren)

    def _below(
        self, node: Object, components: list[tuple[str, int | None]], first: int, barren: set[tuple[int, int]]
    ) -> Iterator[Object]:
        if not node.children or (node.handle, first) in barren:
            return
        some = False
        for match in self._matches(node.children, components, first, barren):
            some = True
            yield match
        if not some:
            barren.add((node.handle, first))

    def indexed(self, node: Object) -> str:
        """Returns alias[i], i the index among siblings of the same alias."""
        alike = [each for each in self.siblings(node) if each.alias == node.alias]
        return f"{node.alias}[{alike.index(node)}]"

    def full_path(self, node: Object) -> str:
        """Returns the path with every level, and [i] where siblings share an alias."""
        steps = []
        for each in (node, *node.ancestors()):
            alike = sum(other.alias == each.alias for other in self.siblings(each))
            steps.append(self.indexed(each) if alike > 1 else each.alias)
        return "/" + "/".join(reversed(steps))

    def short_path(self, node: Object) -> str:
        """Returns the path through the topmost object alone where it is unique, else the full path."""
        top = [node, *node.ancestors()][-1]
        head = "" if top is node else self.full_path(top)
        for path in (f"{head}/{node.alias}", f"{head}/{self.indexed(node)}"):
            if self.find(path) is node:
                return path
        return self.full_path(node)


def wild_match(pattern: str, name: str) -> bool:
    """Returns whether a name matches a pattern: * is any text, ? any character. Quadratic time at most."""
    p = n = 0
    star, resume = -1, 0
    while n < len(name):
        if p < len(pattern) and pattern[p] == "*":
            star, resume = p, n
            p += 1
        elif p < len(pattern) and pattern[p] in (name[n], "?"):
            p += 1
            n += 1
        elif star >= 0:
            p, resume = star + 1, resume + 1
            n = resume
        else:
            return False
    return all(c == "*" for c in pattern[p:])
