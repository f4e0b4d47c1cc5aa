"""What a goal seeker's network sees on any base: what `GoalFeatures` has, in units of the robot, and its data sheet."""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.features import LIMIT, Array, Numbers, unchanged
from wayfield.policies.learned.features_goal import FULL, LEAST_BEAMS, GoalFeatures
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.shield import LEAST_VIEW

TOP = 0.95  # of the fastest that a base can drive or turn, that is asked of it
SHARPEST = 2.0  # rad/s, the most that an action turns

# What is told of a robot, in the order of the inputs, with what a network sees as 1.
SHEET: Mapping[str, float] = {
    "speed": 0.6,  # m/s, that is asked for
    "yaw_rate": 2.0,  # rad/s, of a full turn
    "hull": 0.25,  # m, radius
    "stopping_way": 0.25,  # m, from the asked speed
    "lag": 0.1,  # s
    "braking_time": 0.6,  # s, of the asked speed
    "turning_time": 0.6,  # s, in which a full turn is braked
    "beams": 72.0,  # a full turn, as dense as they stand
    "view": FULL,  # rad, field of view
    "range": 5.0,  # m
}


@dataclasses.dataclass(frozen=True)
class SheetFeatures(GoalFeatures):
    """Of a goal seeker on any base of a kinematic class: the numbers of `GoalFeatures`, in units of the robot.

    `of` makes them for a robot. The ways ahead are measured for its own hull. Speeds are seen in proportion to the one
    asked for, yaw rates to the fastest turn (0.95 of what the base can, at most 2 rad/s). The nearness of what is hit
    is one half at hull + range_scale; that of the ways ahead at the hull and the way on which the base stops from the
    asked speed, v tau + v^2 / (2 a). The points that trail behind keep their distances in metres, `trails` times
    0.6 m/s, for that is the scale of worlds and not of robots. Beside these stand the numbers of SHEET.

    A scan of any count over half a turn or more is read as one of `num_beams` all around: of each direction the least
    of the beams nearer to it than half a step, or the nearest; what no beam looks at reads as free.
    """

    trails: tuple[float, ...] = gain((1.0, 4.0, 12.0), "s", "of points that trail behind", words="a,b,... > 0")
    frame: Literal["goal", "body"] = gain("body", "", "in which the scan and the action are meant")
    range_scale: float = gain(0.25, "m", "beside the hull, at which nearness is one half", above=0.0)
    limits: bool = gain(True, "", "whether the numbers of the data sheet are seen")
    moving: bool = gain(True, "", "whether what comes nearer by itself is seen")

    shielded: ClassVar[bool | Literal["always"]] = "always"
    sheet_inputs: ClassVar[int] = len(SHEET)

    def check(self, briefing: Briefing) -> None:
        """Raises ValueError unless the robots have a scan that can be read."""
        angles = briefing.beam_angles
        view = viewed(angles)
        if len(angles) < LEAST_BEAMS or view < LEAST_VIEW:
            raise ValueError(
                f"needs a scan of at least {LEAST_BEAMS} beams over {math.degrees(LEAST_VIEW):.0f} degrees or more, "
                f"got {len(angles)} over {math.degrees(view):.0f} degrees"
            )

    def of(self, briefing: Briefing, speed: float) -> "RobotFeatures":
        """Returns the features of a robot, asked for a speed (m/s)."""
        sheet = numbers_of(briefing, speed)
        gains = {name: getattr(self, name) for name in (field.name for field in dataclasses.fields(self))}
        return RobotFeatures(
            **gains
            | {
                "hull_radius": sheet["hull"],
                "max_range": self.max_range,
                "range_scale": sheet["hull"] + self.range_scale,
                "distance_scale": 2.0 * (sheet["hull"] + sheet["stopping_way"]),
                "speed_scale": sheet["speed"],
                "yaw_scale": sheet["yaw_rate"],
                "trails": tuple(each * SHEET["speed"] / sheet["speed"] for each in self.trails),
                "way_scale": sheet["hull"] + max(sheet["stopping_way"], 0.1),
                "sheet": tuple(min(sheet[name] / one, LIMIT) for name, one in SHEET.items()),
                "own_range": briefing.max_range,
                "angles": tuple(briefing.beam_angles.tolist()),
            }
        )

    guarded = unchanged  # the shield is behind them, on every robot


@dataclasses.dataclass(frozen=True)
class RobotFeatures(SheetFeatures):
    """Those of `SheetFeatures` for one robot."""

    way_scale: float = gain(0.5, "m", "at which the nearness of the ways ahead is one half", above=0.0)
    own_range: float = gain(5.0, "m", "what a beam reads that meets nothing", above=0.0)
    sheet: tuple[float, ...] = ()
    angles: tuple[float, ...] = ()  # rad, of the beams

    @functools.cached_property
    def numbers(self) -> Numbers:
        """Returns what is told of the robot, in the order of SHEET."""
        return np.array(self.sheet, np.float32)

    @functools.cached_property
    def windows(self) -> tuple[Array, Array]:
        """Returns the beams of each direction (num_beams, w), and whether any looks there (num_beams,)."""
        return windows(np.array(self.angles), self.num_beams)

    def read(self, ranges: Array) -> Array:
        """Returns a scan (b, beams) as that of the directions that are known, (b, num_beams), m."""
        beams, looked = self.windows
        least = ranges[:, beams].min(axis=2)
        nothing = np.logical_not(looked) | (least >= (1.0 - 1e-6) * self.own_range)
        return np.where(nothing, self.max_range, np.minimum(least, self.max_range))

    def observe(self, observation: goal_reaching.Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in, rad."""
        angles = super().observe(observation, speeds, out)
        ahead = out[:, -(self.num_beams // self.pool) :]
        # s / (s + d) becomes w / (w + d)
        near = self.way_scale * ahead
        ahead[:] = near / (near + self.range_scale * (1.0 - ahead))
        return angles


def viewed(angles: Array) -> float:
    """Returns the field of view (rad) of a scan, half a step to either side of it included."""
    return min(float(angles[-1] - angles[0] + angles[1] - angles[0]), FULL) if len(angles) > 1 else 0.0


def numbers_of(briefing: Briefing, speed: float) -> dict[str, float]:
    """Returns the numbers of SHEET, in their units, of a robot that is asked for a speed (m/s)."""
    robot, actuators, angles = briefing.robot, briefing.actuators, briefing.beam_angles
    acceleration, yaw_acceleration = actuators.surely
    v = min(speed, TOP * float(robot.max_twist[0]))
    w = min(SHARPEST, TOP * float(robot.max_twist[-1]))
    view = viewed(angles)
    return {
        "speed": v,
        "yaw_rate": w,
        "hull": robot.hull_radius,
        "stopping_way": v * actuators.reaction + 0.5 * v * v / acceleration,
        "lag": actuators.reaction,
        "braking_time": v / acceleration,
        "turning_time": w / yaw_acceleration,
        "beams": len(angles) * FULL / view if view else 0.0,
        "view": view,
        "range": briefing.max_range,
    }


def windows(angles: Array, count: int) -> tuple[Array, Array]:
    """Returns of `count` directions once around, from the back on, the beams (count, w) that are read for each.

    Those nearer than half a step of the sparser of the two, the nearest at least; and whether a beam looks there: the
    nearest is no farther than a step of the scan.
    """
    step = FULL / count
    spacing = float(angles[1] - angles[0])
    away = np.abs((angles[None, :] - (np.arange(count) * step - math.pi)[:, None] + math.pi) % FULL - math.pi)
    nearest = away.argmin(axis=1)
    inside = away <= 0.5 * step + 1e-9
    width = max(int(inside.sum(axis=1).max()), 1)
    beams = np.repeat(nearest[:, None], width, axis=1)
    for j in range(count):
        own = np.flatnonzero(inside[j])
        beams[j, : len(own)] = own
    return beams, away.min(axis=1) <= max(spacing, 0.5 * step) + 1e-9
