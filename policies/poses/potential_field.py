"""Document C's artificial potential field: as printed, with its escape from local minima, and put right."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.geometry import lengths, nearest_surface
from wayfield.envs.world.grids import grid_clearance, grid_normal
from wayfield.envs.world.movers import any_moves, go_on
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.steering import Map, velocity_twists
from wayfield.policies.parts.stopping import REST, arrived, rest_radius
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, sines

MEMORY = np.dtype(
    [
        ("side", np.float64),  # on which the robot passes an obstacle, +1 left, -1 right, 0 undecided
        ("steps", np.float64),  # since the episode began, where something moves
        *REST,
    ]
)


@dataclasses.dataclass(frozen=True)
class PotentialField(GoalLaw):
    """Drives with the sum of an attracting and a repelling force as its velocity.

    With x the position, x* the goal, x_o the centres of the obstacles and d their distances:

        F_att = k_att (x* - x)
        F_rep = sum over d <= tau of k_rep (x - x_o) / d^4
        l_c = |F_att| / (|F_rep| + 0.0001), a local minimum is declared when l_c <= tau_l

    With `escape`, the repulsion turned by 90 degrees is added while a local minimum is declared: towards the goal's
    side of the obstacle, to the left when all three are in line, and that side is kept until the obstacle is passed.

    Obstacles and robot are points here. The force jumps by k_rep / tau^3 where the influence begins; as printed there
    is no speed limit but the wheels'. With an obstacle on the straight way the field as printed never arrives: it
    bounces (tau up to 1 m) or rests at a saddle. `stop_radius` 0.25 m and `max_speed` 0.3 m/s reproduce where the
    document's real robots stopped. tau and tau_l are not printed. A differential drive, which the document does not
    have, turns towards the force and drives forward with what of it lies ahead.

    Source: document C (four-omni-wheel robot).
    """

    k_att: float = gain(0.2, "1/s", "of the attraction", above=0.0)
    k_rep: float = gain(0.52, "m^4/s", "of the repulsion", above=0.0)
    tau: float = gain(0.5, "m", "range of the repulsion", above=0.0)
    tau_l: float = gain(1.05, "1", "l_c is 1 at any equilibrium", above=0.0)
    escape: bool = gain(False, "", "whether an avoiding force leads out of local minima")
    max_speed: float = gain(math.inf, "m/s", "at most", above=0.0, finite=False)
    stop_radius: float = gain(0.0, "m", "from the goal", least=0.0)
    turn_gain: float = gain(2.0, "1/s", "with which a differential drive turns towards the force", above=0.0)

    knows: ClassVar[str] = "map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the side and the steps of each robot, MEMORY records (b,)."""
        return np.zeros(briefing.num_envs, MEMORY)

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        obstacles, counts = obstacles_now(briefing, observation.pose, memory)
        to_goal = world_from_body(observation.goal, observation.pose)
        away = observation.pose[:, None, :2] - np.stack([obstacles["x"], obstacles["y"]], axis=-1)
        distance = np.maximum(lengths(away), 1e-6)
        standing = np.arange(distance.shape[1]) < counts[:, None]
        distance[~standing] = np.inf
        attraction = self.k_att * to_goal
        near = distance <= self.tau
        strength = np.where(near, self.k_rep / distance**4, 0.0)
        repulsion = summed(strength, away)
        force = attraction + repulsion
        if self.escape and distance.shape[1]:
            l_c = lengths(attraction) / (lengths(repulsion) + 0.0001)
            nearest = distance.argmin(axis=1)
            to_obstacle = -np.take_along_axis(away, nearest[:, None, None], axis=1)[:, 0]
            trapped = (l_c <= self.tau_l) & near.any(axis=1)
            choose_side(memory["side"], trapped, to_obstacle, to_goal)
            turned = memory["side"][:, None] * np.column_stack([repulsion[:, 1], -repulsion[:, 0]])
            force += np.where(trapped[:, None], turned, 0.0)
        force *= np.minimum(1.0, self.max_speed / np.maximum(lengths(force), 1e-12))[:, None]
        twists = velocity_twists(
            briefing.robot,
            body_from_world(force, observation.pose),
            observation.goal_heading_error,
            self.k_att if briefing.robot.holonomic else self.turn_gain,
        )
        return np.where((lengths(to_goal) <= self.stop_radius)[:, None], 0.0, twists)


@dataclasses.dataclass(frozen=True)
class CorrectedField(GoalLaw):
    """A potential field without the faults of the printed one.

    With e the vector to the goal, d = |e|, rho the gap between hull and surface of an obstacle and n the direction away
    from its nearest point:

        F_att = k e, no longer than max_speed                                       (Latombe: conic far, parabolic near)
        F_rep = eta (1/rho - 1/rho_0) d^2 / rho^2 n + eta (1/rho - 1/rho_0)^2 e     for rho <= rho_0

    The repulsion is Khatib's FIRAS function, measured to the surface, times Ge and Cui's d^2, so that it vanishes at a
    goal that lies close to an obstacle. While the first part of F_rep opposes the way to the goal it is turned by 90
    degrees instead, towards the goal's side of the obstacle, which leaves no point where the forces cancel; the side is
    kept until the obstacle is passed. The sum is cut to max_speed. Traps deeper than the field sees, such as a U around
    the goal, still hold it. An omni base drives the force as a velocity; a differential drive turns towards it and
    drives forward with what of it lies ahead, until it rests within `stop_radius` of the goal, or nearer where the goal
    asks for it, and turns to the goal heading.

    Source: Khatib, IJRR 5(1), 1986, eq. 18; Ge and Cui, IEEE T-RA 16(5), 2000, eqs. 7-10.
    """

    k: float = gain(0.6, "1/s", "of the attraction", above=0.0, search=(0.3, 2.0))
    eta: float = gain(0.02, "m^2/s", "of the repulsion", above=0.0, search=(0.003, 0.1))
    rho_0: float = gain(0.6, "m", "range of the repulsion", above=0.0, search=(0.2, 1.0))
    max_speed: float = gain(0.3, "m/s", "at most", above=0.0, search=(0.3, 0.6))
    turn_gain: float = gain(2.0, "1/s", "with which a differential drive turns towards the force", above=0.0)
    stop_radius: float = gain(0.05, "m", "within which a differential drive turns to the goal heading", least=0.0)

    knows: ClassVar[str] = "map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the side and the steps of each robot, and where it rests, MEMORY records (b,)."""
        memory = np.zeros(briefing.num_envs, MEMORY)
        memory["stop_radius"] = rest_radius(self.stop_radius, briefing.position_tolerance)
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        twists = np.empty((len(observation.pose), 3))
        seen = observation.pose, observation.goal, observation.goal_heading_error, observation.waypoints_left
        steer(params(self, briefing), Map.of(briefing), *seen, memory, twists)
        return twists[:, briefing.robot.twist_axes]


@any_layout
@allocating
def steer(params, map_, poses, goals, turns, waypoints_left, memory, twists):
    """Fills the (b, 3) twists of `CorrectedField.act` and keeps the sides up to date."""
    p = params[0]
    here = np.zeros((1, map_.obstacles.shape[1] + 1), map_.obstacles.dtype)
    for i in range(poses.shape[0]):
        count = around(p, map_, poses, memory, i, here)
        sine, cosine = sin_cos(poses[i, 2])
        ex = cosine * goals[i, 0] - sine * goals[i, 1]
        ey = sine * goals[i, 0] + cosine * goals[i, 1]
        fx, fy = corrected_force(p, here[0], count, poses[i], (ex, ey), memory[i])
        vx = cosine * fx + sine * fy
        vy = cosine * fy - sine * fx
        if p.plant.holonomic:
            twists[i, 0] = vx
            twists[i, 1] = vy
            twists[i, 2] = p.k * turns[i]
        elif arrived(memory[i], math.sqrt(ex * ex + ey * ey), waypoints_left[i]):
            twists[i, 0] = 0.0
            twists[i, 1] = 0.0
            twists[i, 2] = p.turn_gain * turns[i]
        else:
            # as `velocity_twists`
            twists[i, 0] = max(vx, 0.0)
            twists[i, 1] = 0.0
            twists[i, 2] = p.turn_gain * (0.0 if math.sqrt(vx * vx + vy * vy) < 1e-9 else bearing(vy, vx))


@inlined
def around(p, map_, poses, memory, i, here):
    """Puts what stands around robot i now into `here`, (1, m), as `obstacles_now` does; returns how many they are."""
    m = memory[i]
    count = map_.counts[i]
    for j in range(count):
        here[0, j] = map_.obstacles[i, j]
    if any_moves(map_.obstacles, i, count):
        go_on(here, 0, count, m.steps * p.plant.dt)
        m.steps += 1.0
    if map_.cells.shape[0] > 0:
        count = nearest_cell(map_.frames[i], map_.cells, poses[i], here[0], count)
    return count


@inlined
def corrected_force(p, obstacles, count, pose, to_goal, m):
    """Returns the force of `CorrectedField` in the world frame, and keeps the side up to date."""
    ex, ey = to_goal
    d = math.sqrt(ex * ex + ey * ey)
    shorten = min(p.k, p.max_speed / max(d, 1e-12))
    fx = shorten * ex
    fy = shorten * ey
    ahead = False
    for j in range(count):
        distance, nx, ny = nearest_surface(obstacles[j], pose[0], pose[1])
        # a touching hull is pushed away with the force of a millimetre's gap
        rho = max(distance - p.plant.hull_radius, 1e-3)
        if rho > p.rho_0:
            continue
        gap = 1.0 / rho - 1.0 / p.rho_0
        push = p.eta * gap * d * d / (rho * rho)
        pull = p.eta * gap * gap
        fx += pull * ex
        fy += pull * ey
        if nx * ex + ny * ey < 0.0:
            ahead = True
            if m.side == 0.0:
                # left when the goal is left of the obstacle, or in line with it
                m.side = 1.0 if ey * nx - ex * ny <= 1e-9 * d else -1.0
            fx += push * m.side * ny
            fy -= push * m.side * nx
        else:
            fx += push * nx
            fy += push * ny
    if not ahead:
        m.side = 0.0
    cut = min(1.0, p.max_speed / max(math.sqrt(fx * fx + fy * fy), 1e-12))
    return cut * fx, cut * fy


def obstacles_now(
    briefing: Briefing, poses: NDArray[np.float64], memory: NDArray[np.void]
) -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """Returns the obstacles (b, m) where they are now and how many they are, (b,), and counts the step in memory.

    Those on patrol have moved on. Of a grid the point nearest to the robot is one obstacle more, of no size.
    """
    assert briefing.map is not None
    obstacles, counts, frames, cells = briefing.map
    if obstacles["patrol"]["leg_time"].any():
        obstacles = obstacles.copy()
        move(obstacles, counts, memory["steps"] * briefing.dt)
        memory["steps"] += 1.0
    if len(cells):
        seen = np.zeros((len(obstacles), obstacles.shape[1] + 1), obstacles.dtype)
        seen[:, :-1] = obstacles
        counts = counts.copy()
        append_nearest(frames, cells, poses, seen, counts)
        obstacles = seen
    return obstacles, counts


@compiled
def append_nearest(frames, cells, poses, obstacles, counts):
    """Puts the occupied point nearest to each of the poses (b, 3) behind its obstacles (b, m), and counts it."""
    for i in range(poses.shape[0]):
        counts[i] = nearest_cell(frames[i], cells, poses[i], obstacles[i], counts[i])


@inlined
def nearest_cell(frame, cells, pose, obstacles, count):
    """Puts the occupied point nearest to a pose, if any, behind the obstacles (m,); returns how many they are."""
    distance = grid_clearance(frame, cells, pose[0], pose[1])
    if not distance < np.inf:
        return count
    nx, ny = grid_normal(frame, cells, pose[0], pose[1])
    obstacles[count].x = pose[0] - distance * nx
    obstacles[count].y = pose[1] - distance * ny
    obstacles[count].cos = 1.0
    obstacles[count].sin = 0.0
    obstacles[count].half_length = 0.0
    obstacles[count].half_width = 0.0
    obstacles[count].radius = 0.0
    obstacles[count].mass = 0.0
    return count + 1


@compiled
def move(obstacles, counts, times):
    """Puts the obstacles (b, m) on patrol where they are at the times (b,), s, into their episodes."""
    for i in range(obstacles.shape[0]):
        go_on(obstacles, i, counts[i], times[i])


@allocating
def summed(strength, away):
    """Returns the sums (b, 2) of vectors (b, m, 2) times their strengths: a lone robot sums as one of many does."""
    sums = np.zeros((away.shape[0], 2))
    for i in range(away.shape[0]):
        for j in range(away.shape[1]):
            sums[i, 0] += strength[i, j] * away[i, j, 0]
            sums[i, 1] += strength[i, j] * away[i, j, 1]
    return sums


def choose_side(
    side: NDArray[np.float64],
    trapped: NDArray[np.bool_],
    to_obstacle: NDArray[np.float64],
    to_goal: NDArray[np.float64],
) -> None:
    """Sets the side of the robots that get trapped, and clears it where the obstacle lies behind."""
    side[to_obstacle[:, 0] * to_goal[:, 0] + to_obstacle[:, 1] * to_goal[:, 1] <= 0.0] = 0.0
    cross = to_obstacle[:, 0] * to_goal[:, 1] - to_obstacle[:, 1] * to_goal[:, 0]
    # observations have single precision: what is in line to that precision is in line
    goal_side = np.where(cross >= -1e-6, 1.0, -1.0)
    undecided = trapped & (side == 0.0)
    side[undecided] = goal_side[undecided]


def world_from_body(vectors: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the vectors (b, 2) turned from the body frames of the poses (b, 3) into the world frame."""
    sine, cosine = sines(pose[:, 2])
    return np.column_stack(
        [cosine * vectors[:, 0] - sine * vectors[:, 1], sine * vectors[:, 0] + cosine * vectors[:, 1]]
    )


def body_from_world(vectors: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the vectors (b, 2) turned from the world frame into the body frames of the poses (b, 3)."""
    sine, cosine = sines(pose[:, 2])
    return np.column_stack(
        [cosine * vectors[:, 0] + sine * vectors[:, 1], cosine * vectors[:, 1] - sine * vectors[:, 0]]
    )
