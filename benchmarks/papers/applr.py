"""The authors' own network, which sets the gains of a local planner every second, beats fixed gains."""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.contests import PUBLIC_SPLIT, Course
from wayfield.benchmarks.contests.barn import ANGLE, BEAMS, RANGE
from wayfield.benchmarks.papers.claim import DATA, Claim, Gate, Printed, Side, drive
from wayfield.benchmarks.papers.networks import Array, together
from wayfield.benchmarks.papers.search import searched
from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies.parts.stopping import Scan, Seen
from wayfield.policies.scans.costmap import inflated
from wayfield.policies.scans.nav2_dwb import Nav2Dwb
from wayfield.system.reading import read_arrays

# What the network sets, from and to, and where it begins: the authors' numbers. Of distances they weigh metres, DWB
# half cells of its local costmap: twice as much is the same.
RANGES: Mapping[str, tuple[float, float]] = {
    "max_speed": (0.2, 2.0),
    "max_yaw_rate": (0.314, 3.14),
    "speeds": (4, 12),
    "turns": (8, 40),
    "path_distance": (0.2, 3.0),
    "goal_distance": (0.2, 4.0),
    "inflation_radius": (0.1, 0.6),
}
FIRST = {"max_speed": 0.5, "max_yaw_rate": 1.57, "speeds": 6, "turns": 20, "path_distance": 1.5, "goal_distance": 2.0}
FIRST |= {"inflation_radius": 0.3}
WHOLE = ("speeds", "turns")
# all else of their planner: weights of obstacles and of what it does not have, its time ahead and its accelerations
PLANNER: dict[str, Any]
PLANNER = {"obstacle": 0.005, "path_align": 0.0, "goal_align": 0.0, "horizon": 2.0, "cost_scaling": 10.0}
PLANNER |= {"acceleration": 10.0, "yaw_acceleration": 20.0}
WEIGHTS = "applr.safetensors"
HELD, SEEN, AHEAD = 20, 2.0, 1.0  # control periods; m, to which ranges are cut; m, of the point of the plan it sees
STEPS = 1600  # control periods, the time limit
# the worlds that their network was not trained in, and the first of those that it was, in its configuration's order
UNSEEN: tuple[int, ...]
UNSEEN = (0, 8, 17, 19, 27, 32, 41, 47, 48, 57, 64, 69, 76, 78, 88, 93, 100, 104, 112, 118, 123, 129, 133, 138, 144)
UNSEEN += (150, 159, 163, 168, 175, 184, 189, 193, 201, 208, 214, 218, 226, 229, 237, 240, 246, 256, 258, 265, 270)
UNSEEN += (277, 284, 290, 294)
TRAINING = (54, 94, 156, 68, 52, 101, 40, 135, 51, 42, 75, 67, 18, 53, 87, 36, 28, 61, 233, 25, 35, 20, 34, 79)
SETS, FINALISTS = 16, 2  # of the search: tried in half of TRAINING, and in all
LAYERS = ("head.mlp.0", "head.mlp.2", "fc")  # as the authors' state_dict names them


@dataclasses.dataclass(frozen=True)
class Applr:
    """Nav2's DWB by gains that the authors' network sets every second.

    It sees 720 ranges over 270 degrees, cut at 2 m, and the bearing of the plan's first point more than 1 m away.

    Args:
        folder: of the network, `applr.safetensors`.
    """

    folder: str = ""

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def __post_init__(self) -> None:
        network(self.folder)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the gains, for how long they have held, and what DWB remembers (b,).

        Raises:
            ValueError: if the scan has another number of beams.
        """
        if len(briefing.beam_angles) != BEAMS:
            raise ValueError(f"the network reads {BEAMS} beams, not {len(briefing.beam_angles)}")
        robots = briefing.num_envs
        mine = {"held": np.zeros(robots, np.int64), "gains": np.zeros((robots, len(RANGES)))}
        return together({**mine, "dwb": LAW.reset(briefing)})

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, 2), m/s and rad/s."""
        parts = memory["dwb"].copy()
        due = np.flatnonzero(memory["held"] % HELD == 0)
        if len(due):
            bearings = np.array([bearing(observation, parts["state"], i) for i in due.tolist()])
            memory["gains"][due] = chosen(self.folder, observation.ranges[due], bearings)
        memory["held"] += 1
        maps, seen, p = LAW.maps(briefing), Seen.of(observation, briefing), LAW.given(briefing).copy()
        scan = Scan.of(LAW, observation, briefing, parts)
        for i, gains in enumerate(memory["gains"].tolist()):
            p.setflags(write=True)
            for name, value in zip(RANGES, gains, strict=True):
                p[name] = value
            p.setflags(write=False)  # as DWB has it: another kind of array would be compiled anew
            one = parts[i : i + 1]
            costs = costs_of(briefing.robot.hull_radius, gains[-1])
            mine = scan._replace(ranges=scan.ranges[i : i + 1], older=one["older"], newer=one["newer"])
            LAW.decide(p, maps._replace(costs=costs), mine, Seen(*(each[i : i + 1] for each in seen)), one["state"])
        memory["dwb"] = parts
        return np.asarray(parts["state"]["command"][:, list(briefing.robot.twist_axes)])


# its maps and records serve the greatest inflation radius; the gains that the network sets take the place of its own
LAW = Nav2Dwb(**PLANNER, inflation_radius=RANGES["inflation_radius"][1])


@functools.lru_cache(maxsize=64)
def costs_of(radius: float, inflation: float) -> Array:
    """Returns `costmap.inflated` for the planner's scaling."""
    return inflated(radius, inflation, LAW.cost_scaling)


@functools.lru_cache(maxsize=4)
def network(folder: str) -> list[tuple[Array, Array]]:
    """Returns the layers (matrix, bias) of the authors' network.

    Raises:
        ValueError: if there is no such file, or it holds another network.
    """
    file = Path(folder) / WEIGHTS
    arrays, _ = read_arrays(file)
    parts = [arrays[f"{name}.{part}"] for name in LAYERS for part in ("weight", "bias") if f"{name}.{part}" in arrays]
    shapes = [(512, BEAMS + 1), (512,), (512, 512), (512,), (len(RANGES), 512), (len(RANGES),)]
    if [each.shape for each in parts] != shapes:
        there = ", ".join(f"{name} {each.shape}" for name, each in list(arrays.items())[:3])
        raise ValueError(f"{file} must have head.mlp.0.weight {shapes[0]} to fc.bias {shapes[-1]}, got {there}")
    return [
        (each.astype(np.float64), bias.astype(np.float64)) for each, bias in zip(parts[::2], parts[1::2], strict=True)
    ]


def chosen(folder: str, ranges: Array, bearings: Array) -> Array:
    """Returns the gains (b, 7) that the network sets, by RANGES."""
    seen = np.column_stack([(np.minimum(ranges, SEEN) - 0.5 * SEEN) / SEEN, bearings / (2.0 * np.pi)])
    *hidden, (last, offset) = network(folder)
    for matrix, bias in hidden:
        seen = np.maximum(seen @ matrix.T + bias, 0.0)
    low, high = np.array(list(RANGES.values()), float).T
    gains = np.clip(0.5 * (low + high) + 0.5 * (high - low) * np.tanh(seen @ last.T + offset), low, high).round(2)
    whole = [k for k, name in enumerate(RANGES) if name in WHOLE]
    gains[:, whole] = np.floor(gains[:, whole])
    return np.asarray(gains)


def bearing(observation: Any, states: NDArray[Any], i: int) -> float:
    """Returns the bearing (rad) of the first point of robot i's plan that is more than AHEAD away; else of the goal."""
    x, y, heading = observation.pose[i]
    points = states["points"][i, : states["num_points"][i]]
    if len(points) > 1:
        lengths = np.maximum(np.ceil(np.linalg.norm(np.diff(points, axis=0), axis=1) / 0.05).astype(int), 1)
        at = np.concatenate([k + np.arange(n) / n for k, n in enumerate(lengths)] + [[float(len(lengths))]])
        dense = np.column_stack([np.interp(at, np.arange(len(points)), column) for column in points.T])
        away = np.linalg.norm(dense - (x, y), axis=1)
        ahead = np.flatnonzero(away[away.argmin() :] > AHEAD)
        to = dense[away.argmin() + ahead[0]] if len(ahead) else dense[-1]
        return float((np.arctan2(to[1] - y, to[0] - x) - heading + np.pi) % (2.0 * np.pi) - np.pi)
    return float(np.arctan2(observation.goal[i, 1], observation.goal[i, 0]))


def fixed(gains: Mapping[str, float]) -> str:
    """Returns the planner with fixed gains, as `--policy` takes it."""
    every = {**PLANNER, **{name: int(value) if name in WHOLE else value for name, value in gains.items()}}
    return f"{Nav2Dwb.__module__}:{Nav2Dwb.__name__} {' '.join(f'{name}={value}' for name, value in every.items())}"


def searched_set(home: Path) -> tuple[dict[str, float], float, int]:
    """Returns fixed gains, their mean time (s) in training worlds, and the control periods driven: the search."""
    driven = []

    def score(gains: Mapping[str, float], worlds: int = len(TRAINING) // 2) -> float:
        alone = dataclasses.replace(CLAIM, agent=Side("", fixed(gains)), untuned=None, tuned=None, beside=None)
        alone = dataclasses.replace(alone, course=dataclasses.replace(COURSE, members=TRAINING))
        times = [float(row["cost"]) for row in drive(alone, worlds, home)]
        driven.append(sum(times) / CONTROL_PERIOD)
        return float(np.mean(times))

    finalists = searched(RANGES, score, SETS, FIRST, {**FIRST, **FASTEST})[:FINALISTS]
    times = [score(gains, len(TRAINING)) for gains in finalists]
    return finalists[int(np.argmin(times))], min(times), round(sum(driven))


FASTEST = {"max_speed": 2.0, "max_yaw_rate": 3.14}
SEARCHED = {"max_speed": 1.312, "max_yaw_rate": 2.044, "speeds": 8, "turns": 38, "path_distance": 2.109}
SEARCHED |= {"goal_distance": 1.566, "inflation_radius": 0.319}
COURSE = Course(
    "barn",
    PUBLIC_SPLIT,
    DATA,
    STEPS,
    {"num_beams": BEAMS, "field_of_view": ANGLE, "max_range": RANGE},
    members=UNSEEN,
)
CLAIM = Claim(
    name="applr",
    sentence="A network that sets a local planner's gains anew every second reaches goals sooner than fixed gains.",
    source="Xu et al.: APPLR, adaptive planner parameter learning from reinforcement, 2021, arXiv 2011.00397",
    printed=(
        Printed("against fixed gains, set by hand", "better, no table seen", "abstract"),
        Printed("those in the 50 worlds, 20 drives each", "94.2 %, 27.8 s", "data/dwa.txt of Daffan/ros_jackal"),
    ),
    setting="A Jackal with lagged actuators and 720 beams, at most 2 m/s, in the 50 of their 300 worlds in which their "
    "network was not trained.",
    differs=(
        "The network is the authors' own (data/param_policy of Daffan/ros_jackal), trained for another planner: theirs "
        "is TrajectoryPlannerROS below a global planner. Here it sets the same seven numbers of Nav2's DWB, which "
        "weighs the same distances, on the plan of `nav2_dwb`.",
        "There is no Gazebo. The start and the goal are those of the BARN challenge, and a goal counts from 1 m away.",
        "A contact ends a drive here, and a failure counts as 80 s. In their data a contact does not end a drive.",
        "Their fixed gains limit the speed to 0.5 m/s; their network may ask for 2.0 m/s. So (a) is also driven with "
        "the network's limits, as `beside`.",
        "We trained no such network: the paper's million decisions, for each of three seeds, take hours of a core.",
    ),
    would_change="Their planner and their simulator, in which (a) is slower than here; a network trained with this "
    "planner; more than one network.",
    contest="goal-obstacles",
    families=("barn",),
    robot="jackal",
    measure="time",
    agent=Side(
        "DWB, seven gains set by the authors' network every second",
        f"{__name__}:Applr folder={DATA}",
        budget="by the authors: TD3, a million decisions in 250 worlds",
    ),
    untuned=Side("DWB with the authors' fixed gains, at most 0.5 m/s and 1.57 rad/s", fixed(FIRST)),
    tuned=Side(
        "DWB, the same seven gains searched",
        fixed(SEARCHED),
        budget="16 sets in 12 training worlds, the best two in 24; 0.07 M control periods, 86 s of a core",
    ),
    beside=Side("(a), at most 2 m/s and 3.14 rad/s", fixed({**FIRST, **FASTEST})),
    gate=Gate(27.8, "the mean time of its successes in data/dwa.txt"),
    course=COURSE,
    scenes=len(UNSEEN),
    data="world_0.world to world_299.world and path_0.npy to path_299.npy of Daffan/ros_jackal, and its "
    "data/param_policy/policy_actor as applr.safetensors",
)
