"""The tree of a scene's objects, and how a path such as /PioneerP3DX/ultrasonicSensor[3] finds one of them."""

import dataclasses
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from wayfield.envs.coppelia import frames
from wayfield.envs.coppelia.constants import DUMMY, JOINT, PROXIMITY_SENSOR, SHAPE
from wayfield.envs.coppelia.frames import ORIGIN, Pose

MAX_OBJECTS = 4096
MAX_LEVELS = 64  # of the tree
MAX_ALIAS = 128  # characters
MAX_PATH = 1024  # characters
_MAX_INDEX = MAX_OBJECTS  # of a match

KINDS = {SHAPE: "shape", JOINT: "joint", DUMMY: "dummy", PROXIMITY_SENSOR: "proximity sensor"}

# What older scripts and documents call the robot and its parts.
_OLD_MODELS = ("Pioneer3DX", "Pioneer_p3dx")
_OLD_SENSOR = re.compile(r"Pioneer_p3dx_ultrasonicSensor(\d{1,2})")


@dataclasses.dataclass(eq=False)
class Footprint:
    """What a shape takes of the floor: an obstacle to the hull and to sonars."""

    record: np.void  # OBSTACLE
    patrol: np.void | None = None  # PATROL, of one that moves by a script
    index: int = -1  # in the world's array of obstacles; -1 while it is not there


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
    pose: Pose = ORIGIN  # in the frame of the parent; of a joint: in the frame that moves with it
    children: list["Object"] = dataclasses.field(default_factory=list)
    part: bool = False  # of the robot's model: fixed to it
    wheel: int = -1  # index of a joint among the robot's wheels
    primitive: tuple[int, tuple[float, float, float]] | None = None  # kind and sizes (m) of a shape
    footprint: Footprint | None = None
    sonar: Sonar | None = None
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

    Handles are never used twice. `base` is the robot's; its pose is where `placed` says that the robot is.
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
            ValueError: if there are too many.
        """
        if len(self.objects) >= MAX_OBJECTS:
            raise ValueError(f"the scene has {MAX_OBJECTS} objects, which is the most")
        new = Object(self._next, alias, kind, parent, pose, **settings)
        self._next += 1
        self.objects[new.handle] = new
        self.siblings(new).append(new)
        return new

    def siblings(self, node: Object) -> list[Object]:
        """Returns the list that the object stands in."""
        return self.roots if node.parent is None else node.parent.children

    def remove(self, node: Object) -> None:
        """Takes an object out; its children stay where they are, as children of its parent."""
        for child in list(node.children):
            self.attach(child, node.parent, keep=True)
        self.siblings(node).remove(node)
        del self.objects[node.handle]

    def attach(self, node: Object, parent: Object | None, keep: bool) -> None:
        """Makes an object the last child of another, or of the world; where it is stays, or else its relative pose."""
        pose = self.pose(node)
        self.siblings(node).remove(node)
        node.parent = parent
        self.siblings(node).append(node)
        if keep:
            node.pose = frames.composed(frames.inverse(self.frame(parent)), pose)

    def pose(self, node: Object) -> Pose:
        """Returns an object's pose in the world; of a joint: of the frame that does not move with it."""
        placed = self.placed(node)
        if placed is not None:
            return placed
        if node.parent is None:
            return node.pose
        return frames.composed(self.frame(node.parent), node.pose)

    def frame(self, node: Object | None) -> Pose:
        """Returns the frame in the world that an object's children stand in; None is the world."""
        if node is None:
            return ORIGIN
        pose = self.pose(node)
        if node.kind != JOINT:
            return pose
        return frames.composed(pose, frames.yawed(0.0, 0.0, 0.0, self.turned(node)))

    def find(self, path: str, index: int = 0) -> Object | None:
        """Returns the object of a path, or None: the `index`-th that matches, intermediate levels may be left out.

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
        for found in self._matches(self.roots, components, 0, set()):
            if index == 0:
                return found
            index -= 1
        return None

    def find_old(self, name: str) -> Object | None:
        """Returns the object that a name of CoppeliaSim before 4.2 means, or None."""
        if self.base is None:
            return None
        if name in _OLD_MODELS:
            return self.base
        if name.removeprefix("Pioneer_p3dx_") in ("leftMotor", "rightMotor"):
            return self.find(f"/{self.base.alias}/{name.removeprefix('Pioneer_p3dx_')}")
        match = _OLD_SENSOR.fullmatch(name)
        if match is not None:
            return self.find(f"/{self.base.alias}/ultrasonicSensor", int(match[1]) - 1) if int(match[1]) > 0 else None
        return None

    def is_old(self, path: str) -> bool:
        """Returns whether a path or a name is one that only older scripts use."""
        return path.lstrip("/.:").split("/")[0].startswith(_OLD_MODELS)

    def _matches(
        self, nodes: list[Object], components: list[tuple[str, int | None]], first: int, barren: set[tuple[int, int]]
    ) -> Iterator[Object]:
        """Yields all below a list of siblings that the components from the first on lead to.

        `barren` keeps the searches known to lead nowhere: without it a deep tree of like names takes for ever.
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
        for found in self._matches(node.children, components, first, barren):
            some = True
            yield found
        if not some:
            barren.add((node.handle, first))

    def indexed(self, node: Object) -> str:
        """Returns alias[i], i the object's place among siblings of its alias."""
        alike = [each for each in self.siblings(node) if each.alias == node.alias]
        return f"{node.alias}[{alike.index(node)}]"

    def full_path(self, node: Object) -> str:
        """Returns the path through every level, with [i] where siblings share an alias."""
        steps = []
        for each in (node, *node.ancestors()):
            alike = sum(other.alias == each.alias for other in self.siblings(each))
            steps.append(self.indexed(each) if alike > 1 else each.alias)
        return "/" + "/".join(reversed(steps))

    def short_path(self, node: Object) -> str:
        """Returns the path by way of the topmost object alone, if that is the object's, else the full one."""
        top = [node, *node.ancestors()][-1]
        head = "" if top is node else self.full_path(top)
        for path in (f"{head}/{node.alias}", f"{head}/{self.indexed(node)}"):
            if self.find(path) is node:
                return path
        return self.full_path(node)


def wild_match(pattern: str, name: str) -> bool:
    """Returns whether a name matches a pattern in which * is any text and ? any character.

    One pass with one way back: no pattern takes long.
    """
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
