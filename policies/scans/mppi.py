"""Model predictive path integral control: many sampled plans, each driven in thought, and their weighted mean."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots.kinematics import integrate_arc, limits
from wayfield.envs.robots.records import lag_factors
from wayfield.envs.scenarios.ways import reached
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.policy import check_scan
from wayfield.policies.parts.stopping import (
    RECALL_RANGE,
    RECALLED,
    SECTORS,
    Seen,
    beam_directions,
    keep_near,
    recalled_near,
    remember,
    sees_all_round,
    set_command,
)
from wayfield.system.checks import LAST_SEED
from wayfield.system.compiled import allocating, any_layout, assign, compiled, inlined
from wayfield.system.elementary import exponential, logarithm, sin_cos, wrap_angle


@dataclasses.dataclass(frozen=True)
class Mppi(GoalLaw):
    """Samples plans around the last one, drives each through the model of motion, and takes their weighted mean.

    A plan is a twist for each of `steps` steps of `step_time`. With m the last plan, moved on by a control period, and
    K samples u_k = clamp(m + e_k), where e_k is Gaussian noise that keeps `noise_correlation` of itself from step to
    step, and S_k what the rollout of u_k costs:

        w_k = exp(-(S_k - min S) / temperature) / sum_j exp(-(S_j - min S) / temperature)
        m <- sum_k w_k u_k,  and its first twist is driven

    The minimum is taken off the costs lest all weights vanish, and the mean is over the clamped samples: noise drawn
    before the clamp would push the plan beyond its bounds. The first two samples are the last plan itself and
    standstill. The mean of plans that pass an obstacle on both sides may hit it: where it costs over a hundredth of a
    collision more than the cheapest sample, that one is taken.

    A rollout starts from the measured twist and the last command and knows saturation, acceleration limits and lag.
    With c the gap between hull and the nearest obstacle and L the length of the way to the goal,

        S = terminal_weight L(end) + mean over steps of goal_weight L + obstacle_weight max(1 - c / influence, 0)^2
            + turn_weight w^2 + reverse_weight max(-v_x, 0) + sway_weight |v_y| + heading_weight |goal heading error|
            + collision_cost (share of the horizon left) once c falls under `margin`

    the heading counts for an omni base on its last leg. Within `arrival_radius` of the goal the robot turns to the goal
    heading instead.

    Obstacles are the hits of the scan, in the body frame; hits closer together than the hull is wide are joined. What
    is near stays known for `recall` seconds after it drops out of sight, the nearest point of each sector around the
    robot, as it does for DWA and VFH+ (`parts.stopping`): the tip of a wall mostly stands between two beams. Obstacles
    fill a grid of `cell` around the robot with distances and, with `detour`, with the length L of the shortest way to
    the goal around them (the eikonal equation, by fast sweeping; what was not seen counts as free, and beyond the grid
    the way is straight). Without it L is the straight distance, as is usual, and a dead end holds the robot. Of what is
    far away nothing is remembered, so that a dead end deeper than the scan or the grid can still hold it. A
    differential drive reverses only where it sees all around.

    Both kinds of robot; an omni base has a channel of its own for sideways motion.

    Source: Williams, Drews, Goldfain, Rehg and Theodorou, IEEE T-RO 34(6), 2018, algorithm 2, with the base
    distribution at the last plan (alpha = 1: no control cost but that in S); Zhao, Math. Comp. 74, 2005 (sweeping).
    """

    samples: int = gain(256, "1", "rollouts", least=2)
    steps: int = gain(30, "1", "of a rollout", least=2)
    step_time: float = gain(0.1, "s", "of a rollout's steps", above=0.0)
    temperature: float = gain(0.05, "m", "as the costs", above=0.0, search=(0.01, 0.3))
    speed_noise: float = gain(0.25, "m/s", "standard deviation of the sampled speeds", least=0.0)
    yaw_noise: float = gain(0.7, "rad/s", "standard deviation of the sampled yaw rates", least=0.0, search=(0.3, 1.5))
    noise_correlation: float = gain(0.8, "1", "from a step to the next", least=0.0, below=1.0)
    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    max_reverse: float = gain(0.2, "m/s", "backwards, at most", least=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "at most", above=0.0)
    influence: float = gain(0.3, "m", "range of the obstacles' cost, from the hull", above=0.0, search=(0.1, 0.6))
    goal_weight: float = gain(1.0, "1", "of the way to the goal, along a rollout", least=0.0)
    terminal_weight: float = gain(2.0, "1", "of the way to the goal, at its end", least=0.0)
    obstacle_weight: float = gain(1.0, "m", "of nearness to obstacles", least=0.0, search=(0.2, 5.0))
    margin: float = gain(0.03, "m", "gap at which a rollout has collided", least=0.0)
    collision_cost: float = gain(20.0, "m", "of a collision", least=0.0)
    turn_weight: float = gain(0.02, "m s^2/rad^2", "of the squared yaw rate", least=0.0)
    reverse_weight: float = gain(0.5, "s", "of driving backwards", least=0.0)
    sway_weight: float = gain(0.0, "s", "of driving aside", least=0.0)
    heading_weight: float = gain(0.1, "m/rad", "of not heading for the goal", least=0.0)
    recall: float = gain(2.0, "s", "for which what is near stays known out of sight", least=0.0)
    detour: bool = gain(True, "", "whether the way to the goal leads around what is seen")
    reach: float = gain(4.0, "m", "half side of the grid", above=0.0)
    cell: float = gain(0.1, "m", "side of a cell of the grid", above=0.0)
    arrival_radius: float = gain(0.07, "m", "from the goal, within which it turns to the heading", least=0.0)
    turn_gain: float = gain(2.0, "1/s", "of the turn to the goal heading", least=0.0)
    seed: int = gain(0, "1", "of the law's own random numbers", most=LAST_SEED)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.reach / self.cell <= MOST_CELLS:
            raise ValueError(f"Mppi: reach must be at most {MOST_CELLS} cells ({self.cell:g} m), got {self.reach!r}")

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what each robot remembers, (b,): its number of decisions, last command, last plan and what was near.

        Raises:
            ValueError: if the robot has no beams.
        """
        if not len(briefing.beam_angles):
            raise ValueError(
                f"{type(self).__name__} sees obstacles by range beams, but num_beams is 0; give 32 or more"
            )
        fields = [
            ("decisions", np.int64),  # so far, which numbers the noise
            ("command", np.float64, (3,)),  # the last, as the plant takes it, m/s and rad/s
            ("plan", np.float64, (self.steps, 3)),
            RECALLED,
        ]
        return np.zeros(briefing.num_envs, fields)

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s.

        Raises:
            ValueError: if the scan has another number of beams than the briefing.
        """
        check_scan(self, observation.ranges, briefing)
        twists = np.empty((len(memory), 3))
        decide(
            self.params(briefing),
            beam_directions(briefing),
            np.ascontiguousarray(observation.ranges),
            Seen.of(observation, briefing),
            memory,
            twists,
        )
        return twists[:, list(briefing.robot.twist_axes)]

    def params(self, briefing: Briefing) -> NDArray[np.void]:
        """Returns what the law reads, see `params.params`."""
        all_round = sees_all_round(briefing)
        step_time = max(self.step_time, briefing.dt)
        decay, mean = lag_factors(briefing.actuators.reaction, step_time)
        return params(
            self,
            briefing,
            step_time=step_time,
            max_reverse=self.max_reverse if all_round else 0.0,
            max_range=briefing.max_range,
            all_round=all_round,
            step_decay=decay,  # as `lag_decay` and `lag_mean`, over a step of the plan
            step_mean=mean,
            half=math.ceil(self.reach / self.cell),  # cells from the robot to the side of the grid
        )


MOST_CELLS = 500  # from the robot to the side of the grid
FAR = 1e3  # m, longer than any way
WALL_SLOWNESS = 60.0  # metres of way that a metre through an obstacle counts for


@any_layout
@allocating
def decide(params, beams, ranges, seen, memory, twists):
    """Fills the (b, 3) twists of `Mppi` and moves its memory on."""
    p = params[0]
    scratch = scratch_for(p, beams.shape[0])
    clearances, ways, _, _, plans, costs, _ = scratch
    noise = np.empty((p.samples, p.steps, 3))
    drawn = -1  # the decision whose noise that is
    for i in range(memory.shape[0]):
        m = memory[i]
        wheels = seen.twists[i]
        goal_x = seen.goals[i, 0]
        goal_y = seen.goals[i, 1]
        turn = seen.heading_errors[i]
        last_leg = seen.waypoints_left[i] < 0.5
        goal = goal_x, goal_y, turn, last_leg
        if last_leg and math.sqrt(goal_x * goal_x + goal_y * goal_y) <= p.arrival_radius:
            twists[i, 0] = p.turn_gain * goal_x if p.plant.holonomic else 0.0
            twists[i, 1] = p.turn_gain * goal_y if p.plant.holonomic else 0.0
            twists[i, 2] = min(max(p.turn_gain * turn, -p.max_yaw_rate), p.max_yaw_rate)
            m.plan[:] = 0.0
        else:
            if m.decisions != drawn:  # robots that began together draw the same
                draw(p, m.decisions, noise)
                drawn = m.decisions
            best = weighed(p, beams, ranges, seen, m, i, noise, scratch)
            mean_cost = roll_out(p, plans[p.samples], m.command, wheels, goal, clearances, ways)
            chosen = p.samples if mean_cost <= costs[best] + 0.01 * p.collision_cost else best
            assign(m.plan, plans[chosen])
            for c in range(3):
                twists[i, c] = plans[chosen, 0, c]
        set_command(p.plant, m.command, twists[i, 0], twists[i, 1], twists[i, 2])
        m.decisions += 1


@allocating
def scratch_for(p, beams):
    """Returns what a decision fills: the grid's clearances, ways and slowness; hits; plans, their costs and weights."""
    side = 2 * p.half + 1
    grid = side, side
    plans = np.empty((p.samples + 1, p.steps, 3))
    costs = np.empty(p.samples)
    hits = np.empty((beams + SECTORS, 3))
    return np.empty(grid), np.empty(grid), np.empty(grid), hits, plans, costs, np.empty(p.samples)


@allocating
def weighed(p, beams, ranges, seen, m, i, noise, scratch):
    """Fills the plans of robot i, their costs and, behind the plans, their weighted mean; returns the best of them."""
    clearances, ways, slowness, hits, plans, costs, weights = scratch
    near = recalled_near(p, seen, m, i, 0.0)
    count = find_hits(p, beams, ranges, i, near, hits)
    # points by themselves: they are joined with nothing
    count = keep_near(p, seen, m, i, near, 0.0, hits, count)
    measure_clearances(p, hits, count, clearances)
    if p.detour:
        measure_ways(p, clearances, seen.goals[i, 0], seen.goals[i, 1], slowness, ways)
    goal = seen.goals[i, 0], seen.goals[i, 1], seen.heading_errors[i], seen.waypoints_left[i] < 0.5
    move_on(p, m.plan)
    sample(p, noise, m.plan, plans)
    for k in range(p.samples):
        costs[k] = roll_out(p, plans[k], m.command, seen.twists[i], goal, clearances, ways)
    best = weigh(costs, p.temperature, weights)
    average(plans, weights, p.samples)
    return best


# What the scan shows.


@compiled
def find_hits(p, beams, ranges, i, near, hits):
    """Writes (x, y, joined) of the beams that meet something, body frame, m; notes the near ones; returns how many.

    joined: 1 when the next hit in the list, or 2 when the first one, lies on the next beam and belongs to the same
    surface as far as the hull is concerned: it cannot pass between, or the two are in line with the hit before or
    behind them, as on a wall that is seen at a flat angle.
    """
    count = 0
    last = -2
    for k in range(beams.shape[0]):
        distance = ranges[i, k]
        if distance >= p.max_range - 1e-4:
            continue
        hits[count, 0] = distance * beams[k, 0]
        hits[count, 1] = distance * beams[k, 1]
        hits[count, 2] = 0.0
        if distance < RECALL_RANGE:
            remember(near, hits[count, 0], hits[count, 1], max(distance, 1e-6), p.recall)
        if last == k - 1:
            hits[count - 1, 2] = 1.0  # on the next beam; looked at below
        last = k
        count += 1
    closed = count > 2 and p.all_round and ranges[i, 0] < p.max_range - 1e-4 and last == beams.shape[0] - 1
    if closed:
        hits[count - 1, 2] = 1.0
    for h in range(count):
        if hits[h, 2] == 0.0:
            continue
        after = (h + 1) % count
        dx = hits[after, 0] - hits[h, 0]
        dy = hits[after, 1] - hits[h, 1]
        gap = math.sqrt(dx * dx + dy * dy)
        if gap < 2.0 * p.plant.hull_radius:
            continue
        before = (h - 1) % count
        behind = (after + 1) % count
        in_line = hits[before, 2] != 0.0 and straight(hits, before, h, after)
        if not in_line and hits[after, 2] != 0.0:
            in_line = straight(hits, h, after, behind)
        if not in_line:
            hits[h, 2] = -1.0  # neighbours on their beams all the same
    for h in range(count):
        hits[h, 2] = max(hits[h, 2], 0.0)
    if closed:
        hits[count - 1, 2] *= 2.0
    return count


@inlined
def straight(hits, a, b, c):
    """Returns whether the way over three hits bends by less than 0.1 rad."""
    ux = hits[b, 0] - hits[a, 0]
    uy = hits[b, 1] - hits[a, 1]
    vx = hits[c, 0] - hits[b, 0]
    vy = hits[c, 1] - hits[b, 1]
    return abs(ux * vy - uy * vx) < 0.1 * (ux * vx + uy * vy)


@compiled
def measure_clearances(p, hits, count, clearances):
    """Fills the grid with the gap (m) between a hull at each node and the nearest hit, at most `influence` + a cell.

    Exact at the nodes; each hit is asked only about those it can matter to.
    """
    side = clearances.shape[0]
    cap = p.plant.hull_radius + max(p.influence, p.margin) + 2.0 * p.cell
    inverse = 1.0 / p.cell
    clearances[:, :] = cap * cap
    for h in range(count):
        ax = hits[h, 0]
        ay = hits[h, 1]
        dx = 0.0
        dy = 0.0
        scale = 0.0
        if hits[h, 2] > 0.0:
            after = h + 1 if hits[h, 2] == 1.0 else 0
            dx = hits[after, 0] - ax
            dy = hits[after, 1] - ay
            scale = 1.0 / max(dx * dx + dy * dy, 1e-12)
        low_i = max(math.ceil((min(ax, ax + dx) - cap) * inverse) + p.half, 0)
        high_i = min(math.floor((max(ax, ax + dx) + cap) * inverse) + p.half, side - 1)
        low_j = max(math.ceil((min(ay, ay + dy) - cap) * inverse) + p.half, 0)
        high_j = min(math.floor((max(ay, ay + dy) + cap) * inverse) + p.half, side - 1)
        for i in range(low_i, high_i + 1):
            rx = (i - p.half) * p.cell - ax
            for j in range(low_j, high_j + 1):
                ry = (j - p.half) * p.cell - ay
                along = min(max((rx * dx + ry * dy) * scale, 0.0), 1.0)
                ex = rx - along * dx
                ey = ry - along * dy
                clearances[i, j] = min(clearances[i, j], ex * ex + ey * ey)
    for i in range(side):
        for j in range(side):
            clearances[i, j] = math.sqrt(clearances[i, j]) - p.plant.hull_radius


@allocating
def measure_ways(p, clearances, goal_x, goal_y, slowness, ways):
    """Fills the grid with the length (m) of the shortest way from each node to the goal.

    Solves |grad way| = slowness, which is 1 where the hull fits and more near an obstacle, from the border of the grid,
    which is a straight line from the goal, and from the nodes around the goal if it lies inside.
    """
    side = ways.shape[0]
    for i in range(side):
        x = (i - p.half) * p.cell
        for j in range(side):
            y = (j - p.half) * p.cell
            closed = min(max((p.margin - clearances[i, j]) / p.cell, 0.0), 1.0)
            narrow = max(1.0 - max(clearances[i, j], 0.0) / p.influence, 0.0)
            slowness[i, j] = 1.0 + p.obstacle_weight * narrow * narrow + WALL_SLOWNESS * closed
            straight = math.sqrt((x - goal_x) ** 2 + (y - goal_y) ** 2)
            border = i == 0 or j == 0 or i == side - 1 or j == side - 1
            if border or straight < 2.0 * p.cell:
                # the border of the grid is no way through what stands on it
                ways[i, j] = straight + WALL_SLOWNESS * closed * p.plant.hull_radius
            else:
                ways[i, j] = FAR
    # a node is looked at again once one beside it has changed since: what it would find else is there
    stale = np.full((side + 2, side + 2), True)  # with a rim, which nobody looks at
    for _ in range(8):
        change = 0.0
        for sweep in range(4):
            for a in range(side):
                i = a if sweep & 1 else side - 1 - a
                for b in range(side):
                    j = b if sweep & 2 else side - 1 - b
                    if not stale[i + 1, j + 1]:
                        continue
                    stale[i + 1, j + 1] = False
                    here = ways[i, j]
                    across = min(ways[i - 1, j] if i > 0 else FAR, ways[i + 1, j] if i < side - 1 else FAR)
                    along = min(ways[i, j - 1] if j > 0 else FAR, ways[i, j + 1] if j < side - 1 else FAR)
                    if min(across, along) >= here:
                        continue
                    way = reached(across, along, slowness[i, j] * p.cell)
                    if way < here:
                        change = max(change, here - way)
                        ways[i, j] = way
                        stale[i, j + 1] = stale[i + 2, j + 1] = True
                        stale[i + 1, j] = stale[i + 1, j + 2] = True
        if change < 0.01:
            break
    # a hull beside a wall reads nodes in it too: they shall not say how far it is through the wall
    for i in range(side):
        for j in range(side):
            if clearances[i, j] < p.margin:
                nearest = FAR
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        a = i + di
                        b = j + dj
                        if 0 <= a < side and 0 <= b < side and clearances[a, b] >= p.margin:
                            nearest = min(nearest, ways[a, b] + p.cell * math.sqrt(di * di + dj * dj))
                if nearest < FAR:
                    ways[i, j] = nearest


@inlined
def look_up(p, grid, x, y):
    """Returns the grid's value at a point, bilinear between four nodes; beyond the grid that at its border."""
    top = 2.0 * p.half - 1e-9
    # constants first: what is no number gives an index too
    u = min(max(0.0, x / p.cell + p.half), top)
    v = min(max(0.0, y / p.cell + p.half), top)
    i = int(u)
    j = int(v)
    u -= i
    v -= j
    return (1.0 - u) * ((1.0 - v) * grid[i, j] + v * grid[i, j + 1]) + u * (
        (1.0 - v) * grid[i + 1, j] + v * grid[i + 1, j + 1]
    )


# Plans.


@compiled
def move_on(p, plan):
    """Moves a plan (steps, 3) on by a control period, between whose steps it is linear; its last twist is kept."""
    last = p.steps - 1
    whole = math.floor(min(p.plant.dt / p.step_time, 1.0 * last))
    share = p.plant.dt / p.step_time - whole
    for t in range(p.steps):
        a = min(t + whole, last)
        b = min(t + whole + 1, last)
        for c in range(3):
            plan[t, c] = (1.0 - share) * plan[a, c] + share * plan[b, c]


# Noise by its number, so that a lone robot draws what it draws in a batch. The bits are unsigned: shifts bring in
# zeros, and products wrap around.


@inlined
def scramble(z):
    """Returns 64 bits that look random for each 64 bits: the finaliser of SplitMix64 (Steele et al., OOPSLA 2014)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@inlined
def two_normals(key, number):
    """Returns the two standard normal numbers of that number in the stream of the key (Box and Muller)."""
    bits = scramble(key + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15))
    size = math.sqrt(-2.0 * logarithm((np.float64(bits >> np.uint64(32)) + 1.0) / 4294967296.0))
    s, c = sin_cos(2.0 * math.pi * (np.float64(bits & np.uint64(0xFFFFFFFF)) / 4294967296.0))
    return size * c, size * s


@inlined
def clamp(p, vx, vy, yaw_rate):
    """Returns the nearest twist that a plan may hold."""
    yaw_rate = min(max(yaw_rate, -p.max_yaw_rate), p.max_yaw_rate)
    if p.plant.holonomic:
        speed = math.sqrt(vx * vx + vy * vy)
        if speed > p.max_speed:
            vx *= p.max_speed / speed
            vy *= p.max_speed / speed
        return vx, vy, yaw_rate
    return min(max(vx, -p.max_reverse), p.max_speed), 0.0, yaw_rate


@compiled
def draw(p, decisions, noise):
    """Fills the noise (samples, steps, 3) of that decision of any robot, m/s and rad/s, correlated along a plan."""
    key = scramble(np.uint64(p.seed))
    fresh = math.sqrt(1.0 - p.noise_correlation * p.noise_correlation)
    number = decisions * p.samples * p.steps * 2
    for k in range(2, p.samples):
        ex = 0.0
        ey = 0.0
        turn = 0.0
        keep = 0.0
        new = 1.0
        for t in range(p.steps):
            n_x, n_turn = two_normals(key, number + 2 * (k * p.steps + t))
            ex = keep * ex + new * p.speed_noise * n_x
            turn = keep * turn + new * p.yaw_noise * n_turn
            if p.plant.holonomic:
                n_y, _ = two_normals(key, number + 2 * (k * p.steps + t) + 1)
                ey = keep * ey + new * p.speed_noise * n_y
            keep = p.noise_correlation
            new = fresh
            noise[k, t, 0] = ex
            noise[k, t, 1] = ey
            noise[k, t, 2] = turn


@allocating
def sample(p, noise, plan, plans):
    """Fills the plans of a robot's next decision: its last one, standstill, and that last one with noise, clamped."""
    assign(plans[0], plan)
    plans[1] = 0.0
    for k in range(2, p.samples):
        for t in range(p.steps):
            plans[k, t, 0], plans[k, t, 1], plans[k, t, 2] = clamp(
                p, plans[0, t, 0] + noise[k, t, 0], plans[0, t, 1] + noise[k, t, 1], plans[0, t, 2] + noise[k, t, 2]
            )


@compiled
def weigh(costs, temperature, weights):
    """Fills the weights, which sum to 1, and returns the index of the least cost."""
    best = 0
    for k in range(1, costs.shape[0]):
        if costs[k] < costs[best]:
            best = k
    total = 0.0
    for k in range(costs.shape[0]):
        weights[k] = exponential((costs[best] - costs[k]) / temperature)
        total += weights[k]
    for k in range(costs.shape[0]):
        weights[k] /= total
    return best


@compiled
def average(plans, weights, row):
    """Writes the weighted mean of the plans before it to a row of the plans."""
    plans[row] = 0.0
    for k in range(weights.shape[0]):
        if weights[k] > 1e-12:
            for t in range(plans.shape[1]):
                for c in range(3):
                    plans[row, t, c] += weights[k] * plans[k, t, c]


@inlined
def begun(command, wheels):
    """Returns the state that a rollout begins with: the pose at the origin, the measured twist, the last command."""
    return 0.0, 0.0, 0.0, wheels[0], wheels[1], wheels[2], command[0], command[1], command[2]


@inlined
def moved(p, state, to_vx, to_vy, to_yaw_rate):
    """Returns a rollout's state after a step with a requested twist: saturation, acceleration limits, lag, motion."""
    x, y, heading, wheel_vx, wheel_vy, wheel_yaw_rate, vx, vy, yaw_rate = state
    vx, vy, yaw_rate, _ = limits(p.plant, (vx, vy, yaw_rate), (to_vx, to_vy, to_yaw_rate), p.step_time)
    mean_vx = vx + p.step_mean * (wheel_vx - vx)
    mean_vy = vy + p.step_mean * (wheel_vy - vy)
    mean_yaw_rate = yaw_rate + p.step_mean * (wheel_yaw_rate - yaw_rate)
    wheel_vx = vx + p.step_decay * (wheel_vx - vx)
    wheel_vy = vy + p.step_decay * (wheel_vy - vy)
    wheel_yaw_rate = yaw_rate + p.step_decay * (wheel_yaw_rate - yaw_rate)
    x, y, heading = integrate_arc(x, y, heading, mean_vx, mean_vy, mean_yaw_rate, p.step_time)
    return x, y, heading, wheel_vx, wheel_vy, wheel_yaw_rate, vx, vy, yaw_rate


@compiled
def roll_out(p, plan, command, wheels, goal, clearances, ways):
    """Returns the cost (m) of a plan (steps, 3), from the pose at the origin.

    Args:
        command, wheels: (3,) the last command and the measured twist, m/s and rad/s.
        goal: x, y (m, body frame), heading error (rad), and whether it is the last leg.
    """
    plant = p.plant
    goal_x, goal_y, heading_error, last_leg = goal
    state = begun(command, wheels)
    # a hull that is inside the margin already may come out, and not go much nearer
    least = min(p.margin, 0.5 * look_up(p, clearances, 0.0, 0.0))
    inverse_influence = 1.0 / p.influence
    inverse_steps = 1.0 / p.steps
    running = 0.0
    way = 0.0
    for t in range(p.steps):
        to_vx = plan[t, 0]
        to_vy = plan[t, 1]
        to_yaw_rate = plan[t, 2]
        state = moved(p, state, to_vx, to_vy, to_yaw_rate)
        x, y, heading = state[0], state[1], state[2]
        gap = look_up(p, clearances, x, y)
        dx = goal_x - x
        dy = goal_y - y
        way = math.sqrt(dx * dx + dy * dy)
        if p.detour and way > 3.0 * p.cell:
            way = look_up(p, ways, x, y)
        if gap < least:
            # it stands here for the rest
            left = 1.0 - t * inverse_steps
            return running * inverse_steps + left * (p.collision_cost + p.goal_weight * way) + p.terminal_weight * way
        near = max(1.0 - gap * inverse_influence, 0.0)
        running += (
            p.goal_weight * way
            + p.obstacle_weight * near * near
            + p.turn_weight * to_yaw_rate * to_yaw_rate
            + p.reverse_weight * max(-to_vx, 0.0) * (1 - plant.holonomic)
            + p.sway_weight * abs(to_vy)
        )
        if plant.holonomic and last_leg:
            running += p.heading_weight * abs(wrap_angle(heading_error - heading))
    return running * inverse_steps + p.terminal_weight * way
