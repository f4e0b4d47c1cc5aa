"""The barrier behind a policy: of all twists that near nothing too fast, the one nearest to what is asked for.

A safety filter by control barrier functions, to stand beside `shield` and be compared with it.
"""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots import Actuators
from wayfield.envs.robots.kinematics import saturated, to_body_frame
from wayfield.envs.robots.records import MAX_WHEELS, aligned
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.lead import led_to
from wayfield.policies.parts.params import params
from wayfield.policies.parts.policy import Policy, check_robot
from wayfield.policies.parts.shield import Shielded, blind_directions, check_view
from wayfield.policies.parts.stopping import RECALLED, SECTORS, Scan, Seen, beam_directions, find_hits, set_command
from wayfield.system.compiled import allocating, any_layout, inlined
from wayfield.system.elementary import bearing, sin_cos

STATE = aligned(
    [
        ("command", np.float64, (3,)),  # m/s and rad/s, the last as the plant takes it
        ("fastest", np.float64),  # m/s, asked for so far
        ("braked", np.int64),  # periods in which no twist was allowed
        RECALLED,
    ]
)
AROUND = 18  # sectors of which a hit has a row: many beams end on one wall, and a second one stands across
ROWS = AROUND + 2 + 2 * MAX_WHEELS + 2
EXACT = 1e-9  # of a row, that counts as kept


def most_gamma(actuators: Actuators, dt: float) -> float:
    """Returns the largest gamma (1/s) with which a base that is late by lag and half a period overshoots no barrier.

    Along a line, u = gamma gap with the time constant T has the poles of T s^2 + s + gamma, real up to 1/(4 T).
    """
    return 1.0 / (4.0 * (actuators.reaction + 0.5 * dt))


@dataclasses.dataclass(frozen=True)
class Barrier(Gains):
    """Passes on the twist nearest to the asked one that nears nothing faster than gamma times its gap.

    Both components of a twist move a point o that lies `offset` ahead of the axle (of omni bases, in their middle):

        o = p + offset T,    o' = v T + offset w N.

    For each hit p_i, with the unit vector n from it to o and the speed of approach v_d,

        gap_i = |o - p_i| - (hull + offset + margin) - v_d^2 / (2 A) - v_d dt,
        n . o' >= -gamma gap_i

    and of all twists that keep the rows of the nearest hit of each sector and of the wheels, the one with the least
    (v - v_0)^2 + turn_weight (w - w_0)^2 is driven. With two unknowns that is the asked twist itself, or its projection
    on one row, or where two rows meet. Where there is none, the robot brakes. Pose and twist are those that the last
    command leads to by the time at which the next one takes effect, lag + dt/2.

    What a hit is, and what stands out of sight, is as `Shield` has it. What moves is taken for standing still. Unlike
    the shield it steers a policy that does not look past obstacles; it also holds one up that does, for at a wall that
    lies across the way every twist along it may be farther from the asked one than to stand (deadlock).

    Source: Ames, Coogan, Egerstedt, Notomista, Sreenath, Tabuada, "Control barrier functions: theory and applications",
    ECC 2019; the point ahead of the axle as in the Robotarium's single integrators.
    """

    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)

    gamma: float | None = gain(
        None, "1/s", "of a gap by which it may shrink; None: 1/(4 (lag + dt/2)), or acceleration / speed", above=0.0
    )
    offset: float = gain(0.05, "m", "from the axle to the point that is kept away", above=0.0)
    margin: float = gain(0.03, "m", "kept from hits besides the hull", least=0.0)
    turn_weight: float = gain(0.02, "m^2", "of a change of the yaw rate beside one of the speed", above=0.0)
    spread: float = gain(1.0, "1", "of the angle between beams that hits are grown by", least=0.0)
    recall: float = gain(10.0, "s", "for which what is near stays known out of sight", least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what is remembered of each robot, (b,) STATE.

        Raises:
            ValueError: if the scan looks at less than half a turn, the robot is steered, or gamma is above
                `most_gamma`.
        """
        check_view(self, briefing)
        check_robot(self, briefing.robot)  # type: ignore[arg-type]
        most = most_gamma(briefing.actuators, briefing.dt)
        if self.gamma is not None and self.gamma > most:
            raise ValueError(
                f"Barrier: gamma is {self.gamma:g}; it must be at most {most:.4g} 1/s = 1/(4 (lag + dt/2)) for "
                f"{briefing.robot.name} with a lag of {briefing.actuators.reaction:g} s"
            )
        return np.zeros(briefing.num_envs, STATE)

    def passed(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any], twists: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s, that are driven for those asked for: see `Shield.passed`."""
        spacing = briefing.beam_angles[1] - briefing.beam_angles[0]
        nothing = np.empty((0, 0, 2))
        scan = Scan(
            np.ascontiguousarray(observation.ranges), beam_directions(briefing), briefing.max_range, nothing, nothing
        )
        driven = np.zeros((len(memory), 3))
        driven[:, briefing.robot.twist_axes] = twists
        own = most_gamma(briefing.actuators, briefing.dt) if self.gamma is None else self.gamma
        p = params(self, briefing, spacing=self.spread * float(spacing), rate=own, bounded=int(self.gamma is None))
        blind = blind_directions(briefing)
        filter_twists(p, scan, Seen.of(observation, briefing), blind[[0, -1]] if len(blind) else blind, memory, driven)
        return driven[:, briefing.robot.twist_axes]


def cbf(policy: Policy, **gains: Any) -> Shielded:
    """Returns a policy for goals with a `Barrier` of these gains behind it.

    Raises:
        TypeError, ValueError: if a gain is unknown or out of its range.
    """
    return Shielded(policy, Barrier(**gains))


@any_layout
@allocating
def filter_twists(params, scan, seen, blind, memory, twists):
    """Filters the twists (b, 3) of `Barrier.passed` in place.

    blind: unit vectors (0 or 2, 2), body frame, to where the sector without beams begins and ends.
    """
    p = params[0]
    plant = p.plant
    points = np.empty((scan.ranges.shape[1] + SECTORS, 3))
    rows = np.empty((ROWS, 3))
    offset = 0.0 if plant.holonomic else p.offset
    radius = plant.hull_radius + p.margin
    for i in range(twists.shape[0]):
        m = memory[i]
        vx, vy, w = saturated(plant, twists[i, 0], twists[i, 1], twists[i, 2])
        m.fastest = max(m.fastest, math.sqrt(vx * vx + vy * vy))
        gamma = p.rate
        if p.bounded and m.fastest > 0.0:
            gamma = min(gamma, plant.acceleration / m.fastest)
        wheels = seen.twists[i]
        speed = max(m.fastest, math.sqrt(wheels[0] * wheels[0] + wheels[1] * wheels[1]))
        way = speed * (1.0 / gamma + plant.lag + 2.0 * plant.dt) + 0.5 * speed * speed / plant.acceleration
        farthest = (radius + 2.0 * offset + way) / max(1.0 - p.spacing, 0.1)
        count = find_hits(p, scan, seen, m, i, farthest, radius, points, 0.0)
        for j in range(count):
            distance = math.sqrt(points[j, 0] * points[j, 0] + points[j, 1] * points[j, 1])
            points[j, 2] = min(radius + p.spacing * distance, distance)
        ahead = led_to(plant.lag, plant.lag + 0.5 * plant.dt, m.command, wheels)
        gap_rows(plant, points[:count], ahead, offset, gamma, rows)
        n = AROUND
        for j in range(blind.shape[0]):
            rows[n, 0] = -blind[j, 0]
            rows[n, 1] = -blind[j, 1] if plant.holonomic else 0.0
            rows[n, 2] = 0.0
            n += 1
        n = wheel_rows(plant, w, rows, n)
        if plant.holonomic:
            vx, vy, there = nearest_allowed(rows[:n], vx, vy, 1.0)
        else:
            vx, w, there = nearest_allowed(rows[:n], vx, w, p.turn_weight)
        if not there:
            vx = 0.0
            vy = 0.0
            w = 0.0
            m.braked += 1
        twists[i, 0], twists[i, 1], twists[i, 2] = vx, vy, w
        set_command(plant, m.command, vx, vy, w)


@inlined
def gap_rows(plant, hits, ahead, offset, gamma, rows):
    """Fills the first AROUND rows (a, b, c) of a . u >= c: of each sector the hit that asks for most.

    u is (v, w), of omni bases (v_x, v_y).

    Args:
        hits: (n, 3) m, body frame now, and the distance that the robot's middle has to keep.
        ahead: of `led_to`.
    """
    x, y, turn, vx, vy, w = ahead
    sine, cosine = sin_cos(turn)
    for k in range(AROUND):
        rows[k, 0], rows[k, 1], rows[k, 2] = 0.0, 0.0, -math.inf
    for j in range(hits.shape[0]):
        px, py = to_body_frame(x, y, sine, cosine, hits[j, 0], hits[j, 1])
        dx = offset - px
        dy = -py
        distance = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        a = dx / distance
        b = dy / distance if plant.holonomic else offset * dy / distance
        towards = max(0.0, -(a * vx + b * (vy if plant.holonomic else w)))
        gap = distance - offset - hits[j, 2] - 0.5 * towards * towards / plant.acceleration - towards * plant.dt
        k = int((bearing(dy, dx) / (2.0 * math.pi) + 0.5) * AROUND) % AROUND
        if -gamma * gap > rows[k, 2]:
            rows[k, 0], rows[k, 1], rows[k, 2] = a, b, -gamma * gap


@inlined
def wheel_rows(plant, w, rows, n):
    """Adds the rows of what wheels and driver can turn for; w (rad/s) is given where the base is omni."""
    for k in range(plant.num_wheels):
        a = plant.wheel_matrix[k, 0]
        b = plant.wheel_matrix[k, 1] if plant.holonomic else plant.wheel_matrix[k, 2]
        given = plant.wheel_matrix[k, 2] * w if plant.holonomic else 0.0
        for sign in (1.0, -1.0):
            rows[n, 0] = -sign * a
            rows[n, 1] = -sign * b
            rows[n, 2] = sign * given - plant.wheel_speed_limit
            n += 1
    if not plant.holonomic and plant.turn_speed < math.inf:
        for sign in (1.0, -1.0):
            rows[n, 0] = 0.0
            rows[n, 1] = -sign
            rows[n, 2] = -plant.turn_speed
            n += 1
    return n


@allocating
def nearest_allowed(rows, x, y, weight):
    """Returns the point nearest to (x, y) that keeps all rows, and whether there is one.

    It minimises dx^2 + weight dy^2: the point itself, its projection on the one row that holds it, or where two meet.

    Args:
        rows: (n, 3), a row is (a, b, c) of a x + b y >= c.
    """
    count = rows.shape[0]
    root = math.sqrt(weight)
    scaled = np.empty((count, 3))  # with unit normals, of the deviation (dx, root dy)
    n = 0
    for j in range(count):
        a = rows[j, 0]
        b = rows[j, 1] / root
        missing = rows[j, 2] - rows[j, 0] * x - rows[j, 1] * y
        length = math.sqrt(a * a + b * b)
        if length > 0.0:
            scaled[n, 0], scaled[n, 1], scaled[n, 2] = a / length, b / length, missing / length
            n += 1
        elif missing > EXACT:
            return x, y, False
    if keeps(scaled, n, 0.0, 0.0):
        return x, y, True
    for j in range(n):
        if scaled[j, 2] > 0.0:
            dx = scaled[j, 2] * scaled[j, 0]
            dy = scaled[j, 2] * scaled[j, 1]
            if keeps(scaled, n, dx, dy):
                return x + dx, y + dy / root, True
    least = math.inf
    best_x = 0.0
    best_y = 0.0
    for j in range(n):
        for k in range(j):
            cross = scaled[j, 0] * scaled[k, 1] - scaled[j, 1] * scaled[k, 0]
            if abs(cross) > 1e-12:
                dx = (scaled[j, 2] * scaled[k, 1] - scaled[k, 2] * scaled[j, 1]) / cross
                dy = (scaled[k, 2] * scaled[j, 0] - scaled[j, 2] * scaled[k, 0]) / cross
                squared = dx * dx + dy * dy
                if squared < least and keeps(scaled, n, dx, dy):
                    least = squared
                    best_x = dx
                    best_y = dy
    return x + best_x, y + best_y / root, least < math.inf


@inlined
def keeps(rows, n, x, y):
    """Returns whether a point keeps the first n rows."""
    inside = True
    for j in range(n):
        inside = inside and rows[j, 0] * x + rows[j, 1] * y >= rows[j, 2] - EXACT
    return inside
