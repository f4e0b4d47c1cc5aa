"""The contests: policies against each other on frozen test scenarios, in the order of their tables. Pure data.

Every policy meets the same scenarios, starts and disturbances. Gains called "default" are those of the policy's file,
"tuned" those that were found on the validation split (see `tune`), "paper" those that leave a controller what its paper
gives it: no memory of what is out of sight, no way around traps, nothing foreseen.
"""

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from wayfield import policies
from wayfield.benchmarks.cases import (
    DIFF_DRIVE_GOAL_REACHING,
    GOAL_REACHING,
    OMNI_PATH_FOLLOWING,
    PATH_FOLLOWING,
    Case,
)
from wayfield.envs.scenarios import splits
from wayfield.policies.agent import CARD, read_card
from wayfield.policies.ppo import shipped, trained

PATH_POLICIES = (
    *("lookahead_documented", "lookahead_retuned", "pure_pursuit", "regulated_pure_pursuit", "smooth_pose"),
    *("stanley", "lqr", "mpc", "ppo"),
)
GOAL_POLICIES = (
    *("apf_documented", "apf_corrected", "vfh_plus", "dwa", "mppi", "orca", "scan_planner", "astar_tracker"),
    "ppo",
)
TRAINED = ("ppo",)
GAINS_NAMES = ("default", "tuned", "paper", "best", "trained")
PAPER: Mapping[str, Mapping[str, float]] = {
    name: {"patience": math.inf, "recall": 0.0, "foresight": 0.0} for name in ("vfh_plus", "dwa")
}
TRANSFER_SPLIT = "validation"  # on which gains are tuned: the generalisation gap is the score here minus that on test


@dataclasses.dataclass(frozen=True)
class Contest:
    """A task's contest: who takes part, where, and what counts."""

    name: str
    title: str
    task: str  # of the splits
    env_ids: Mapping[str, str]  # by robot; the first is the default
    policies: tuple[str, ...]
    env_kwargs: Mapping[str, Any]
    max_episode_steps: int
    cost: str  # the metric by which two successes are compared; lower is better

    def cases(
        self,
        robot: str,
        family: str,
        split: str,
        names: Sequence[str],
        gains_names: Sequence[str] = ("default", "tuned", "paper"),
        disturbance: str = "none",
        speed: float | None = None,
        homes: Sequence[str] = (),
    ) -> Iterator[Case]:
        """Yields a case for each policy and each set of its gains, on all scenarios of a family's split.

        Trained agents have one set, "trained", whatever is asked for, and a case for each seed.

        Args:
            disturbance: a level of the ladder.
            speed: m/s, a cruising speed in place of the policy's own.
            homes: folders of training runs; those for the task and robot take part, a set each, called like its folder.
        """
        sets = {name: list(self.gain_sets(name, robot, gains_names)) for name in names}
        for home in homes:
            sets.setdefault("ppo", []).extend(self.own_sets(home, robot))
        for name, of_policy in sets.items():
            for gains_name, gains in of_policy:
                conditions = {"robot": robot} | ({} if disturbance == "none" else {"disturbance": disturbance})
                if speed is not None:
                    gains |= policies.cruising(name, gains, speed)
                yield Case(
                    self.name,
                    family,
                    self.env_ids[robot],
                    f"{family}/{split}",
                    name,
                    gains,
                    {**self.env_kwargs, **conditions},
                    self.max_episode_steps,
                    gains_name=gains_name,
                    speed=speed,
                    every_scenario=True,
                )

    def gain_sets(self, name: str, robot: str, gains_names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yields the sets of a policy's gains, each with its name."""
        if name in TRAINED:
            for seed in shipped(self.task, robot):
                yield "trained", {"seed": seed}
            return
        tuned = policies.tuned_gains(name, self.name)
        if "default" in gains_names or ("best" in gains_names and not tuned):
            yield "default", {}
        if tuned and ("tuned" in gains_names or "best" in gains_names):
            yield "tuned", tuned
        if name in PAPER and "paper" in gains_names:
            yield "paper", dict(PAPER[name])

    def own_sets(self, home: str, robot: str) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yields the agents in a folder of training runs, if they are for the task and the robot.

        Raises:
            ValueError: if there are none at all, or a card is damaged.
        """
        runs = trained(home)
        if not runs:
            raise ValueError(f"{home!r} holds no trained agents: no seed_N{os.sep}best")
        for seed, folder in runs.items():
            card = read_card(folder / CARD)
            if card["task"] == self.task and robot in card["robots"]:
                yield Path(home).resolve().name, {"seed": seed, "home": home}


CONTESTS = {
    contest.name: contest
    for contest in (
        Contest(
            "path-following",
            "Path following",
            "path_following",
            {"p3dx": PATH_FOLLOWING, "omni3": OMNI_PATH_FOLLOWING, "omni4": OMNI_PATH_FOLLOWING},
            PATH_POLICIES,
            {},
            2400,
            "cross_track_rms",
        ),
        Contest(
            "goal-obstacles",
            "Goal reaching among obstacles",
            "goal_reaching",
            {"p3dx": DIFF_DRIVE_GOAL_REACHING, "omni3": GOAL_REACHING, "omni4": GOAL_REACHING},
            GOAL_POLICIES,
            {"num_beams": 72, "max_range": 5.0},
            1200,
            "time",
        ),
    )
}

SPEEDS = (0.3, 0.45, 0.6, 0.75, 0.9, 1.05)  # m/s, of the speed-accuracy front
FRONT_SCENARIOS = 2  # of each family, at each speed
LADDER_SCENARIOS = 2  # of each family, at each level
OVERVIEW_SCENARIOS = 1  # of each family, in the overview

OVERVIEW, DISTURBANCES = "overview", "disturbances"  # suites of both contests, in part


def families(contest: Contest, dynamics: str) -> tuple[str, ...]:
    """Returns the families of a contest's task; those with pushable obstacles need the pymunk plant."""
    return tuple(
        family for family in splits.FAMILIES[contest.task] if dynamics == "pymunk" or family not in splits.NEEDS_PYMUNK
    )
