"""Safety filters behind policies: shield, barrier and the guard of the ROS driver, side by side.

    nice -n 19 python benchmarks/studies/filters.py

Policy, filter and family that are in docs/results/filters.csv are not driven again; the page is made from that file.
"""

import functools
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import gymnasium
import numpy as np
from numpy.typing import NDArray
from part_rows import drive_missing

from wayfield.benchmarks.statistics.crossed import share_interval
from wayfield.benchmarks.statistics.paired import difference
from wayfield.bridges.ros.conventions import View
from wayfield.bridges.ros.guard import Limits
from wayfield.bridges.ros.messages import Twist
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies import Barrier, Pilot, Policy, Shield, Shielded, make
from wayfield.policies.parts.stopping import beam_directions
from wayfield.system.storage import write_whole

TABLE, PAGE = Path("docs/results/filters.csv"), Path("docs/results/filters.md")
ROBOT, TIER, BEAMS, STEPS, SCENES = "p3dx", "lagged", 72, 1200, 50
GROUPS = {
    "static obstacles": ("clutter_10", "rooms"),
    "moving obstacles": ("moving_crossing", "moving_crowd"),
}
POLICIES = {
    "smooth_pose": "does not look at obstacles",
    "vfh_plus": "looks at its scan",
    "ppo": "a trained network that looks at its scan",
}
COLUMNS = ("policy", "filter", "family", "scene", "success", "collision", "time", "changed")
DIFFERS = 1e-6  # m/s and rad/s


class Guard(NamedTuple):
    """The guard of the ROS driver, on scans that are never old and have no blind sector."""

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the last commands, (b,)."""
        return np.zeros(briefing.num_envs, [("command", np.float64, (3,))])

    def passed(self, observation: Any, briefing: Briefing, memory: NDArray[Any], twists: NDArray[Any]) -> NDArray[Any]:
        """Returns the twists (b, 2) that the guard lets through."""
        limits, directions = Limits(briefing.robot), beam_directions(briefing)
        for i, (v, w) in enumerate(twists.tolist()):
            ranges = observation.ranges[i]
            there = ranges < (1.0 - 1e-6) * briefing.max_range
            view = View(ranges, ranges[there, None] * directions[there], False)
            twist = limits.clear_of_obstacles(limits.within(Twist(v, 0.0, w)), view, 0.0)
            sent = limits.ramped(Twist(*memory["command"][i].tolist()), twist, briefing.dt)
            memory["command"][i] = sent.vx, 0.0, sent.yaw_rate
            twists[i] = sent.vx, sent.yaw_rate
        return twists


class Counted:
    """A filter, and in how many periods it changed what a policy asked for, beyond what the wheels do."""

    def __init__(self, behind: Any) -> None:
        self.behind = behind
        self.changed: NDArray[np.int64] = np.zeros(0, np.int64)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the filter's memory."""
        self.changed = np.zeros(briefing.num_envs, np.int64)
        memory: NDArray[Any] = self.behind.reset(briefing)
        return memory

    def passed(self, observation: Any, briefing: Briefing, memory: NDArray[Any], twists: NDArray[Any]) -> NDArray[Any]:
        """Returns what the filter lets through."""
        rates = np.abs(briefing.robot.wheel_speeds_from_twist(twists)).max(axis=1)
        wanted = twists * np.minimum(1.0, briefing.robot.rated_wheel_speed / np.maximum(rates, 1e-9))[:, None]
        driven: NDArray[Any] = self.behind.passed(observation, briefing, memory, wanted.copy())
        self.changed += np.abs(driven - wanted).max(axis=1) > DIFFERS
        return driven


FILTERS = {"none": None, "Shield": Shield(), "Barrier": Barrier(), "guard": Guard()}


def drive(policy: str, behind: str, family: str) -> list[tuple[Any, ...]]:
    """Returns a row a scene of the claims split."""
    kwargs: dict[str, Any] = {"robot": ROBOT, "actuators": TIER, "num_beams": BEAMS, "max_episode_steps": STEPS}
    kwargs |= {"scenario": f"{family}/claims", "vectorization_mode": "vector_entry_point"}
    env: Any = gymnasium.make_vec("wayfield/DiffDriveGoalObstacles-v0", SCENES, **kwargs)
    counted = Counted(FILTERS[behind])
    law: Policy = make(policy) if FILTERS[behind] is None else Shielded(make(policy), counted)
    pilot = Pilot(law, env)
    observation, _ = env.reset(seed=0, options={"scenario": np.arange(SCENES)})
    pilot.reset()
    over, rows = np.zeros(SCENES, bool), list[tuple[Any, ...]]()
    while not over.all():
        observation, _, terminated, truncated, info = env.step(pilot.act(observation))
        for i in np.flatnonzero((terminated | truncated) & ~over).tolist():
            periods = round(info["time"].item(i) / env.task.options.dt)
            changed = counted.changed.item(i) / periods if len(counted.changed) else 0.0
            ends = (int(info["success"][i]), int(info["collision"][i]), f"{info['time'].item(i):.2f}")
            rows.append((i, *ends, f"{changed:.4f}"))
        over |= terminated | truncated
        env.resting[:] = over
    env.close()
    return sorted(rows)


def numbers(rows: Sequence[Mapping[str, str]], policy: str, behind: str, group: str) -> dict[str, NDArray[np.float64]]:
    """Returns the numbers of a cell of the table, by column, in the order of the scenes."""
    mine = [
        row for row in rows if (row["policy"], row["filter"]) == (policy, behind) and row["family"] in GROUPS[group]
    ]
    return {name: np.array([float(row[name]) for row in mine]) for name in COLUMNS[3:]}


def cells(rows: Sequence[Mapping[str, str]], policy: str, behind: str, group: str) -> list[str]:
    """Returns a line of the table."""
    these, alone = (numbers(rows, policy, each, group) for each in (behind, "none"))
    strata = list(np.repeat(GROUPS[group], SCENES))
    low, high = share_interval(these["success"], strata) or (np.nan, np.nan)
    won, hit = these["success"], these["collision"]
    line = [f"`{policy}`", behind, f"{100.0 * won.mean():.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"]
    if behind == "none":
        line.append("")
    else:
        apart = difference(won[:, None], alone["success"][:, None], strata, "share")
        line.append(f"{100.0 * apart.value:+.1f} [{100.0 * apart.low:+.1f}, {100.0 * apart.high:+.1f}]")
    both = (won > 0.0) & (alone["success"] > 0.0)
    slower = (
        f"{these['time'][both].mean() - alone['time'][both].mean():+.1f}" if both.any() and behind != "none" else ""
    )
    stands = (won + hit) == 0.0
    share = "" if behind == "none" else f"{100.0 * these['changed'].mean():.0f}"
    return [*line, f"{100.0 * hit.mean():.1f}", f"{100.0 * stands.mean():.1f}", share, slower]


def page(rows: Sequence[Mapping[str, str]]) -> str:
    """Returns the page."""
    count = {group: SCENES * len(families) for group, families in GROUPS.items()}
    lines = [
        "# Safety filters behind policies", "",
        "Made by `python benchmarks/studies/filters.py` from [every episode](filters.csv).", "",
        "[All results](../results.md)", "",
        f"A {ROBOT.upper()} with `{TIER}` actuators and {BEAMS} beams, {SCENES} scenes a family of the claims split, "
        "one episode each, without noise. `Shield` passes a twist on if the robot can still brake before all that its "
        "scan hits; `Barrier` (a control barrier function, `cbf(policy)`) drives the nearest twist that nears nothing "
        "too fast; `guard` is the speed limit of the ROS driver, by the scan of the moment alone (the driver remembers "
        "earlier ones). Deadlock: neither goal nor collision within "
        f"{STEPS * 0.05:g} s. Interventions: share of control periods in which the filter changed the twist. Time: "
        "against no filter, in scenes that both solve. Brackets are 95 % intervals. `ppo` is one agent.", "",
    ]  # fmt: skip
    header = ["policy", "filter", "success (%)", "vs. no filter (points)", "collision (%)", "deadlock (%)"]
    header += ["interventions (%)", "time (s)"]
    for group, families in GROUPS.items():
        lines += [
            f"## {group.capitalize()}",
            "",
            f"n = {count[group]}: {', '.join(f'`{each}`' for each in families)}.",
            "",
        ]
        lines += [f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
        lines += [f"| {' | '.join(cells(rows, *each, group))} |" for each in itertools.product(POLICIES, FILTERS)]
        lines.append("")
    return "\n".join([*lines, *findings(rows), ""])


def findings(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Returns what the tables say, of their numbers."""
    still, moving = GROUPS

    def share(policy: str, behind: str, group: str, name: str) -> float:
        return 100.0 * float(numbers(rows, policy, behind, group)[name].mean())

    def four(policy: str, group: str, name: str) -> str:
        return ", ".join(f"{share(policy, each, group, name):.1f} ({each})" for each in FILTERS)

    return [
        "## Where each loses", "",
        f"- Behind `smooth_pose`, which {POLICIES['smooth_pose']}: successes {four('smooth_pose', still, 'success')} % "
        "among static obstacles. The shield can only stop such a policy. The barrier steers it past some things, and "
        "stands before the rest: a barrier has no plan. Neither collides; with the guard "
        f"{share('smooth_pose', 'guard', still, 'collision'):.1f} % do, for it knows no lag of the base, and nothing "
        "of what stands between two beams or has dropped out of sight.",
        f"- Behind policies that look at their scan: `vfh_plus` {four('vfh_plus', still, 'success')} %, `ppo` "
        f"{four('ppo', still, 'success')} %. The barrier holds up what would have driven past: it reads a gap as a "
        "limit of speed in every direction, and where two limits meet the nearest allowed twist is to stand.",
        f"- Among moving obstacles all three take what moves for standing still. Collisions of `vfh_plus`: "
        f"{four('vfh_plus', moving, 'collision')} %; of `smooth_pose`: {four('smooth_pose', moving, 'collision')} %.",
        "- The guard knows ages of messages and blind sectors, which neither of the others does, and of the base only "
        "how fast it brakes. On a robot it stays the last word, behind whatever filter you choose.",
        "- A gamma above 1/(4 (lag + dt/2)) is refused: the base would overshoot the barrier.",
    ]  # fmt: skip


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--pages", is_flag=True, help="Only make the page anew.")
def main(pages: bool) -> None:
    """Drives what is missing, and makes the page."""
    every = list(itertools.product(POLICIES, FILTERS, itertools.chain(*GROUPS.values())))
    parts = [(dict(zip(COLUMNS, each, strict=False)), functools.partial(drive, *each)) for each in every]
    order = [part for part, _ in parts].index
    rows = drive_missing(
        TABLE, COLUMNS, parts, 0 if pages else None, lambda row: order({name: row[name] for name in COLUMNS[:3]})
    )
    write_whole(PAGE, page(rows).encode())


if __name__ == "__main__":
    main()
