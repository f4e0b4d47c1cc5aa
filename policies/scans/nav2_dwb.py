"""DWB as Nav2 configures it: sampled twists driven for 1.7 s in thought, judged by its critics on a costmap."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.stopping import Scan, Seen
from wayfield.policies.scans.costmap import (
    INSCRIBED,
    MOST_POINTS,
    CostmapController,
    Maps,
    ahead_of,
    cost_at,
    perceive,
    recovers,
    slow_down,
)
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

ILLEGAL = math.inf  # score of a trajectory that a critic forbids

TREND = [
    ("signs", np.float64, (3,)),  # of the last commands that were not zero, per component of the twist
    ("forbidden", np.float64, (3,)),  # sign that a component may not have until the robot has moved; 0: none
    ("flipped_at", np.float64, (3,)),  # pose at which a sign last flipped, m and rad
    ("near", np.int64),  # 1: the goal has been within the tolerance
    ("rotating", np.int64),  # 1: there, the robot has been slow enough to turn on the spot
]


@dataclasses.dataclass(frozen=True)
class Nav2Dwb(CostmapController):
    """Nav2's DWB controller with the gains and the critics of Nav2's own configuration, on the robot's own costmap.

    The twists are `speeds` forward speeds from 0 to max_speed times `turns` yaw rates within max_yaw_rate (for an omni
    base times `sideways` speeds to the side), and zero where a range has both signs, as far as the accelerations allow
    within `horizon`; all but standstill. Each is driven for `horizon`, in steps of at most `linear_step` or
    `angular_step`, and the one with the least score is commanded. With n_p and n_g the distances, in cells along both
    axes, of the trajectory's end from the nearest cell of the plan in the local costmap and from its last one there,
    n'_p and n'_g those of a point `forward_point` before the end, the latter from a last point moved on by as much,
    and c the cost at the end,

        score = obstacle c + local_cell/2 (path_distance n_p + goal_distance n_g + path_align n'_p + goal_align n'_g)
                + rotate_to_goal r

    path_align counts no more within `forward_point` of the goal. A trajectory with a point in collision is illegal,
    and one that leaves the local costmap, a square of side `window`. Within `tolerance` of the goal the robot may only
    slow down, r = slowing v^2 + the angle left at the end, and below `stopped_speed` only turn, r that angle. What
    flips the sign of a component of the twist (of the yaw rate only at 0.05 m/s or less) may not flip it back before
    the robot has moved 0.05 m or turned 0.2 rad. Where nothing is legal the robot stops. One that is stuck recovers
    (`costmap.recovers`), and commands pass the collision monitor (`costmap.slow_down`).

    Differences from Nav2: those of `Nav2Mppi`, and `tolerance`, which is 0.25 m there, too far for the tasks here.

    Source: nav2_dwb_controller's README, the parameters of nav2_bringup (Humble), and its critics' formulas; Fox,
    Burgard and Thrun, IEEE Robotics and Automation Magazine 4(1), 1997.
    """

    max_yaw_rate: float = gain(1.0, "rad/s", "at most", above=0.0)
    acceleration: float = gain(2.5, "m/s^2", "at most, and at most what the base can do", above=0.0)
    yaw_acceleration: float = gain(3.2, "rad/s^2", "likewise", above=0.0)
    speeds: int = gain(20, "1", "sampled", least=2, most=1000)
    sideways: int = gain(5, "1", "speeds aside, sampled", least=2, most=1000)
    turns: int = gain(20, "1", "yaw rates, sampled", least=2, most=1000)
    horizon: float = gain(1.7, "s", "sim_time, for which twists are driven", above=0.0)
    linear_step: float = gain(0.05, "m", "linear_granularity of that", above=0.0)
    angular_step: float = gain(0.025, "rad", "angular_granularity of that", above=0.0)
    window: float = gain(3.0, "m", "side of the local costmap", above=0.0)
    local_cell: float = gain(0.05, "m", "in which distances from the plan are counted", above=0.0)
    obstacle: float = gain(0.02, "1", "weight of BaseObstacle", least=0.0)
    path_distance: float = gain(32.0, "1", "weight of PathDist", least=0.0)
    goal_distance: float = gain(24.0, "1", "weight of GoalDist", least=0.0)
    path_align: float = gain(32.0, "1", "weight of PathAlign", least=0.0)
    goal_align: float = gain(24.0, "1", "weight of GoalAlign", least=0.0)
    forward_point: float = gain(0.1, "m", "of the nose that PathAlign and GoalAlign look at", least=0.0)
    rotate_to_goal: float = gain(32.0, "1", "weight of RotateToGoal", least=0.0)
    slowing: float = gain(5.0, "1", "slowing_factor of RotateToGoal", least=0.0)
    tolerance: float = gain(0.1, "m", "from the goal, within which it rotates", least=0.0)
    stopped_speed: float = gain(0.25, "m/s", "under which it counts as stopped", least=0.0)
    still_speed: float = gain(0.05, "m/s", "up to which flips of other components count", least=0.0)
    reset_distance: float = gain(0.05, "m", "driven, after which flips are forgotten", least=0.0)
    reset_angle: float = gain(0.2, "rad", "turned, after which flips are forgotten", least=0.0)

    @property
    def remembers(self) -> list[Any]:
        """Returns the fields of TREND."""
        return TREND

    def decide(self, p: NDArray[np.void], maps: Maps, scan: Scan, seen: Seen, state: NDArray[np.void]) -> None:
        """Sets the commands of all robots."""
        decide(p, maps, scan, seen, state)


@any_layout
@allocating
def decide(params, maps, scan, seen, memory):
    """Sets the commands of all robots."""
    p = params[0]
    points = np.empty((MOST_POINTS, 2))
    for i in range(memory.shape[0]):
        m = memory[i]
        pose, goal, s = perceive(p, m, maps, scan, seen, i)
        count = ahead_of(m, s, p.prune_distance, 0.5 * p.window, pose[0], pose[1], points)
        now = seen.twists[i, 0], seen.twists[i, 1], seen.twists[i, 2]
        distance = math.sqrt((goal[0] - pose[0]) ** 2 + (goal[1] - pose[1]) ** 2)
        if seen.waypoints_left[i] < 0.5:
            note_arrival(p, m, distance, math.sqrt(now[0] * now[0] + now[1] * now[1]))
        if recovers(p, m, pose, goal):
            pass
        elif count == 0:
            m.stuck += 1
            m.command[:] = 0.0
        else:
            cells = cells_of(p, points[:count])
            nose = nose_cell(p, m, points[:count], pose, goal)
            grids = cells, nose, goal, distance > p.forward_point
            wanted = best_twist(p, m, maps.costs, grids, pose, now)
            m.stuck = 0 if wanted[3] < ILLEGAL else m.stuck + 1
            m.command[0], m.command[1], m.command[2] = wanted[0], wanted[1], wanted[2]
            note_flips(p, m, pose)
        slow_down(p, m, scan, seen, i)


# What a robot may drive.


@inlined
def reachable(speed, acceleration, horizon, least, most):
    """Returns the least and the greatest speed within limits that are reached within the horizon (s)."""
    speed = min(max(speed, least), most)
    return max(speed - acceleration * horizon, least), min(speed + acceleration * horizon, most)


@allocating
def sampled(least, most, count):
    """Returns `count` speeds evenly from the least to the greatest, and 0 where that lies between two of them."""
    if most - least < 1e-5:
        return np.full(1, least)
    step = (most - least) / (count - 1)
    speeds = np.empty(count + 1)
    n = 0
    for k in range(count):
        speed = least + step * k
        if n > 0 and speeds[n - 1] < -1e-9 and speed > 1e-9:
            speeds[n] = 0.0
            n += 1
        speeds[n] = 0.0 if abs(speed) < 1e-9 else speed
        n += 1
    return speeds[:n]


@allocating
def best_twist(p, m, costs, grids, pose, now):
    """Returns (vx, vy, yaw rate, score) of the legal twist with the least score, the first of equal ones.

    Where none is legal that is standstill, and the score ILLEGAL.

    Args:
        grids: the plan's cells, the nose's cell, the goal, and whether the nose shall keep to the plan.
    """
    slow, fast = reachable(now[0], p.acceleration, p.horizon, 0.0, p.max_speed)
    right, left = reachable(now[2], p.yaw_acceleration, p.horizon, -p.max_yaw_rate, p.max_yaw_rate)
    lateral = p.max_speed if p.plant.holonomic else 0.0
    low, high = reachable(now[1], p.acceleration, p.horizon, -lateral, lateral)
    best = 0.0, 0.0, 0.0, ILLEGAL
    for vx in sampled(slow, fast, p.speeds):
        for vy in sampled(low, high, p.sideways):
            if vx * vx + vy * vy > p.max_speed * p.max_speed + 1e-5:
                continue
            for w in sampled(right, left, p.turns):
                if (vx == 0.0 and vy == 0.0 and w == 0.0) or oscillates(m, vx, vy, w):
                    continue
                score = scored(p, m, costs, grids, pose, now, (vx, vy, w))
                if score < best[3]:
                    best = vx, vy, w, score
    return best


@compiled
def scored(p, m, costs, grids, pose, now, twist):
    """Returns the score of a twist, or ILLEGAL."""
    cells, nose, goal, keeps = grids
    speed_squared = twist[0] * twist[0] + twist[1] * twist[1]
    if m.near == 1:
        slower = speed_squared < now[0] * now[0] + now[1] * now[1]
        if (m.rotating == 1 and speed_squared > 0.0) or (m.rotating == 0 and not slower):
            return ILLEGAL
    end, cost = driven(p, m, costs, pose, now, twist)
    if cost >= INSCRIBED:
        return ILLEGAL
    row, column = cell_of(p, end[0], end[1])
    sine, cosine = sin_cos(end[2])
    nose_row, nose_column = cell_of(p, end[0] + p.forward_point * cosine, end[1] + p.forward_point * sine)
    last = cells.shape[0] - 1
    total = p.path_distance * nearest(cells, row, column)
    total += p.goal_distance * (abs(cells[last, 0] - row) + abs(cells[last, 1] - column))
    if keeps:
        total += p.path_align * nearest(cells, nose_row, nose_column)
    total += p.goal_align * (abs(nose[0] - nose_row) + abs(nose[1] - nose_column))
    score = p.obstacle * cost + 0.5 * p.local_cell * total
    if m.near == 1:
        turn = abs(wrap_angle(goal[2] - end[2]))
        score += p.rotate_to_goal * (turn + (p.slowing * speed_squared if m.rotating == 0 else 0.0))
    return score


@compiled
def driven(p, m, costs, pose, now, twist):
    """Returns where a twist leads, (x, y, heading), and the cost there, or that of the first collision on the way.

    What leaves the local costmap counts as a collision.
    """
    vx, vy, w = twist
    x, y, heading = pose
    at_vx, at_vy, at_w = now
    far = math.sqrt(vx * vx + vy * vy) * p.horizon / p.linear_step
    steps = max(math.ceil(max(far, abs(w) * p.horizon / p.angular_step)), 1)
    dt = p.horizon / steps
    cost = cost_at(m, costs, x, y)
    for _ in range(steps):
        if cost >= INSCRIBED:
            break
        at_vx = towards(at_vx, vx, p.acceleration * dt)
        at_vy = towards(at_vy, vy, p.acceleration * dt)
        at_w = towards(at_w, w, p.yaw_acceleration * dt)
        sine, cosine = sin_cos(heading)
        x += (cosine * at_vx - sine * at_vy) * dt
        y += (sine * at_vx + cosine * at_vy) * dt
        heading += at_w * dt
        cost = cost_at(m, costs, x, y)
        if max(abs(x - pose[0]), abs(y - pose[1])) > 0.5 * p.window:
            cost = INSCRIBED
    return (x, y, heading), cost


@inlined
def towards(speed, wanted, change):
    """Returns the speed nearest to the wanted one that a change reaches."""
    return min(max(wanted, speed - change), speed + change)


# The plan, in cells.


@inlined
def cell_of(p, x, y):
    """Returns the row and the column of the local costmap's cell that a point lies in."""
    return math.floor(y / p.local_cell), math.floor(x / p.local_cell)


@allocating
def cells_of(p, points):
    """Returns the cells (n, 2), row and column, that points (k, 2) lie in, each once in a row."""
    cells = np.empty((points.shape[0], 2), np.int64)
    n = 0
    for k in range(points.shape[0]):
        row, column = cell_of(p, points[k, 0], points[k, 1])
        if n == 0 or cells[n - 1, 0] != row or cells[n - 1, 1] != column:
            cells[n, 0] = row
            cells[n, 1] = column
            n += 1
    return cells[:n]


@inlined
def nose_cell(p, m, points, pose, goal):
    """Returns the cell of the plan's last point in the local costmap, moved on from the robot towards the goal.

    Only the plan's own end is moved.
    """
    last = points.shape[0] - 1
    x = points[last, 0]
    y = points[last, 1]
    end = m.num_points - 1
    if abs(x - m.points[end, 0]) + abs(y - m.points[end, 1]) < 1e-6:
        sine, cosine = sin_cos(bearing(goal[1] - pose[1], goal[0] - pose[0]))
        x += p.forward_point * cosine
        y += p.forward_point * sine
    return cell_of(p, x, y)


@inlined
def nearest(cells, row, column):
    """Returns how many cells, along both axes, that of the plan lies away that is nearest as the crow flies."""
    least = np.inf
    steps = 0
    for k in range(cells.shape[0]):
        dr = cells[k, 0] - row
        dc = cells[k, 1] - column
        squared = dr * dr + dc * dc
        if squared < least:
            least = squared
            steps = abs(dr) + abs(dc)
    return steps


# What it remembers.


@inlined
def note_arrival(p, m, distance, speed):
    """Notes that the goal is within the tolerance, and then that the robot has slowed down; both stay noted."""
    if distance <= p.tolerance:
        m.near = 1
    if m.near == 1 and speed <= p.stopped_speed:
        m.rotating = 1


@inlined
def oscillates(m, vx, vy, w):
    """Returns whether a component of a twist has a sign that is forbidden."""
    return vx * m.forbidden[0] > 0.0 or vy * m.forbidden[1] > 0.0 or w * m.forbidden[2] > 0.0


@inlined
def note_flips(p, m, pose):
    """Notes which signs the command has flipped, and forgets them once the robot has moved."""
    flipped = False
    for c in range(3):
        if c > 0 and abs(m.command[0]) > p.still_speed:
            continue
        value = m.command[c]
        if value * m.signs[c] < 0.0:
            m.forbidden[c] = m.signs[c]
            flipped = True
        if value != 0.0:
            m.signs[c] = math.copysign(1.0, value)
    if flipped:
        for c in range(3):
            m.flipped_at[c] = pose[c]
    moved = math.sqrt((pose[0] - m.flipped_at[0]) ** 2 + (pose[1] - m.flipped_at[1]) ** 2)
    turned = abs(wrap_angle(pose[2] - m.flipped_at[2]))
    restricted = m.forbidden[0] != 0.0 or m.forbidden[1] != 0.0 or m.forbidden[2] != 0.0
    if restricted and (moved > p.reset_distance or turned > p.reset_angle):
        m.signs[:] = 0.0
        m.forbidden[:] = 0.0
