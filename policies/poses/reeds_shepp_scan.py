"""Docks by the scan alone: the shortest way of a car that goes both ways, around what its beams hit."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.geometry import OBSTACLE, row_clearance
from wayfield.envs.world.grids import NO_GRIDS
from wayfield.envs.world.reeds_shepp import pose_along
from wayfield.policies.parts.arriving import stay_radius, turn_rate
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.steering import Map, unicycle_twists
from wayfield.policies.parts.stopping import (
    SIGHTS,
    WHOLE,
    Scan,
    Seen,
    find_approaching,
    remembering,
    sees_all_round,
)
from wayfield.policies.parts.tracking import LAID, TRACKS, follow, lay_movers
from wayfield.policies.poses.reeds_shepp import (
    FIELDS,
    GRAIN,
    STRAY,
    ReedsShepp,
    advance,
    goes_on,
    make_plan,
    note_arrival,
    tracked,
)
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import sin_cos

STATE = [
    ("target", np.float64, (2,)),  # the goal, m, world frame
    ("waits", np.float64),  # 1: for a way that is free
    ("waited", np.float64),  # s, for what moves
    *SIGHTS,
    *TRACKS,
    *FIELDS,  # last: a record that began with them would be taken for one of `ReedsShepp`, with a warning
]

_CUT = 0.005  # m, by which chords between hits cut corners
_PLACES = 0.04  # m, between the places of a way that are looked at


@dataclasses.dataclass(frozen=True)
class ReedsSheppScan(ReedsShepp):
    """Drives as `ReedsShepp` does, around what the scan shows in place of a map: from anywhere near to any dock.

    What stands around is what the beams hit now: chords between neighbouring hits that are nearer to each other than
    0.4 m, single hits, and where a surface that comes nearer by itself will be in `foresight` (`find_approaching`). The
    way is planned around it once. It is planned anew, from where the robot is, where its next `lookahead` leads nearer
    to what is shown than `spare` beside the hull, or than the goal where that leaves less, and where the goal moves by
    0.15 m. While there is no free way the robot stands, and tries again every quarter of a second.

    What the scans show to move (`parts.tracking`) is no obstacle to the plan. The robot sets off, stops and drives on
    beside it as `ReedsShepp` does beside what it is told of: it gives way where it is, and comes when the way will be
    left free. Until a disc was seen to turn at both ends of its lane, it may turn at any time; the robot sets off where
    that leaves it its way as well, or once it has waited for `patience`: then the disc is taken to go on.

    It reaches poses beside and behind the robot, from which the agents for docks were not trained to begin, docks with
    gaps of two centimetres, at which those stand still and which laws that see nothing run into, and poses beyond a
    disc that goes to and fro. Limits: it waits and does not step aside: what comes to where it stands runs into it;
    that something moves shows within a second or two of sight, by three beams or more on it, 5 degrees apart or less;
    what is hidden is taken for free until it is seen. Waypoints are driven to as poses.

    Source: Reeds and Shepp, Optimal Paths for a Car That Goes Both Forwards and Backwards, Pacific J. Math. 145(2),
    1990. The map of the scan is ours.
    """

    lookahead: float = gain(1.5, "m", "of the way, that is looked at in every control period", above=0.0)
    foresight: float = gain(2.0, "s", "for which what comes nearer is put forward", least=0.0)
    spare: float = gain(0.01, "m", "beside the hull, that a way is given up for", least=0.0)
    patience: float = gain(20.0, "s", "for what moves, until it is taken to go on as it does", least=0.0)

    knows: ClassVar[str] = "sensors"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns no plan yet of each robot, (b,): a record of STATE and the scans of `remembering`.

        Raises:
            ValueError: if the robot has no range scan.
        """
        memory = remembering(self, briefing, STATE)
        memory["state"]["stay"] = stay_radius(self.arrival_radius, briefing)
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s.

        Raises:
            ValueError: if the scan has another number of beams than the briefing.
        """
        scan = Scan.of(self, observation, briefing, memory)
        p = params(
            self,
            briefing,
            **self.paced(briefing),
            closed=sees_all_round(briefing),
        )
        count, state = len(observation.pose), memory["state"]
        shown = np.zeros((count, 2 * observation.ranges.shape[1] + LAID), OBSTACLE)
        counts, standing = np.zeros((2, count), np.int64)
        seen, still = Seen.of(observation, briefing), scan._replace(ranges=scan.ranges.copy())
        lay_hits(p, scan, still, seen, state, shown, counts, standing)
        goals = np.zeros((count, 1, 2)), np.ones(count, np.int64)
        map_ = Map(shown, counts, *goals, np.repeat(NO_GRIDS.frames[:1], count), NO_GRIDS.cells)
        twists = np.empty((count, 2))
        drive(p, map_, standing, observation.pose, observation.goal, observation.goal_heading_error, state, twists)
        return unicycle_twists(briefing.robot, twists[:, 0], twists[:, 1])


@any_layout
@allocating
def lay_hits(params, whole, scan, seen, memory, shown, counts, standing):
    """Fills the OBSTACLE records of what the scans show and of where it will be, and their number (b,).

    What stands comes first, and of it there are `standing` (b,).

    Args:
        whole: the scans.
        scan: a copy, that loses what moves.
        shown: (b, 2 beams + LAID).
    """
    p = params[0]
    beams = scan.ranges.shape[1]
    farthest = (1.0 - 1e-6) * scan.reach
    ahead = np.empty((beams, 3))
    for i in range(counts.shape[0]):
        follow(p, whole, seen, memory[i], i, scan.ranges)
        sine, cosine = sin_cos(seen.poses[i, 2])
        count = 0
        for j in range(beams):
            if scan.ranges[i, j] >= farthest:
                continue
            x = scan.ranges[i, j] * scan.directions[j, 0]
            y = scan.ranges[i, j] * scan.directions[j, 1]
            k = j + 1 if j + 1 < beams else 0
            dx = scan.ranges[i, k] * scan.directions[k, 0] - x
            dy = scan.ranges[i, k] * scan.directions[k, 1] - y
            length = math.sqrt(dx * dx + dy * dy)
            each = shown[i, count]
            if 1e-6 < length < WHOLE and scan.ranges[i, k] < farthest and (k > 0 or p.closed):
                each.half_length = 0.5 * length
                each.cos = (cosine * dx - sine * dy) / length
                each.sin = (sine * dx + cosine * dy) / length
                x += 0.5 * dx
                y += 0.5 * dy
            else:
                each.cos = 1.0
            each.x = seen.poses[i, 0] + cosine * x - sine * y
            each.y = seen.poses[i, 1] + sine * x + cosine * y
            count += 1
        for j in range(find_approaching(p, scan, seen, memory[i], i, p.plant.hull_radius, ahead, 0)):
            each = shown[i, count]
            each.cos = 1.0
            each.x = seen.poses[i, 0] + cosine * ahead[j, 0] - sine * ahead[j, 1]
            each.y = seen.poses[i, 1] + sine * ahead[j, 0] + cosine * ahead[j, 1]
            count += 1
        standing[i] = count
        m = memory[i]
        counts[i] = lay_movers(m, m.steps * p.plant.dt, m.off == 0.0 and m.waited < p.patience, shown, i, count)


@any_layout
@compiled
def drive(params, map_, standing, poses, goals, turns, memory, twists):
    """Fills the (b, 2) speeds and yaw rates of `ReedsSheppScan.act` and keeps the memory up to date."""
    p = params[0]
    for i in range(poses.shape[0]):
        m = memory[i]
        gx = goals[i, 0]
        gy = goals[i, 1]
        sine, cosine = sin_cos(poses[i, 2])
        x = poses[i, 0] + cosine * gx - sine * gy
        y = poses[i, 1] + sine * gx + cosine * gy
        if m.steps == 0.0 or (x - m.target[0]) ** 2 + (y - m.target[1]) ** 2 > STRAY * STRAY:
            m.radius = 0.0
            m.arrived = 0.0
            m.waits = 0.0
            m.waited = 0.0
            m.target[0] = x
            m.target[1] = y
        now = m.steps * p.plant.dt
        m.steps += 1.0
        ended = m.radius > 0.0 and m.length - m.along < GRAIN
        note_arrival(p, m, gx, gy)
        twists[i, 0] = 0.0
        if m.arrived == 1.0:
            twists[i, 1] = turn_rate(p, turns[i])
            continue
        twists[i, 1] = 0.0
        lost = m.radius == 0.0 or ended or not advance(m, poses, i)
        if lost or is_taken(p, map_.obstacles, standing[i], m, i, poses):
            if m.waits == 1.0 and m.steps % p.pause_steps != 0.0:
                continue
            without = m.no_path
            make_plan(p, map_, poses, (gx, gy, turns[i]), m, i)
            m.waits = 1.0 if m.no_path > without else 0.0
            if m.waits == 1.0:
                m.radius = 0.0
                continue
        if not goes_on(p, map_, m, i, now, poses):
            m.waited += p.plant.dt
            continue
        twists[i, 0], twists[i, 1] = tracked(p, poses, m, i)


@inlined
def is_taken(p, shown, standing, m, i, poses):
    """Returns whether the next `lookahead` of its way takes robot i too near to what is shown, the first `standing`.

    That is nearer than `spare` beside the hull, or than the goal leaves, and nearer than the robot is now: it may stay
    or go away.
    """
    now = row_clearance(shown, i, standing, poses[i, 0], poses[i, 1])
    there = row_clearance(shown, i, standing, m.target[0], m.target[1])
    needed = min(p.plant.hull_radius + p.spare, there - _CUT, now - _CUT)
    s = m.along
    last = min(s + p.lookahead, m.length)
    while s < last:
        px, py, _ = pose_along(m.plan, m.radius, m.start, s)
        if row_clearance(shown, i, standing, px, py) < needed:
            return True
        s += _PLACES
    return False
