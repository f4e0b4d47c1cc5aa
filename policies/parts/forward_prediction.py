"""Delay compensation: a law decides from the state that its command will meet, not from the one that was measured.

A base with a delay d does at t + d what it is sent at t. Until then it does what it was sent before, which is known.
The state of t + d is predicted by the base's own response (`response`: delay and gain of each axis, accelerations and
decelerations, wheels that saturate, lag of each axis) to the commands of the last d seconds, from the measured pose and
twist. The law then finds a base without a delay, in all that it predicts and in all that it remembers.

Where axes differ, it is the slowest one's delay; the others keep the last command for the difference. A base that ramps
within the control period is predicted half a period farther, at a held reference: so long its ramp is behind the steps
that laws predict by.

Sources: Smith, Chemical Engineering Progress 53, 1957; Artstein, IEEE Trans. Automatic Control 27(4), 1982.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.path_following import project
from wayfield.envs.robots import Actuators
from wayfield.envs.robots.kinematics import integrate_arc, limit_acceleration, saturated, to_body_frame
from wayfield.envs.robots.records import MAX_WHEELS, delay_periods, motor_numbers, num_requests, record
from wayfield.envs.robots.response import request, respond
from wayfield.envs.robots.sensing import beam_directions
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.paths import walk_to
from wayfield.policies.parts.carrot import place_on_lap
from wayfield.policies.parts.lead import AIM, read_ahead
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

Array = NDArray[np.float64]

WINDOW = 1.0  # m, of a path, that the predicted place on it is looked for in

# As `response` reads it.
MODEL = [
    ("dt", np.float64),
    ("num_wheels", np.int64),
    ("wheel_matrix", np.float64, (MAX_WHEELS, 3)),
    ("forward_matrix", np.float64, (3, MAX_WHEELS)),
    ("wheel_speed_limit", np.float64),
    ("turn_speed", np.float64),
    ("turning_radius", np.float64),
    ("acceleration", np.float64),
    ("yaw_acceleration", np.float64),
    ("responds", np.int64),
    ("continuous", np.int64),
    ("wheel_saturation", np.int64),
    ("delay_periods", np.int64, (3,)),
    ("delay_rest", np.float64, (3,)),
    ("gains", np.float64, (3,)),
    ("lags", np.float64, (3,)),
    ("deceleration", np.float64),
    ("yaw_deceleration", np.float64),
    ("requests", np.int64),
    ("periods", np.int64),  # of the slowest axis' delay
    ("rest", np.float64),  # s
]
STATE = np.dtype(
    [
        ("command_vx", np.float64),
        ("command_vy", np.float64),
        ("command_yaw_rate", np.float64),
        ("wheel_vx", np.float64),
        ("wheel_vy", np.float64),
        ("wheel_yaw_rate", np.float64),
        ("saturated", np.int64),
        ("set_vx", np.float64),  # the reference as laws know it: with the accelerations that the base has both ways
        ("set_vy", np.float64),
        ("set_yaw_rate", np.float64),
    ],
    align=True,
)


def undelayed(actuators: Actuators) -> Actuators:
    """Returns the actuators that a law finds where its observations are predicted and its commands compensated."""
    assert actuators.response is not None
    none, one = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    response = dataclasses.replace(actuators.response, delays=none, gains=one, wheel_saturation=False)
    return dataclasses.replace(actuators, response=response)


class ForwardPrediction:
    """What b robots were sent within their delay, and what they will observe when the next command acts.

    Args:
        briefing: of the episodes, kept as `episodes`; where it holds paths, what is observed of them is predicted too.
        preview_spacing: m, between the points of a follower's preview.
    """

    def __init__(self, briefing: Briefing, preview_spacing: float = 0.0) -> None:
        actuators, robot = briefing.actuators, briefing.robot
        numbers = motor_numbers(robot, actuators, briefing.dt)
        periods, rest = max(delay_periods(actuators.response, briefing.dt))
        numbers |= {"requests": 0, "periods": periods, "rest": rest}
        self._model = record(MODEL, {str(name): numbers[str(name)] for name, *_ in MODEL})
        self._axes = list(robot.twist_axes)
        self._spacing = preview_spacing
        # s, until the next command acts
        self._late = periods * briefing.dt + rest + (0.5 * briefing.dt if self._model["continuous"][0] else 0.0)
        self._joined = 2.0 * robot.hull_radius
        self._states = np.zeros(briefing.num_envs, STATE)
        self._sent = np.zeros((briefing.num_envs, 3 * (num_requests(actuators.response, briefing.dt) + 1)))
        self._scratch = np.zeros((1, self._sent.shape[1]))
        self.episodes = briefing

    @property
    def remembered(self) -> dict[str, NDArray[Any]]:
        """Returns what decides the predictions beside what is observed, robot by robot."""
        return {"states": self._states, "sent": self._sent}

    def keep(self, rows: NDArray[Any]) -> None:
        """Goes on with some of the robots alone."""
        self._states, self._sent, self.episodes = self._states[rows], self._sent[rows], self.episodes.part(rows)

    def reset(self, rows: Any = slice(None)) -> None:
        """Forgets what some robots were sent: they stand."""
        self._states[rows] = np.zeros((), STATE)
        self._sent[rows] = 0.0

    def observed(self, observation: NDArray[Any]) -> Array:
        """Returns the flat observations (b, n) of the time at which the next command acts.

        Obstacles and other bodies stay where they were seen. A scan is turned and moved: hits of neighbouring beams
        that the hull cannot pass between are joined, others are as wide as their beams.
        """
        episodes = self.episodes
        moved = np.array(observation, np.float64)
        fields = episodes.layout.unpack(moved)
        twists = np.zeros((len(moved), 3))
        twists[:, self._axes] = fields.twist
        steps = np.empty((len(moved), 3))
        look_ahead(self._model, self._states, self._sent, self._scratch, twists, steps)
        fields.twist[:] = twists[:, self._axes]
        move(steps, fields.pose)
        if hasattr(fields, "cross_track_error"):
            follow(
                episodes.path,
                self._spacing,
                fields.pose,
                fields.arc_length,
                fields.cross_track_error,
                fields.heading_error,
                fields.preview,
            )
            return moved
        if hasattr(fields, "reference_twist"):
            seen = episodes.layout.unpack(np.array(observation, np.float64))
            before, behind = ((each.error, each.reference_twist, each.preview) for each in (seen, fields))
            view_reference(self._late, episodes.preview_spacing, steps, np.zeros(1, AIM), *before, *behind)
            return moved
        view(steps, fields.goal, fields.goal_heading_error)
        if hasattr(fields, "bodies"):
            fields.bodies[..., :2] = _seen_from(steps[:, None], fields.bodies[..., :2])
            turned = np.concatenate([np.zeros((len(steps), 2)), steps[:, 2:]], axis=1)
            fields.bodies[..., 2:4] = _seen_from(turned[:, None], fields.bodies[..., 2:4])
            fields.bodies[fields.bodies[..., 6] == 0.0] = 0.0
        if fields.ranges.shape[1] > 1:
            angles = episodes.beam_angles
            most = np.float64(episodes.max_range)
            step = float(angles[1] - angles[0])
            closed = bool(2.0 * math.pi - (angles[-1] - angles[0]) < 1.5 * step)
            beams = beam_directions(angles)
            scan = fields.ranges.copy()  # the new one is written over it
            rescan(beams, float(angles[0]), step, closed, most, self._joined, steps, scan, fields.ranges)
        return moved

    def requested(self, twists: Array) -> Array:
        """Returns what to send (b, t) so that bases set twists (b, t): cut to what wheels can turn, free of gains.

        Laws predict with the accelerations that a base has both ways. One that brakes worse than it speeds up is not
        sent more than that: it would be faster than laws believe.
        """
        whole = np.zeros((len(twists), 3))
        whole[:, self._axes] = twists
        compensate(self._model, self._states, whole)
        return whole[:, self._axes]

    def sent(self, twists: Array) -> None:
        """Takes note of what was sent (b, t)."""
        whole = np.zeros((len(twists), 3))
        whole[:, self._axes] = twists
        advance(self._model, self._states, self._sent, whole)


def _seen_from(steps: Array, points: Array) -> Array:
    """Returns points (..., 2), m, in the frames that steps (..., 3) lead to."""
    c, s = np.cos(steps[..., 2]), np.sin(steps[..., 2])
    dx, dy = points[..., 0] - steps[..., 0], points[..., 1] - steps[..., 1]
    return np.stack([c * dx + s * dy, c * dy - s * dx], axis=-1)


@inlined
def gone(p, s, sent, i, pose, begin, end):
    """Returns the pose (x, y, heading) after a part of a control period."""
    x, y, heading = pose
    vx, vy, yaw_rate = respond(p, s, sent, i, begin, end)
    return integrate_arc(x, y, heading, vx, vy, yaw_rate, end - begin)


@compiled
def look_ahead(model, states, sent, scratch, twists, steps):
    """Moves twists (b, 3) on to the time at which the next command acts; fills the ways there (b, 3) in body frames."""
    p = model[0]
    for i in range(states.shape[0]):
        s = states[i]
        vx = s.command_vx
        vy = s.command_vy
        yaw_rate = s.command_yaw_rate
        for k in range(sent.shape[1]):
            scratch[0, k] = sent[i, k]
        s.wheel_vx = twists[i, 0]
        s.wheel_vy = twists[i, 1]
        s.wheel_yaw_rate = twists[i, 2]
        pose = 0.0, 0.0, 0.0
        for _ in range(p.periods):
            request(p, s, scratch, 0, sent[i, 0], sent[i, 1], sent[i, 2])
            pose = gone(p, s, scratch, 0, pose, 0.0, p.dt)
        if p.rest > 0.0:
            request(p, s, scratch, 0, sent[i, 0], sent[i, 1], sent[i, 2])
            pose = gone(p, s, scratch, 0, pose, 0.0, p.rest)
        if p.continuous:
            # half a period at a held reference
            for k in range(0, scratch.shape[1], 3):
                scratch[0, k] = s.command_vx / p.gains[0]
                scratch[0, k + 1] = s.command_vy / p.gains[1]
                scratch[0, k + 2] = s.command_yaw_rate / p.gains[2]
            pose = gone(p, s, scratch, 0, pose, 0.0, 0.5 * p.dt)
        steps[i, 0], steps[i, 1], steps[i, 2] = pose
        twists[i, 0] = s.wheel_vx
        twists[i, 1] = s.wheel_vy
        twists[i, 2] = s.wheel_yaw_rate
        s.command_vx = vx
        s.command_vy = vy
        s.command_yaw_rate = yaw_rate


@any_layout
@compiled
def move(steps, poses):
    """Moves poses (b, 3) on by steps (b, 3) in their frames."""
    for i in range(steps.shape[0]):
        sine, cosine = sin_cos(poses[i, 2])
        poses[i, 0] += cosine * steps[i, 0] - sine * steps[i, 1]
        poses[i, 1] += sine * steps[i, 0] + cosine * steps[i, 1]
        poses[i, 2] = wrap_angle(poses[i, 2] + steps[i, 2])


@any_layout
@compiled
def view(steps, goals, turns):
    """Turns goals (b, 2) and turns to their headings (b,) into those seen after steps (b, 3)."""
    for i in range(steps.shape[0]):
        sine, cosine = sin_cos(steps[i, 2])
        goals[i, 0], goals[i, 1] = to_body_frame(steps[i, 0], steps[i, 1], sine, cosine, goals[i, 0], goals[i, 1])
        turns[i] = wrap_angle(turns[i] - steps[i, 2])


@any_layout
@compiled
def view_reference(late, spacing, steps, aims, seen, seen_twists, seen_ahead, errors, twists, ahead):
    """Fills what robots will observe of their references `late` s on, after steps (b, 3), of what they observe now.

    Beyond the last sample a reference goes on by its twist there.
    """
    aim = aims[0]
    last = twists.shape[1] - 1
    most = ahead.shape[1] * spacing
    for i in range(steps.shape[0]):
        sine, cosine = sin_cos(steps[i, 2])
        for j in range(ahead.shape[1] + 1):
            at = j * spacing + late
            read_ahead(seen, seen_twists, seen_ahead, i, min(at, most), spacing, aim)
            x, y, turn = aim.x, aim.y, aim.turn
            if at > most:
                x, y, turn = integrate_arc(x, y, turn, aim.vx, aim.vy if last == 2 else 0.0, aim.yaw_rate, at - most)
            x, y = to_body_frame(steps[i, 0], steps[i, 1], sine, cosine, x, y)
            pose = x, y, wrap_angle(turn - steps[i, 2])
            for c in range(3):
                if j == 0:
                    errors[i, c] = pose[c]
                else:
                    ahead[i, j - 1, c] = pose[c]
            for c in range(last + 1):
                v = aim.yaw_rate if c == last else aim.vx if c == 0 else aim.vy
                if j == 0:
                    twists[i, c] = v
                else:
                    ahead[i, j - 1, 3 + c] = v


@compiled
def compensate(model, states, twists):
    """Turns the twists (b, 3) that bases shall set into those that they are sent."""
    p = model[0]
    for i in range(twists.shape[0]):
        s = states[i]
        vx, vy, yaw_rate = saturated(p, twists[i, 0], twists[i, 1], twists[i, 2])
        s.set_vx, s.set_vy, s.set_yaw_rate = limit_acceleration(
            (s.set_vx, s.set_vy, s.set_yaw_rate),
            (vx, vy, yaw_rate),
            min(p.acceleration, p.deceleration),
            min(p.yaw_acceleration, p.yaw_deceleration),
            p.dt,
        )
        if p.deceleration < p.acceleration:
            vx = s.set_vx
            vy = s.set_vy
        if p.yaw_deceleration < p.yaw_acceleration:
            yaw_rate = s.set_yaw_rate
        twists[i, 0] = vx / p.gains[0]
        twists[i, 1] = vy / p.gains[1]
        twists[i, 2] = yaw_rate / p.gains[2]


@compiled
def advance(model, states, sent, twists):
    """Moves the references of bases on by a control period, at the beginning of which they are sent twists (b, 3)."""
    p = model[0]
    for i in range(states.shape[0]):
        s = states[i]
        request(p, s, sent, i, twists[i, 0], twists[i, 1], twists[i, 2])
        respond(p, s, sent, i, 0.0, p.dt)


@any_layout
@compiled
def follow(course, spacing, poses, arc_lengths, errors, heading_errors, preview):
    """Fills what path followers observe at their poses (b, 3), from their places on the path before."""
    vertices, runs, path_index = course
    for i in range(path_index.shape[0]):
        run = runs[path_index[i]]
        x = poses[i, 0]
        y = poses[i, 1]
        heading = poses[i, 2]
        along, segment = place_on_lap(vertices, run, arc_lengths[i])
        laps = arc_lengths[i] - along
        s, segment, errors[i], heading_errors[i] = project(vertices, run, WINDOW, x, y, heading, along, segment)
        arc_lengths[i] = laps + s
        sine, cosine = sin_cos(heading)
        ahead, segment = place_on_lap(vertices, run, arc_lengths[i])
        for k in range(preview.shape[1]):
            ahead += spacing
            px, py, ahead, segment = walk_to(vertices, run, ahead, segment)
            preview[i, k, 0], preview[i, k, 1] = to_body_frame(x, y, sine, cosine, px, py)


@inlined
def enter(first, step, closed, out, i, ax, ay, bx, by):
    """Shortens the beams that meet the line from a to b."""
    n = out.shape[1]
    begin = bearing(ay, ax)
    turn = wrap_angle(bearing(by, bx) - begin)
    low = min(begin, begin + turn) - first
    if closed:
        low -= 2.0 * math.pi * math.floor(low / (2.0 * math.pi))
    k = math.ceil(low / step - 1e-9)
    last = math.floor((low + abs(turn)) / step + 1e-9)
    dx = bx - ax
    dy = by - ay
    while k <= last:
        j = k % n if closed else k
        if 0 <= j < n:
            sine, cosine = sin_cos(first + j * step)
            across = cosine * dy - sine * dx
            distance = math.sqrt(min(ax * ax + ay * ay, bx * bx + by * by))
            if abs(across) > 1e-9:
                distance = max(distance - math.sqrt(dx * dx + dy * dy), (ax * dy - ay * dx) / across)
            out[i, j] = min(out[i, j], distance)
        k += 1


@any_layout
@compiled
def rescan(beams, first, step, closed, most, joined, steps, scan, out):
    """Fills the scans (b, n) that would be seen after the steps (b, 3), of those seen before them."""
    n = scan.shape[1]
    reach = (1.0 - 1e-6) * most
    half_sine, half_cosine = sin_cos(0.5 * min(step, 1.0))
    half = half_sine / half_cosine
    for i in range(scan.shape[0]):
        for k in range(n):
            out[i, k] = most
        sine, cosine = sin_cos(steps[i, 2])
        for j in range(n):
            distance = scan[i, j]
            if not distance < reach:
                continue
            hx = distance * beams[j, 0]
            hy = distance * beams[j, 1]
            ax, ay = to_body_frame(steps[i, 0], steps[i, 1], sine, cosine, hx, hy)
            # on each side up to the neighbour's hit, or as far as the beam is its own
            for side in range(2):
                k = j + 1 if side == 1 else j - 1
                if closed:
                    k = (k + n) % n
                if 0 <= k < n and scan[i, k] < reach:
                    nx = scan[i, k] * beams[k, 0]
                    ny = scan[i, k] * beams[k, 1]
                    if (nx - hx) * (nx - hx) + (ny - hy) * (ny - hy) < joined * joined:
                        if side == 1:
                            bx, by = to_body_frame(steps[i, 0], steps[i, 1], sine, cosine, nx, ny)
                            enter(first, step, closed, out, i, ax, ay, bx, by)
                        continue
                aside = distance * half if side == 1 else -distance * half
                bx, by = to_body_frame(
                    steps[i, 0], steps[i, 1], sine, cosine, hx - aside * beams[j, 1], hy + aside * beams[j, 0]
                )
                enter(first, step, closed, out, i, ax, ay, bx, by)
