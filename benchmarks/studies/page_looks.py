"""What the laws look at, for the page to draw: the numbers that a decision begins with, by the laws' own functions.

Each has the arguments of its law's decision that it needs, by their names there, and fills one array `looked`. It may
change the memory: the page hands it a copy.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wayfield.envs.crowds.half_planes import best_velocity
from wayfield.envs.world.reeds_shepp import pose_along
from wayfield.policies.parts.carrot import place_on_lap, point_at_distance, pose_ahead
from wayfield.policies.parts.detour import LOOK, seek
from wayfield.policies.parts.stopping import (
    APPROACH,
    SECTORS,
    Scan,
    arrived,
    braking_speed,
    find_approaching,
    find_hits,
    turn_towards,
)
from wayfield.policies.paths import lqr, stanley
from wayfield.policies.poses import reeds_shepp_scan
from wayfield.policies.poses.potential_field import around, corrected_force
from wayfield.policies.scans import dwa, mppi, vfh_plus
from wayfield.policies.teams import orca, orca_team, orca_team_map
from wayfield.system.compiled import allocating, compiled
from wayfield.system.elementary import sin_cos

DRAWN = 48  # rollouts of MPPI, its first ones
GRID = 441  # places that a field is drawn at
LINES = 64  # half-planes that are drawn


@dataclasses.dataclass(frozen=True)
class Look:
    """What the page draws of a law: how, what it is called there, and the compiled function that finds its numbers."""

    kind: str
    title: str
    kernel: Any
    shape: tuple[int, ...]  # of `looked`
    places: int = 0  # at which it is looked, world frame


@compiled
def pursued(params: Any, course: Any, motion: Any, looked: Any) -> None:
    """Fills (x, y) of the point that `PurePursuit` pursues and its distance, m."""
    p = params[0]
    vertices, runs, path_index = course
    run = runs[path_index[0]]
    x, y, _ = motion.poses[0]
    along, segment = place_on_lap(vertices, run, motion.arc_lengths[0])
    px, py = point_at_distance(vertices, run, x, y, along, segment, p.lookahead_distance, p.window)
    looked[0] = px
    looked[1] = py
    looked[2] = p.lookahead_distance


@compiled
def regulated(params: Any, course: Any, motion: Any, commands: Any, looked: Any) -> None:
    """Fills (x, y) of the point that `RegulatedPurePursuit` pursues, m, and 0."""
    p = params[0]
    vertices, runs, path_index = course
    run = runs[path_index[0]]
    along, segment = place_on_lap(vertices, run, motion.arc_lengths[0])
    distance = min(max(p.lookahead_time * commands[0, 0], p.min_lookahead), p.max_lookahead)
    looked[0], looked[1], _ = pose_ahead(vertices, run, along, segment, distance)
    looked[2] = 0.0


@compiled
def chased(params: Any, course: Any, motion: Any, looked: Any) -> None:
    """Fills (x, y) of the pose that `SmoothPose` chases along a path, m, and 0."""
    p = params[0]
    vertices, runs, path_index = course
    run = runs[path_index[0]]
    along, segment = place_on_lap(vertices, run, motion.arc_lengths[0])
    looked[0], looked[1], _ = pose_ahead(vertices, run, along, segment, p.lookahead_distance)
    looked[2] = 0.0


@compiled
def off_axle(params: Any, course: Any, motion: Any, looked: Any) -> None:
    """Fills (x, y) of the front axle of `Stanley`, how far left of the path it is (m), and the path's heading (rad)."""
    p = params[0]
    vertices, runs, path_index = course
    x, y, heading = motion.poses[0]
    sine, cosine = sin_cos(heading)
    looked[0] = x + p.axle_distance * cosine
    looked[1] = y + p.axle_distance * sine
    looked[2], looked[3] = stanley.from_path(
        vertices, runs[path_index[0]], motion.arc_lengths[0], p.window, looked[0], looked[1]
    )


@compiled
def off_path(params: Any, course: Any, motion: Any, looked: Any) -> None:
    """Fills (x, y) of a robot under `Lqr`, how far left of the rounded path it is (m), and the heading there (rad)."""
    p = params[0]
    vertices, runs, path_index = course
    x, y, _ = motion.poses[0]
    looked[0] = x
    looked[1] = y
    _, looked[3], looked[2] = lqr.on_rounded_path(
        vertices, runs[path_index[0]], motion.arc_lengths[0], p.rounding, x, y
    )


@allocating
def forces(
    params: Any, map_: Any, poses: Any, goals: Any, waypoints_left: Any, memory: Any, places: Any, looked: Any
) -> None:
    """Fills the forces (GRID, 2) of `CorrectedField` at places (GRID, 2), m, around the robot."""
    p = params[0]
    here = np.zeros((1, map_.obstacles.shape[1] + 1), map_.obstacles.dtype)
    m = memory[0]
    count = around(p, map_, poses, memory, 0, here)
    sine, cosine = sin_cos(poses[0, 2])
    goal_x = poses[0, 0] + cosine * goals[0, 0] - sine * goals[0, 1]
    goal_y = poses[0, 1] + sine * goals[0, 0] + cosine * goals[0, 1]
    side = m.side
    there = np.zeros(3)
    for k in range(places.shape[0]):
        there[0] = places[k, 0]
        there[1] = places[k, 1]
        m.side = side
        to_goal = (goal_x - there[0], goal_y - there[1])
        looked[k, 0], looked[k, 1] = corrected_force(p, here[0], count, there, to_goal, m)


@allocating
def sectors(params: Any, scan: Any, seen: Any, memory: Any, looked: Any) -> None:
    """Fills the primary, binary and masked histograms (3, DIRECTIONS) of `VfhPlus`, and its goal and choice (rad).

    In a row more: the direction of the goal or detour, the chosen one, and 0 where it looks at none of this.
    """
    p = params[0]
    points = np.empty((2 * scan.ranges.shape[1] + SECTORS, 3))
    cells = np.empty((points.shape[0], 2))
    blocked = np.zeros(vfh_plus.DIRECTIONS, np.bool_)
    radius = p.plant.hull_radius + p.margin
    farthest = max(p.window, radius + max(p.max_speed * vfh_plus.AHEAD, LOOK))
    m = memory[0]
    count = find_hits(p, scan, seen, m, 0, farthest, radius, points, 0.0)
    if p.foresight > 0.0:
        count = find_approaching(p, scan, seen, m, 0, radius, points, count)
    hits = points[:count]
    weighed = hits
    if p.summed:
        weighed = cells[: vfh_plus.cells_of(hits, seen.poses[0], cells)]
    d = math.sqrt(seen.goals[0, 0] ** 2 + seen.goals[0, 1] ** 2)
    looked[3, 2] = 0.0
    if not arrived(m, d, seen.waypoints_left[0]):
        heading = seen.poses[0, 2]
        aim, round_it = seek(p, hits, seen, m, 0)
        choice, _ = vfh_plus.choose_direction(p, weighed, m, heading, aim, d, round_it, looked[0], blocked)
        for k in range(vfh_plus.DIRECTIONS):
            looked[1, k] = m.binary[k]
            looked[2, k] = 1.0 if blocked[k] else 0.0
        looked[3, 0] = heading + aim
        looked[3, 1] = choice
        looked[3, 2] = 1.0


@allocating
def arcs(params: Any, scan: Any, seen: Any, memory: Any, looked: Any) -> None:
    """Fills the twists and scores (n, 4) of the dynamic window of `Dwa`, -inf: not admissible; NaN: it looks at none.

    The last row has the horizon, s, and the goal or the way of a detour, m, body frame.
    """
    p = params[0]
    points = np.empty((2 * scan.ranges.shape[1] + SECTORS, 3))
    candidates = looked[: dwa.SPEEDS * dwa.TURNS]
    candidates[:] = np.nan
    radius = p.plant.hull_radius + p.margin
    delay = p.plant.lag + p.plant.dt
    stopping = p.max_speed * (delay + p.plant.dt + p.max_speed / p.plant.acceleration)
    farthest = radius + p.room_range + max(p.max_speed * p.horizon, stopping, 3.0)
    m = memory[0]
    count = find_hits(p, scan, seen, m, 0, farthest, radius, points, 0.0)
    slowest = 0.0
    if p.foresight > 0.0:
        standing = count
        count = find_approaching(p, scan, seen, m, 0, radius, points, count)
        slowest = -p.retreat if p.all_round and count > standing else 0.0
    hits = points[:count]
    goal_x = seen.goals[0, 0]
    goal_y = seen.goals[0, 1]
    d = math.sqrt(goal_x * goal_x + goal_y * goal_y)
    if not arrived(m, d, seen.waypoints_left[0]):
        aim, round_it = seek(p, hits, seen, m, 0)
        fastest = p.max_speed
        if round_it:
            d = p.max_speed * p.horizon
            goal_x = d * sin_cos(aim)[1]
            goal_y = d * sin_cos(aim)[0]
        elif seen.waypoints_left[0] == 0.0:
            fastest = min(fastest, braking_speed(d, APPROACH * p.plant.acceleration, delay))
        if p.sideways:
            turn = turn_towards(seen.heading_errors[0], p.turn_gain, p.max_yaw_rate)
            dwa.fill_disc(p, m.command, aim, turn, fastest, candidates)
        else:
            dwa.fill_window(p, m.command, slowest, fastest, candidates)
        for c in range(dwa.SPEEDS * dwa.TURNS):
            candidates[c, 3] = dwa.score(p, hits, candidates[c], aim, d, goal_x, goal_y)
    looked[dwa.SPEEDS * dwa.TURNS, 0] = p.horizon
    looked[dwa.SPEEDS * dwa.TURNS, 1] = goal_x
    looked[dwa.SPEEDS * dwa.TURNS, 2] = goal_y


@allocating
def half_planes(params: Any, map_: Any, seen: Any, memory: Any, looked: Any) -> None:
    """Fills the half-planes (LINES, 4) of `Orca` that cut velocities off: n (world frame), bound (m/s), 1 if it stands.

    NaN beyond them. In two rows more: the wanted velocity and the nearest that keeps them; the greatest speed, m/s.
    """
    p = params[0]
    m = memory[0]
    lines = np.empty((orca.most_lines(map_), 3))
    total, hard = orca.fill_lines(p, map_, seen.poses, seen.twists, 0, m.steps * p.plant.dt, lines, np.empty(1))
    note_lines(lines, total, hard, p.max_speed, looked)
    wanted_x, wanted_y = orca.wanted(p, m, map_, seen, 0)
    looked[LINES, 0] = wanted_x
    looked[LINES, 1] = wanted_y
    looked[LINES, 2], looked[LINES, 3] = best_velocity(
        lines, total, hard, p.max_speed, wanted_x, wanted_y, np.empty(lines.shape)
    )


@allocating
def orca_of_team(
    params: Any, measured: Any, poses: Any, goals: Any, bodies: Any, ranges: Any, beams: Any, memory: Any, out: Any
) -> None:
    """Fills the (1, t) twists of `OrcaTeam`, which decides in two steps."""
    wanted = np.empty((1, 2))
    orca_team.want(params, poses, goals, bodies, memory, wanted)
    orca_team.avoid(params, measured, bodies, ranges, beams, wanted, out)


@allocating
def orca_of_team_map(
    params: Any,
    planner: Any,
    map_: Any,
    measured: Any,
    poses: Any,
    goals: Any,
    waypoints_left: Any,
    bodies: Any,
    ranges: Any,
    beams: Any,
    memory: Any,
    out: Any,
) -> None:
    """Fills the (1, t) twists of `OrcaTeamMap`, which plans a way before it decides as `OrcaTeam` does."""
    targets = np.empty((1, 2))
    orca_team_map.find_targets(planner, map_, poses, goals, waypoints_left, memory, targets)
    orca_of_team(params, measured, poses, targets, bodies, ranges, beams, memory, out)


@allocating
def dock_by_scan(
    params: Any, whole: Any, seen: Any, laid: Any, standing: Any, goals: Any, turns: Any, memory: Any, twists: Any
) -> None:
    """Fills the (1, 2) twists of `ReedsSheppScan`, which lays down what its scan hits before it decides."""
    scan = Scan(whole.ranges.copy(), whole.directions, whole.reach, whole.older, whole.newer)
    reeds_shepp_scan.lay_hits(params, whole, scan, seen, memory, laid.obstacles, laid.counts, standing)
    reeds_shepp_scan.drive(params, laid, standing, seen.poses, goals, turns, memory, twists)


@allocating
def half_planes_of_team(
    params: Any, measured: Any, poses: Any, goals: Any, bodies: Any, ranges: Any, beams: Any, memory: Any, looked: Any
) -> None:
    """Fills what `half_planes` does of `OrcaTeam`."""
    p = params[0]
    lines = np.empty((bodies.shape[1] + ranges.shape[1], 3))
    total, hard = orca_team.fill_lines(p, measured, bodies, ranges, beams, 0, lines)
    wanted = np.empty((1, 2))
    orca_team.want(params, poses, goals, bodies, memory, wanted)
    ux, uy = best_velocity(lines, total, hard, p.max_speed, wanted[0, 0], wanted[0, 1], np.empty(lines.shape))
    note_lines(lines, total, hard, p.max_speed, looked)
    looked[LINES, 0] = wanted[0, 0]
    looked[LINES, 1] = wanted[0, 1]
    looked[LINES, 2] = ux
    looked[LINES, 3] = uy
    sine, cosine = sin_cos(poses[0, 2])
    for k in range(LINES + 1):
        for j in range(0, 4 if k == LINES else 2, 2):
            x = looked[k, j]
            y = looked[k, j + 1]
            looked[k, j] = cosine * x - sine * y
            looked[k, j + 1] = sine * x + cosine * y


@compiled
def note_lines(lines: Any, total: Any, hard: Any, max_speed: Any, looked: Any) -> None:
    """Fills the half-planes that velocities of up to max_speed can violate, and that speed."""
    looked[:] = np.nan
    row = 0
    for k in range(total):
        if lines[k, 2] > -max_speed and row < LINES:
            looked[row, 0] = lines[k, 0]
            looked[row, 1] = lines[k, 1]
            looked[row, 2] = lines[k, 2]
            looked[row, 3] = 1.0 if k < hard else 0.0
            row += 1
    looked[LINES + 1, 0] = max_speed


@allocating
def rollouts(params: Any, beams: Any, ranges: Any, seen: Any, memory: Any, looked: Any) -> None:
    """Fills where the first plans of `Mppi` lead, (DRAWN, 32, 2), m, body frame, and the mean of all in the last row.

    A row begins with the plan's cost above the least and the number of its steps; NaN: it looks at none.
    """
    p = params[0]
    looked[:] = np.nan
    m = memory[0]
    goal_x = seen.goals[0, 0]
    goal_y = seen.goals[0, 1]
    if seen.waypoints_left[0] < 0.5 and math.sqrt(goal_x * goal_x + goal_y * goal_y) <= p.arrival_radius:
        return
    noise = np.empty((p.samples, p.steps, 3))
    mppi.draw(p, m.decisions, noise)
    scratch = mppi.scratch_for(p, beams.shape[0])
    best = mppi.weighed(p, beams, ranges, seen, m, 0, noise, scratch)
    plans, costs = scratch[4], scratch[5]
    for row in range(looked.shape[0]):
        k = p.samples if row == looked.shape[0] - 1 else row
        if k > p.samples or (k == row and k >= p.samples):
            continue
        steps = min(p.steps, looked.shape[1] - 1)
        looked[row, 0, 0] = 0.0 if k == p.samples else costs[k] - costs[best]
        looked[row, 0, 1] = steps
        state = mppi.begun(m.command, seen.twists[0])
        for t in range(steps):
            state = mppi.moved(p, state, plans[k, t, 0], plans[k, t, 1], plans[k, t, 2])
            looked[row, t + 1, 0] = state[0]
            looked[row, t + 1, 1] = state[1]


@compiled
def planned(memory: Any, looked: Any) -> None:
    """Fills the points (n, 2) of the polyline that `PolylineTracker` follows, m; NaN beyond its end."""
    m = memory[0]
    looked[:] = np.nan
    for k in range(min(m.num_points, looked.shape[0])):
        looked[k, 0] = m.points[k, 0]
        looked[k, 1] = m.points[k, 1]


@compiled
def maneuver(memory: Any, looked: Any) -> None:
    """Fills points (n, 2) of the plan of `ReedsShepp`, m, evenly spaced; NaN without one."""
    m = memory[0]
    looked[:] = np.nan
    if m.radius > 0.0:
        for k in range(looked.shape[0]):
            looked[k, 0], looked[k, 1], _ = pose_along(
                m.plan, m.radius, m.start, m.length * k / (looked.shape[0] - 1.0)
            )


ALONG_PATHS: Mapping[str, Look] = {
    "pure_pursuit": Look("point", "the point of the path that it steers at", pursued, (3,)),
    "regulated_pure_pursuit": Look("point", "the point of the path that it steers at", regulated, (3,)),
    "smooth_pose": Look("point", "the pose that it steers at", chased, (3,)),
    "stanley": Look("offset", "how far its front axle is off the path (red)", off_axle, (4,)),
    "lqr": Look("offset", "how far it is off the path (red)", off_path, (4,)),
}
TO_POSES: Mapping[str, Look] = {
    "apf_corrected": Look("field", "where pulls and pushes would take it (arrows)", forces, (GRID, 2), GRID),
    "vfh_plus": Look(
        "sectors", "directions around it: violet are free, red are barred", sectors, (4, vfh_plus.DIRECTIONS)
    ),
    "dwa": Look("arcs", "arcs that it could drive; it takes the thick one", arcs, (dwa.SPEEDS * dwa.TURNS + 1, 4)),
    "scan_planner": Look("way", "the way that it plans", planned, (256, 2)),
    "astar_tracker": Look("way", "the way that it plans", planned, (256, 2)),
    "reeds_shepp": Look("way", "the way that it plans", maneuver, (129, 2)),
    "reeds_shepp_scan": Look("way", "the way that it plans", maneuver, (129, 2)),
    "mppi": Look(
        "rollouts", "plans that it tried at random; it drives the thick one, their mean", rollouts, (DRAWN + 1, 33, 2)
    ),
    "orca": Look("half_planes", "velocities ORCA rules out", half_planes, (LINES + 2, 4)),
}
# of those that drive among other bodies alone
AMONG_BODIES: Mapping[str, Look] = {
    "orca_team": Look("half_planes", "velocities ORCA rules out", half_planes_of_team, (LINES + 2, 4)),
    "orca_team_map": Look("way", "the way that it plans", planned, (256, 2)),
}
