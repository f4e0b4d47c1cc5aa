"""What the controllers of Nav2 are given: a costmap that moves with the robot, and the part of a plan that lies in it.

The map is that of `scan_map`, drawn of the robot's own scans; what was not seen is free. The plan is that of
`ScanPlanner`, made anew every `replan` seconds, and at once where the goal changes.

Source: costs as `nav2_costmap_2d` documents them for its inflation layer; the plan's period as that of Nav2's default
behaviour tree.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ScanLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.polyline_tracker import (
    FARTHEST,
    PLAN,
    UNIT,
    clearance_at,
    point_at,
    project,
)
from wayfield.policies.parts.scan_map import CHART, forget, stamps
from wayfield.policies.parts.stopping import SECTORS, SIGHTS, Scan, Seen, find_hits, free_time, remembering
from wayfield.policies.scans.scan_planner import enter, plan, search, search_prices
from wayfield.system.compiled import allocating, compiled, inlined

LETHAL = 254.0  # cost of a cell with an obstacle in it
INSCRIBED = 253.0  # of one in which the centre of a round hull may not be
POINT_SPACING = 0.025  # m, between the points of a plan, for which Nav2's offsets along it are documented
MOST_POINTS = 161  # of the part of a plan that lies ahead
FARTHEST_PRUNED = POINT_SPACING * (MOST_POINTS - 1)  # m

STATE = [
    *PLAN,
    ("forgotten", np.int64),  # how often the map was
    ("anchor", np.float64, (2,)),  # m, from where the robot has to get on
    ("anchored", np.int64),  # step at which it was there
    ("recoveries", np.int64),  # begun so far
    ("recovering", np.int64),  # which is under way, a number of RECOVERIES; 0: none
    ("recovering_until", np.int64),  # step
    *SIGHTS,
    *CHART,
]

# What a robot does in turn that does not get on, as Nav2's default behaviour tree: it forgets its map, turns on the
# spot, waits, backs away.
RECOVERIES = CLEAR, SPIN, WAIT, BACK_UP = 1, 2, 3, 4
FAILED = 0.3  # s, without a command that is safe
PROGRESS, PROGRESS_TIME = 0.5, 10.0  # m, that a robot has to move in so many s
SPIN_TURN, SPIN_RATE = 1.57, 1.0  # rad, rad/s
WAIT_TIME = 5.0  # s
BACK_UP_WAY, BACK_UP_SPEED = 0.3, 0.15  # m, m/s
ARRIVED = 0.25  # m, from the goal, within which a robot need not get on

# As the scan planner plans: room beside the hull that is wanted, least, and where there is no other way, m.
WANTED, LEAST, GIVE = 0.2, 0.02, 0.03
WEIGHT = 3.0  # of what lacks of the wanted room, in the price of a metre


class Maps(NamedTuple):
    """Tables that a costmap is kept and read by."""

    prices: NDArray[np.float64]  # (3, 256) of a metre at each level of the grid, see `scan_planner.plan`
    table: NDArray[np.uint8]  # of `scan_map.stamps`
    costs: NDArray[np.float64]  # (256,) of a cell at each level of the grid, see `inflated`


@dataclasses.dataclass(frozen=True)
class CostmapController(ScanLaw):
    """A controller of Nav2: gains that they share, what they see and remember. Each adds its law, in `decide`."""

    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    max_yaw_rate: float = gain(1.9, "rad/s", "at most", above=0.0)
    acceleration: float = gain(3.0, "m/s^2", "at most, and at most what the base can do", above=0.0)
    yaw_acceleration: float = gain(3.5, "rad/s^2", "likewise", above=0.0)
    prune_distance: float = gain(2.0, "m", "of the plan that is looked at", above=0.0, most=FARTHEST_PRUNED)
    cell: float = gain(0.08, "m", "of the map", above=0.0)
    inflation_radius: float = gain(0.7, "m", "around obstacles, in which cells cost", least=0.0, most=FARTHEST)
    cost_scaling: float = gain(3.0, "1/m", "by which that falls off", least=0.0)
    replan: float = gain(1.0, "s", "between plans", above=0.0)
    time_before_collision: float = gain(1.2, "s", "from which on commands are slowed down; 0 for not at all", least=0.0)
    recall: float = gain(2.0, "s", "for which that knows what is near and out of sight", least=0.0)

    @property
    def remembers(self) -> list[Any]:
        """Returns the fields that the law remembers beside the map and the plan, as of a record."""
        raise NotImplementedError

    def decide(self, p: NDArray[np.void], maps: Maps, scan: Scan, seen: Seen, state: NDArray[np.void]) -> None:
        """Sets the commands of all robots in their states (b,); p: what the law reads, see `params.params`."""
        raise NotImplementedError

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty map and no plan for each robot, (b,): a record of STATE and `remembers`, and the scans.

        Raises:
            ValueError: if there are no beams.
        """
        return remembering(self, briefing, [*STATE, *self.remembers])

    def act_on(
        self, scan: Scan, observation: goal_reaching.Observation, briefing: Briefing, state: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t) in m/s and rad/s."""
        self.decide(self.given(briefing), self.maps(briefing), scan, Seen.of(observation, briefing), state)
        return np.asarray(state["command"][:, list(briefing.robot.twist_axes)])

    def maps(self, briefing: Briefing) -> Maps:
        """Returns the tables for a robot."""
        radius = briefing.robot.hull_radius
        prices = search_prices(radius, LEAST, GIVE, WANTED, WEIGHT)
        reach = max(self.inflation_radius, radius + WANTED) + 1.5 * self.cell
        costs = inflated(radius, self.inflation_radius, self.cost_scaling)
        return Maps(prices, stamps(self.cell, reach), costs)

    def given(self, briefing: Briefing) -> NDArray[np.void]:
        """Returns what the law reads, see `params.params`."""
        return params(
            self,
            briefing,
            **search(self.cell),
            wanted_clearance=WANTED,
            margin=LEAST,
            replan_steps=max(round(self.replan / briefing.dt), 1),
            acceleration=min(self.acceleration, briefing.actuators.acceleration),
            yaw_acceleration=min(self.yaw_acceleration, briefing.actuators.yaw_acceleration),
        )


def inflated(radius: float, inflation_radius: float, scaling: float) -> NDArray[np.float64]:
    """Returns the costs (256,) of cells by the levels of a grid.

    With d the distance of a cell from the nearest obstacle and r the radius of the hull,

        LETHAL at d = 0, INSCRIBED up to r, floor(252 exp(-scaling (d - r))) up to the inflation radius, 0 beyond.
    """
    distance = FARTHEST - UNIT * np.arange(256)
    cost = np.floor((INSCRIBED - 1.0) * np.exp(-scaling * np.maximum(distance - radius, 0.0)))
    cost = np.where(distance <= inflation_radius + 1e-9, cost, 0.0)
    cost = np.where(distance <= radius + 1e-9, INSCRIBED, cost)
    return np.where(distance <= 1e-9, LETHAL, cost)


@inlined
def cost_at(m, costs, x, y):
    """Returns the cost at a point, by the clearance between those of the four cells around it; 0 beyond the map."""
    clearance = clearance_at(m, x, y)
    return costs[int((FARTHEST - clearance) / UNIT + 0.5)]


@compiled
def perceive(p, m, maps, scan, seen, i):
    """Enters robot i's scan into its map, plans where it is due, and returns (pose, goal, s): s (m) along the plan.

    The goal is x, y (m) and heading (rad) in the frame of the pose.
    """
    pose, goal, inside = enter(p, m, maps.table, scan, seen, i)
    x, y, heading = pose
    inside_x, inside_y = inside
    waited = m.steps - m.planned_at
    moved = m.plans > 0 and abs(m.target[0] - inside_x) + abs(m.target[1] - inside_y) > 0.5 * p.cell
    # a goal that moves with a grid that is out of its reach is no reason to plan in every step
    jumped = moved and inside == goal
    if m.plans == 0 or waited >= p.replan_steps or jumped:
        plan(p, m, maps.prices, maps.table, scan, i, pose, inside_x, inside_y)
    s = 0.0
    if m.num_points > 0:
        s, _, _ = project(m, x, y)
    m.steps += 1
    return pose, (goal[0], goal[1], heading + seen.heading_errors[i]), s


@compiled
def ahead_of(m, s, reach, half, x, y, points):
    """Writes the points of the plan from arc length s (m) on, `reach` (m) far, and returns how many there are.

    Args:
        half: m, half the side of the square around (x, y) that the plan may not leave; the first point counts anyhow.
        points: (MOST_POINTS, 2) m, POINT_SPACING apart, the last one at the end of the plan where that is reached.
    """
    if m.num_points == 0:
        return 0
    end = min(m.arc[m.num_points - 1], s + reach)
    count = 0
    at = s
    while count < points.shape[0]:
        px, py = point_at(m, m.segment, at)
        if count > 0 and max(abs(px - x), abs(py - y)) > half:
            break
        points[count, 0] = px
        points[count, 1] = py
        count += 1
        if at >= end:
            break
        at = min(at + POINT_SPACING, end)
    return count


@allocating
def slow_down(p, m, scan, seen, i):
    """Slows robot i's command where it leads into what the beams hit: by the time until then over the one wanted.

    The approach mode of Nav2's collision monitor, for the hull's disc and a single hit, which also counts for `recall`
    after it was seen. It is called in every step, so that what is near is kept.
    """
    reach = p.time_before_collision * p.max_speed + p.plant.hull_radius
    hits = np.empty((scan.directions.shape[0] + SECTORS, 3))
    count = find_hits(p, scan, seen, m, i, reach, p.plant.hull_radius, hits, 0.0)
    if p.time_before_collision > 0.0:
        left = free_time(hits[:count], m.command[0], m.command[1], m.command[2], p.time_before_collision)
        for c in range(3):
            m.command[c] *= left / p.time_before_collision


@compiled
def recovers(p, m, pose, goal):
    """Begins and goes on with what helps a robot that does not get on; returns whether the command is that of it."""
    dt = p.plant.dt
    away = math.sqrt((pose[0] - m.anchor[0]) ** 2 + (pose[1] - m.anchor[1]) ** 2)
    left = math.sqrt((pose[0] - goal[0]) ** 2 + (pose[1] - goal[1]) ** 2)
    if m.anchored == 0 or away > PROGRESS or left < ARRIVED:
        m.anchor[0] = pose[0]
        m.anchor[1] = pose[1]
        m.anchored = m.steps
    held = m.stuck * dt >= FAILED or (m.steps - m.anchored) * dt > PROGRESS_TIME
    if m.recovering == 0 and held:
        m.recovering = RECOVERIES[m.recoveries % 4]
        m.recoveries += 1
        m.stuck = 0
        m.anchored = m.steps
        lasts = 0.0
        if m.recovering == CLEAR:
            m.forgotten += 1
            forget(m)
            m.planned_at = m.steps - p.replan_steps
        elif m.recovering == SPIN:
            lasts = SPIN_TURN / SPIN_RATE
        elif m.recovering == WAIT:
            lasts = WAIT_TIME
        else:
            lasts = BACK_UP_WAY / BACK_UP_SPEED
        m.recovering_until = m.steps + int(lasts / dt + 0.5)
    if m.recovering == 0:
        return False
    if m.steps >= m.recovering_until:
        m.recovering = 0
        m.anchored = m.steps
        return False
    m.command[0] = -BACK_UP_SPEED if m.recovering == BACK_UP else 0.0
    m.command[1] = 0.0
    m.command[2] = SPIN_RATE if m.recovering == SPIN else 0.0
    return True
