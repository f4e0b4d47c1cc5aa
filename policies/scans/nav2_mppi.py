"""MPPI as Nav2 configures it: 2,000 samples of its noise around the last plan, judged by its critics on a costmap."""

import dataclasses
import functools
import math
import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.kinematics import integrate_arc
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.stopping import Scan, Seen
from wayfield.policies.scans.costmap import (
    FARTHEST_PRUNED,
    INSCRIBED,
    LETHAL,
    MOST_POINTS,
    POINT_SPACING,
    CostmapController,
    Maps,
    ahead_of,
    cost_at,
    perceive,
    recovers,
    slow_down,
)
from wayfield.policies.scans.mppi import scramble, two_normals
from wayfield.system.checks import LAST_SEED
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import bearing, exponential, sin_cos, wrap_angle

HISTORY = 4  # commands before the plan, which its filter reads
FILTER = np.array([-21.0, 14.0, 39.0, 54.0, 59.0, 54.0, 39.0, 14.0, -21.0]) / 231.0  # quadratic, of nine points
FAR = math.inf


@dataclasses.dataclass(frozen=True)
class Nav2Mppi(CostmapController):
    """Nav2's MPPI controller with the gains and the critics of Nav2's own configuration, on the robot's own costmap.

    A plan u holds a twist for each of `steps` steps of `step_time`. Samples u_k = u + e_k, with Gaussian noise e_k that
    is drawn once and kept, are driven in thought within the limits of acceleration. What one costs is the sum of the
    critics below and of gamma / std^2 sum_t u(t) e_k(t) for each channel; with w_k the weights of `Mppi`, the plan
    becomes sum_k w_k u_k, is smoothed by a quadratic filter of nine points, cut to the limits, and its second twist is
    driven, since the first is what the robot does now.

    Critics, over the points of a trajectory at most 56 steps long, with L the way left along the plan, d the distance
    to the goal and f the farthest point of the plan that any trajectory's end is nearest to:

        constraint    weight x sum of the speed beyond its limits x step_time
        cost          weight / 254 x mean over every second point of the cost there (not within 1 m of the goal), or
                      of `collision_cost` from the first point in collision on
        goal          L under 1.4 m: weight x mean distance to the goal
        goal_angle    d under 0.5 m: weight x mean angle to the goal's heading
        path_align    part of the plan ahead over 0.5 m, f at least 20 points on, and at most 5 % (and two) of the
                      points up to it taken: weight x mean distance of every fourth point to the point of the plan that
                      lies as far along
        path_follow   that part over 1.4 m: weight x distance of the end to the first free point from f + 5 on
        path_angle    d over 0.5 m, and the point f + 4 more than 1 rad aside: weight x angle at the end to that point
        prefer_forward  d over 0.5 m: weight x way driven backward

    Where all samples collide the plan is thrown away and sampled once more; where they still do, the robot stops. Who
    does not get on recovers (`costmap.recovers`), and commands pass the collision monitor (`costmap.slow_down`).

    Differences from Nav2: the map is that of `scan_map` (a hit is kept to a quarter of a cell), also its global one, so
    that the plan is `ScanPlanner`'s and not NavFn's; the hull is a disc; acceleration limits are the robot's where they
    are lower; max_speed is the requested one.

    Source: nav2_mppi_controller's README, the parameters of nav2_bringup (Jazzy), and its critics' formulas; Williams,
    Drews, Goldfain, Rehg and Theodorou, IEEE T-RO 34(6), 2018.
    """

    samples: int = gain(2000, "1", "batch_size", least=1)
    steps: int = gain(56, "1", "time_steps of a sample", least=2)
    step_time: float = gain(0.05, "s", "model_dt", above=0.0)
    temperature: float = gain(0.3, "1", "of the weights: the lower, the more the best samples count", above=0.0)
    gamma: float = gain(0.015, "1", "weight of what the noise costs beside the plan", least=0.0)
    speed_noise: float = gain(0.2, "m/s", "standard deviation of the sampled speeds", above=0.0)
    yaw_noise: float = gain(0.4, "rad/s", "standard deviation of the sampled yaw rates", above=0.0)
    max_reverse: float = gain(0.35, "m/s", "backwards, at most", least=0.0)
    open_loop: bool = gain(False, "", "whether samples start from the last command, not from what is measured")
    prune_distance: float = gain(1.7, "m", "of the plan that is looked at", above=0.0, most=FARTHEST_PRUNED)
    constraint: float = gain(4.0, "1", "weight of ConstraintCritic", least=0.0)
    cost: float = gain(3.81, "1", "weight of CostCritic", least=0.0)
    collision_cost: float = gain(1e6, "1", "of a sample that collides", least=0.0)
    near_goal: float = gain(1.0, "m", "within which the cost critic only counts collisions", least=0.0)
    goal: float = gain(5.0, "1", "weight of GoalCritic", least=0.0)
    goal_within: float = gain(1.4, "m", "of the goal, where GoalCritic counts", least=0.0)
    goal_angle: float = gain(3.0, "1", "weight of GoalAngleCritic", least=0.0)
    goal_angle_within: float = gain(0.5, "m", "of the goal, where GoalAngleCritic counts", least=0.0)
    path_align: float = gain(14.0, "1", "weight of PathAlignCritic", least=0.0)
    path_align_from: float = gain(0.5, "m", "from the goal, beyond which it counts", least=0.0)
    path_align_offset: int = gain(20, "points", "of the plan ahead, at least, for it to count")
    most_occupied: float = gain(0.05, "1", "share of the plan ahead", least=0.0)
    path_follow: float = gain(5.0, "1", "weight of PathFollowCritic", least=0.0)
    path_follow_from: float = gain(1.4, "m", "from the goal, beyond which it counts", least=0.0)
    path_follow_offset: int = gain(5, "points", "of the plan ahead, that it aims at")
    path_angle: float = gain(2.0, "1", "weight of PathAngleCritic", least=0.0)
    path_angle_from: float = gain(0.5, "m", "from the goal, beyond which it counts", least=0.0)
    path_angle_offset: int = gain(4, "points", "of the plan ahead, that it aims at")
    path_angle_beyond: float = gain(1.0, "rad", "aside, beyond which it counts", least=0.0)
    prefer_forward: float = gain(5.0, "1", "weight of PreferForwardCritic", least=0.0)
    prefer_forward_from: float = gain(0.5, "m", "from the goal, beyond which it counts", least=0.0)
    cost_stride: int = gain(2, "points", "from one that CostCritic looks at to the next", least=1)
    align_stride: int = gain(4, "points", "from one that PathAlignCritic looks at to the next", least=1)
    seed: int = gain(0, "1", "of the law's own random numbers", most=LAST_SEED)

    @property
    def remembers(self) -> list[Any]:
        """Returns the fields of the plan and of the commands before it."""
        return [("sequence", np.float64, (self.steps, 3)), ("history", np.float64, (HISTORY, 3))]

    def decide(self, p: NDArray[np.void], maps: Maps, scan: Scan, seen: Seen, state: NDArray[np.void]) -> None:
        """Sets the commands of all robots."""
        noise = drawn(self.seed, self.samples, self.steps, self.speed_noise, self.yaw_noise)
        decide(p, maps, Samples.of(noise), scan, seen, state)


class Samples(NamedTuple):
    """The noise of K samples of T steps, and what becomes of them in a decision."""

    noise: NDArray[np.float64]  # (K, T, 3) m/s and rad/s
    controls: NDArray[np.float64]  # (K, T, 3) m/s and rad/s
    places: NDArray[np.float64]  # (K, T, 3) m and rad
    costs: NDArray[np.float64]  # (K,)

    @classmethod
    def of(cls, noise: NDArray[np.float64]) -> "Samples":
        """Returns the samples of some noise, in arrays that the calling thread keeps: to make them anew took as long
        as to fill them."""
        held: Samples | None = getattr(_of_thread, "samples", None)
        if held is None or held.noise is not noise:
            held = _of_thread.samples = cls(noise, np.empty_like(noise), np.empty_like(noise), np.empty(len(noise)))
        return held


_of_thread = threading.local()


@functools.lru_cache(maxsize=8)
def drawn(seed: int, samples: int, steps: int, speed_noise: float, yaw_noise: float) -> NDArray[np.float64]:
    """Returns the noise (samples, steps, 3) that all decisions share, m/s and rad/s, not to be written to."""
    noise = np.empty((samples, steps, 3))
    fill_noise(np.uint64(seed), noise)
    noise *= (speed_noise, speed_noise, yaw_noise)
    noise.setflags(write=False)
    return noise


@compiled
def fill_noise(seed, noise):
    """Fills an array (samples, steps, 3) with standard normal numbers."""
    key = scramble(seed)
    for k in range(noise.shape[0]):
        for t in range(noise.shape[1]):
            number = 2 * (k * noise.shape[1] + t)
            noise[k, t, 0], noise[k, t, 2] = two_normals(key, number)
            noise[k, t, 1], _ = two_normals(key, number + 1)


@any_layout
@allocating
def decide(params, maps, samples, scan, seen, memory):
    """Sets the commands of all robots."""
    p = params[0]
    points = np.empty((MOST_POINTS, 2))
    for i in range(memory.shape[0]):
        m = memory[i]
        pose, goal, s = perceive(p, m, maps, scan, seen, i)
        count = ahead_of(m, s, p.prune_distance, FAR, pose[0], pose[1], points)
        if recovers(p, m, pose, goal):
            m.sequence[:] = 0.0
            m.history[:] = 0.0
        else:
            now = speed_of(p, m, seen, i)
            if not p.open_loop:
                pose = after_period(p, seen, i, pose)
            state = pose, goal, m.arc[max(m.num_points - 1, 0)] - s
            if optimise(p, m, maps.costs, points[:count], state, samples, now):
                m.stuck = 0
            else:
                m.stuck += 1
                m.command[:] = 0.0
        slow_down(p, m, scan, seen, i)


@compiled
def optimise(p, m, costs_of, points, state, samples, now):
    """Sets the command to the next twist of the plan, made anew; returns whether there is one that does not collide.

    Args:
        points: (n, 2) m, of the way ahead.
        state: pose, goal, and the way (m) left.
        now: the twist that samples start from.
    """
    judged = False
    for _ in range(2 if points.shape[0] > 0 else 0):
        m.sequence[0, 0], m.sequence[0, 1], m.sequence[0, 2] = now
        roll_out(p, m.sequence, samples, now, state[0])
        judged = judge(p, m, costs_of, points, state, samples)
        if judged:
            break
        m.sequence[:] = 0.0
        m.history[:] = 0.0
    if not judged:
        return False
    add_control_cost(p, m.sequence, samples)
    average(p.temperature, samples, m.sequence)
    smooth(m.history, m.sequence)
    limit(p, now, m.sequence)
    for c in range(3):
        m.command[c] = m.sequence[1, c]
        for t in range(HISTORY):
            m.history[t, c] = m.history[t + 1, c] if t + 1 < HISTORY else m.command[c]
        for t in range(p.steps - 1):
            m.sequence[t, c] = m.sequence[t + 1, c]
    return True


@inlined
def speed_of(p, m, seen, i):
    """Returns the twist from which robot i's samples start: the measured one, moved on to the last command."""
    vx, vy, w = m.command[0], m.command[1], m.command[2]
    if not p.open_loop:
        change = p.acceleration * p.plant.dt
        turn_change = p.yaw_acceleration * p.plant.dt
        vx = min(max(vx, seen.twists[i, 0] - change), seen.twists[i, 0] + change)
        vy = min(max(vy, seen.twists[i, 1] - change), seen.twists[i, 1] + change)
        w = min(max(w, seen.twists[i, 2] - turn_change), seen.twists[i, 2] + turn_change)
    return vx, vy, w


@inlined
def after_period(p, seen, i, pose):
    """Returns where robot i will be after a control period at the measured twist."""
    twist = seen.twists[i]
    return integrate_arc(pose[0], pose[1], pose[2], twist[0], twist[1], twist[2], p.plant.dt)


@allocating
def roll_out(p, sequence, samples, now, pose):
    """Fills the controls of the samples, and where they lead: x, y (m), heading (rad).

    A control acts in the step after its own; the first step is driven at the twist that the robot has. Sines are taken
    of all steps of a sample at once, several in an instruction.
    """
    noise, controls, places, _ = samples
    dt = p.step_time
    change = p.acceleration * dt
    turn_change = p.yaw_acceleration * dt
    headings, sines, cosines = np.empty(p.steps), np.empty(p.steps), np.empty(p.steps)
    for k in range(controls.shape[0]):
        vx, vy, w = now
        x, y, heading = pose
        for t in range(p.steps):
            headings[t] = heading
            heading += w * dt
            places[k, t, 2] = heading
            vx = min(max(sequence[t, 0] + noise[k, t, 0], vx - change), vx + change)
            w = min(max(sequence[t, 2] + noise[k, t, 2], w - turn_change), w + turn_change)
            if p.plant.holonomic:
                vy = min(max(sequence[t, 1] + noise[k, t, 1], vy - change), vy + change)
            controls[k, t, 0] = vx
            controls[k, t, 1] = vy
            controls[k, t, 2] = w
        for t in range(p.steps):
            sines[t], cosines[t] = sin_cos(headings[t])
        vx, vy, _ = now
        for t in range(p.steps):
            x += (cosines[t] * vx - sines[t] * vy) * dt
            y += (sines[t] * vx + cosines[t] * vy) * dt
            places[k, t, 0] = x
            places[k, t, 1] = y
            vx = controls[k, t, 0]
            vy = controls[k, t, 1]


# The critics.


@allocating
def judge(p, m, costs_of, points, state, samples):
    """Fills the costs of the samples by all critics; returns whether one of them does not collide.

    Args:
        points: (n, 2) m, of the plan ahead.
        state: pose, goal, and the way (m) left along the plan.
    """
    pose, goal, left = state
    _, controls, places, costs = samples
    distance = math.sqrt((goal[0] - pose[0]) ** 2 + (goal[1] - pose[1]) ** 2)
    free = False
    for k in range(costs.shape[0]):
        costs[k], collides = cost_critic(p, m, costs_of, places[k], distance < p.near_goal)
        free = free or not collides
    if not free:
        return False
    taken = np.empty(points.shape[0], np.bool_)
    for j in range(points.shape[0]):
        taken[j] = cost_at(m, costs_of, points[j, 0], points[j, 1]) >= INSCRIBED
    length = POINT_SPACING * (points.shape[0] - 1)
    farthest = farthest_reached(points, places)
    aligns = length >= p.path_align_from and farthest >= p.path_align_offset and is_open(p, taken, farthest)
    follows = length >= p.path_follow_from
    turns, angle_at = is_aside(p, points, pose, farthest)
    target = following(p, taken, farthest)
    for k in range(costs.shape[0]):
        cost = p.constraint * beyond_limits(p, controls[k])
        if left <= p.goal_within:
            cost += p.goal * mean_distance(places[k], goal)
        if distance < p.goal_angle_within:
            cost += p.goal_angle * mean_angle(places[k], goal[2])
        if aligns:
            cost += p.path_align * misalignment(p, points, taken, places[k])
        if follows:
            cost += p.path_follow * away_from(places[k], points[target])
        if turns and distance >= p.path_angle_from:
            cost += p.path_angle * angle_to(places[k], points[angle_at])
        if distance >= p.prefer_forward_from:
            cost += p.prefer_forward * backward_way(p, controls[k])
        costs[k] += cost
    return True


@inlined
def cost_critic(p, m, costs_of, places, near):
    """Returns the cost of a trajectory by the costmap, and whether it collides; near: whether the goal is."""
    steps = places.shape[0]
    total = 0.0
    looked = 0
    collides = False
    for t in range(0, steps, p.cost_stride):
        looked += 1
        if collides:
            continue
        here = cost_at(m, costs_of, places[t, 0], places[t, 1])
        if here >= INSCRIBED:
            total = p.collision_cost
            collides = True
        elif not near:
            total += here
    return p.cost / LETHAL * total / looked, collides


@inlined
def beyond_limits(p, controls):
    """Returns the sum over the steps of what the speed exceeds its limits by, times the step, m."""
    most = p.max_speed
    least = -p.max_reverse
    total = 0.0
    for t in range(controls.shape[0] - 1):
        v = controls[t, 0]
        if p.plant.holonomic:
            most = math.sqrt(2.0) * p.max_speed
            least = -math.sqrt(p.max_reverse * p.max_reverse + p.max_speed * p.max_speed)
            v = math.copysign(math.sqrt(v * v + controls[t, 1] * controls[t, 1]), v)
        total += max(v - most, 0.0) + max(least - v, 0.0)
    return total * p.step_time


@inlined
def mean_distance(places, goal):
    """Returns the mean distance (m) of a trajectory's points from the goal."""
    total = 0.0
    for t in range(places.shape[0]):
        dx = places[t, 0] - goal[0]
        dy = places[t, 1] - goal[1]
        total += math.sqrt(dx * dx + dy * dy)
    return total / places.shape[0]


@inlined
def mean_angle(places, heading):
    """Returns the mean angle (rad) between the headings of a trajectory and the goal's."""
    total = 0.0
    for t in range(places.shape[0]):
        total += abs(wrap_angle(heading - places[t, 2]))
    return total / places.shape[0]


@compiled
def farthest_reached(points, places):
    """Returns the farthest of the points that the end of some trajectory is nearest to."""
    farthest = 0
    last = places.shape[1] - 1
    for k in range(places.shape[0]):
        nearest = np.inf
        place = 0
        for j in range(points.shape[0]):
            dx = points[j, 0] - places[k, last, 0]
            dy = points[j, 1] - places[k, last, 1]
            d = dx * dx + dy * dy
            if d < nearest:
                nearest = d
                place = j
        farthest = max(farthest, place)
    return farthest


@inlined
def is_open(p, taken, farthest):
    """Returns whether at most two of the plan's points, or a small share of them, are taken up to the farthest."""
    count = 0
    for j in range(farthest):
        count += taken[j]
    return count <= 2 or count <= p.most_occupied * farthest


@inlined
def misalignment(p, points, taken, places):
    """Returns the mean distance (m) of a trajectory's points from those of the plan that lie as far along."""
    last = points.shape[0] - 2
    gone = 0.0
    total = 0.0
    count = 0
    for t in range(p.align_stride, places.shape[0], p.align_stride):
        dx = places[t, 0] - places[t - p.align_stride, 0]
        dy = places[t, 1] - places[t - p.align_stride, 1]
        gone += math.sqrt(dx * dx + dy * dy)
        j = max(min(int(gone / POINT_SPACING + 0.5), last), 0)
        if not taken[j]:
            dx = places[t, 0] - points[j, 0]
            dy = places[t, 1] - points[j, 1]
            total += math.sqrt(dx * dx + dy * dy)
            count += 1
    return total / max(count, 1)


@inlined
def following(p, taken, farthest):
    """Returns the point of the plan that trajectories shall end at: the first free one from an offset on."""
    last = taken.shape[0] - 1
    j = min(farthest + p.path_follow_offset, last)
    while j < last - 1 and taken[j]:
        j += 1
    return j


@inlined
def away_from(places, point):
    """Returns the distance (m) of a trajectory's end from a point."""
    dx = places[-1, 0] - point[0]
    dy = places[-1, 1] - point[1]
    return math.sqrt(dx * dx + dy * dy)


@inlined
def is_aside(p, points, pose, farthest):
    """Returns whether the plan leads aside of where the robot looks, and the point of the plan that says so."""
    j = min(farthest + p.path_angle_offset, points.shape[0] - 1)
    aside = abs(wrap_angle(bearing(points[j, 1] - pose[1], points[j, 0] - pose[0]) - pose[2]))
    return aside >= p.path_angle_beyond, j


@inlined
def angle_to(places, point):
    """Returns the angle (rad) from a trajectory's last heading to a point."""
    return abs(wrap_angle(bearing(point[1] - places[-1, 1], point[0] - places[-1, 0]) - places[-1, 2]))


@inlined
def backward_way(p, controls):
    """Returns how far (m) a trajectory goes backward."""
    total = 0.0
    for t in range(controls.shape[0] - 1):
        total += max(-controls[t, 0], 0.0)
    return total * p.step_time


# From costs to the next plan.


@compiled
def add_control_cost(p, sequence, samples):
    """Adds to the costs what the noise costs beside the plan: gamma / std^2 sum_t u(t) e(t), for each channel."""
    speed = p.gamma / (p.speed_noise * p.speed_noise)
    turn = p.gamma / (p.yaw_noise * p.yaw_noise)
    _, controls, _, costs = samples
    for k in range(costs.shape[0]):
        total = 0.0
        for t in range(p.steps):
            total += speed * sequence[t, 0] * (controls[k, t, 0] - sequence[t, 0])
            total += turn * sequence[t, 2] * (controls[k, t, 2] - sequence[t, 2])
            if p.plant.holonomic:
                total += speed * sequence[t, 1] * (controls[k, t, 1] - sequence[t, 1])
        costs[k] += total


@allocating
def average(temperature, samples, sequence):
    """Makes the plan the mean of the samples' controls, weighted by exp(-(cost - least cost) / temperature)."""
    _, controls, _, costs = samples
    least = costs.min()
    total = 0.0
    sequence[:] = 0.0
    for k in range(costs.shape[0]):
        weight = exponential((least - costs[k]) / temperature)
        if weight < 1e-12:
            continue
        total += weight
        for t in range(sequence.shape[0]):
            for c in range(3):
                sequence[t, c] += weight * controls[k, t, c]
    sequence /= total


@allocating
def smooth(history, sequence):
    """Filters the plan (steps, 3): FILTER over four twists before, which the history keeps, and four after it."""
    steps = sequence.shape[0]
    raw = sequence.copy()
    for t in range(steps):
        for c in range(3):
            total = 0.0
            for j in range(FILTER.shape[0]):
                at = t + j - HISTORY
                value = history[HISTORY + at, c] if at < 0 else raw[min(at, steps - 1), c]
                total += FILTER[j] * value
            sequence[t, c] = total


@compiled
def limit(p, now, sequence):
    """Cuts the plan to the limits of speed and, from the twist that the robot has on, of acceleration."""
    change = p.acceleration * p.step_time
    turn_change = p.yaw_acceleration * p.step_time
    sequence[0, 0], sequence[0, 1], sequence[0, 2] = now
    for t in range(1, sequence.shape[0]):
        vx = min(max(sequence[t, 0], -p.max_reverse), p.max_speed)
        sequence[t, 0] = min(max(vx, sequence[t - 1, 0] - change), sequence[t - 1, 0] + change)
        w = min(max(sequence[t, 2], -p.max_yaw_rate), p.max_yaw_rate)
        sequence[t, 2] = min(max(w, sequence[t - 1, 2] - turn_change), sequence[t - 1, 2] + turn_change)
        vy = min(max(sequence[t, 1], -p.max_speed), p.max_speed)
        sequence[t, 1] = min(max(vy, sequence[t - 1, 1] - change), sequence[t - 1, 1] + change)
