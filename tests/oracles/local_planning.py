"""What planners of scans are shown, and the free time of their arcs."""

import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.sensing import beam_angles
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.stopping import free_time
from wayfield.policies.pilot import Pilot
from wayfield.system.compiled import compiled

Array = NDArray[np.float64]
ID = {
    "p3dx": "wayfield/DiffDriveGoalObstacles-v0",
    "omni3": "wayfield/OmniGoalObstacles-v0",
    "omni4": "wayfield/OmniGoalObstacles-v0",
}
MAX_RANGE = 5.0
free = compiled(lambda hits, vx, vy, w, longest: free_time(hits, vx, vy, w, longest))


def briefing_of(
    robot: str, beams: int = 72, actuators: str = "lagged", field_of_view: float = 2.0 * math.pi, num_envs: int = 1
) -> Briefing:
    """Returns what a robot with a scan is told."""
    layout = Observation.layout(len(ROBOTS[robot].twist_axes), beams, MAX_RANGE)
    angles = beam_angles(beams, field_of_view)
    return Briefing(num_envs, ROBOTS[robot], ACTUATORS[actuators], 0.05, "twist", layout, angles, MAX_RANGE)


def scan(angles: Array, walls: list[tuple[float, float, float, float]]) -> Array:
    """Returns the ranges (1, beams) to walls from (x1, y1) to (x2, y2), seen from the origin."""
    ranges = np.full(len(angles), MAX_RANGE)
    for k, angle in enumerate(angles):
        u = np.array([math.cos(angle), math.sin(angle)])
        for x1, y1, x2, y2 in walls:
            matrix = np.array([[u[0], x1 - x2], [u[1], y1 - y2]])
            if abs(np.linalg.det(matrix)) > 1e-12:
                distance, share = np.linalg.solve(matrix, [x1, y1])
                if distance >= 0.0 and 0.0 <= share <= 1.0:
                    ranges[k] = min(ranges[k], distance)
    return ranges[None]


def observed(
    briefing: Briefing, ranges: Array, goal: tuple[float, float] = (4.0, 0.0), turn: float = 0.0, twist: Any = None
) -> Observation:
    """Returns the observation of a robot at the origin."""
    b = briefing.num_envs
    axes = len(briefing.robot.twist_axes)
    return Observation(
        pose=np.zeros((b, 3)),
        twist=np.zeros((b, axes)) if twist is None else np.atleast_2d(twist),
        goal=np.tile(goal, (b, 1)),
        goal_heading_error=np.full(b, turn),
        waypoints_left=np.zeros(b),
        ranges=np.tile(ranges, (b, 1)),
    )


def drive(
    planner: Any,
    scene: dict[str, Any],
    robot: str,
    folder: Path,
    steps: int,
    beams: int = 72,
    actuators: str = "lagged",
    **options: Any,
) -> tuple[Array, dict[str, Any]]:
    """Returns the poses (steps, 3) that the planner drives from the origin, and the last info."""
    file = folder / "scene.json"
    file.write_text(json.dumps({"start": [0, 0, 0], "heading_tolerance": math.pi, "position_tolerance": 0.2} | scene))
    env: Any = gymnasium.make(
        ID[robot], robot=robot, scenario=str(file), num_beams=beams, actuators=actuators, **options
    )
    seen, info = env.reset(seed=0)
    pilot = Pilot(planner, env)
    pilot.reset()
    poses = []
    for _ in range(steps):
        seen, _, terminated, _, info = env.step(pilot.act(seen))
        poses.append([env.unwrapped.batch.states[0][name] for name in ("x", "y", "heading")])
        if terminated:
            break
    return np.array(poses), info
