"""The named goal-reaching scenarios: the runs of documents B and C, two for contact, and random families."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from wayfield.envs.scenarios.cellular import cellular
from wayfield.envs.scenarios.fields import discs, mixed, open_field
from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field, wall
from wayfield.envs.scenarios.scenario import GoalScenario

_BOX_SIDE = 0.2  # m; document C draws boxes but prints only where they are

# Document B, experiment 2: the positions are not printed. In and around the bends, at least 0.45 m from the
# legs even where a switching radius of 0.35 m cuts the corners, so that a robot of 0.3 m can drive the course
# as it stands.
_COURSE_OBSTACLES = obstacle_field(
    circle(0.6, 1.9, 0.3),
    circle(2.4, 1.0, 0.3),
    box(3.9, 2.4, 0.6, 0.4, heading=math.radians(-53.0)),
    box(4.4, 1.6, 0.5, 0.4, heading=math.radians(20.0)),
    circle(5.2, -0.2, 0.4),
    circle(6.1, 2.1, 0.4),
    box(7.5, 0.9, 0.5, 0.3, heading=math.radians(27.0)),
)


def _one(name: str, **settings: Any) -> Callable[[float], tuple[GoalScenario, ...]]:
    """Returns the factory of a bank with a single scenario, the same for every hull."""

    def bank(hull_radius: float) -> tuple[GoalScenario, ...]:
        del hull_radius
        return (GoalScenario(name, **settings),)

    return bank


def _potential_field_run(
    name: str, goal: tuple[float, float], *obstacles: tuple[float, float]
) -> Callable[[float], tuple[GoalScenario, ...]]:
    """Returns the factory of a run of document C: from the origin to a goal with heading 0, past small
    boxes."""
    boxes = obstacle_field(*(box(x, y, _BOX_SIDE, _BOX_SIDE) for x, y in obstacles))
    return _one(name, goal=(*goal, 0.0), obstacles=boxes, position_tolerance=0.02)


GOAL_SCENARIOS: Mapping[str, Callable[[float], tuple[GoalScenario, ...]]] = {
    # Document B, experiment 1: (0, 0, 0) to (3, 4, 45 degrees), nothing in the way.
    "omni3_goal": _one(
        "omni3_goal", goal=(3.0, 4.0, math.radians(45.0)), position_tolerance=0.02, heading_tolerance=0.02
    ),
    # Document B, experiment 2: three waypoints to (8, 2, 180 degrees), around obstacles beside the course.
    "omni3_waypoints": _one(
        "omni3_waypoints",
        goal=(8.0, 2.0, math.pi),
        waypoints=((2.5, 2.5), (4.0, 0.5), (6.0, 1.0)),
        obstacles=_COURSE_OBSTACLES,
        position_tolerance=0.02,
        heading_tolerance=0.02,
        waypoint_radius=0.5,  # wider than either switching radius of the document: the controller decides
    ),
    # Document C, scenario 0: a box on the straight line to a goal 4.2 m away.
    "apf_0": _potential_field_run("apf_0", (3.0, 3.0), (2.0, 2.0)),
    # Document C, scenario 1: a box halfway to a goal 2.2 m away.
    "apf_1": _potential_field_run("apf_1", (2.0, 1.0), (1.0, 0.5)),
    # Document C, scenario 2: two boxes in a row on the line to a goal 2.1 m away.
    "apf_2": _potential_field_run("apf_2", (1.5, 1.5), (0.5, 0.5), (1.0, 1.0)),
    # A box of 2 kg on the straight way, light enough to be pushed where the dynamics let it move.
    "push_box": _one("push_box", goal=(4.0, 0.0, 0.0), obstacles=obstacle_field(box(2.0, 0.0, 0.4, 0.4, mass=2.0))),
    # A wall across the straight way: a robot that heads for the goal stays in contact with it.
    "held_by_wall": _one("held_by_wall", goal=(3.0, 0.0, 0.0), obstacles=obstacle_field(wall(1.5, -1.5, 1.5, 1.5))),
    # 64 random pairs of start and goal, 3 to 6 m apart, no obstacles.
    "open_field": open_field,
    # 64 random fields of 12 circles in a walled square of 10 m.
    "discs": discs,
    # 64 random fields of circles, boxes and interior walls in a walled square of 10 m.
    "mixed": mixed,
    # 32 random worlds of the BARN challenge's kind: cylinders in a walled lane of 4.5 m, a goal 10 m ahead.
    "cellular": cellular,
}
