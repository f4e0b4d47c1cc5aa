"""Tunes for every condition that the published tables show: python -m wayfield.benchmarks.tuning.tune_all

Sets that ship already are left alone, unless --force is given, so that an interrupted run goes on. The sets that matter
most come first; each search begins with what shipped for its policy before it.
"""

from collections.abc import Iterator

import click

from wayfield import policies
from wayfield.benchmarks.contests import CONTESTS, ROBUST_LEVEL
from wayfield.benchmarks.tuning.tune import SEARCHED, Search, budgeted, folder_of, starting_gains, summary, write_gains
from wayfield.envs.robots import ROBOTS
from wayfield.policies.parts.policy import lacks
from wayfield.policies.parts.tuned import PACE, condition, tuned_conditions
from wayfield.system.command_line import Names, OneLineErrors, on_cluster, say, shared_out

Wanted = tuple[str, str, str, float, str]  # suite, policy, robot, requested speed (m/s), level of disturbance

# times as long a decision as of the others, and so as many times fewer frames
SLOW = {"mpc": 8, "mpc_pose": 8, "mppi": 8, "timed_ilqr": 4, "timed_mpc": 8}


def searches() -> Iterator[Wanted]:
    """Yields every policy in every condition that it is shown in, what most tables show first."""
    paths, goals = CONTESTS["path-following"], CONTESTS["goal-obstacles"]
    others = [contest for contest in CONTESTS.values() if contest not in (paths, goals)]
    speeds = sorted(paths.speeds, key=lambda speed: (speed != PACE, -speed))
    of_paths = [("p3dx", PACE, "none"), ("p3dx", PACE, ROBUST_LEVEL), *(("p3dx", v, "none") for v in speeds[1:])]
    of_paths += [(robot, PACE, "none") for robot in ("omni3", "omni4")]
    of_goals = [(robot, PACE, "none") for robot in ("p3dx", "omni3", "omni4")] + [("p3dx", PACE, ROBUST_LEVEL)]
    of_timed = [of_goals[0], of_goals[1], of_goals[3]]
    chosen = {paths.name: of_paths, goals.name: of_goals, "trajectory-tracking": of_timed}
    for k in range(max(map(len, chosen.values()))):
        for contest in (paths, goals, *others):
            wanted = chosen.get(contest.name, of_goals[:1])
            for name in contest.policies if k < len(wanted) else ():
                if name in SEARCHED and not lacks(policies.make(name), ROBOTS[wanted[k][0]]):
                    yield contest.name, name, *wanted[k]


@click.command("tune_all", cls=OneLineErrors)
@click.option("--suites", type=Names("--suites", CONTESTS), help="Comma-separated.  [default: all]")
@click.option("--policies", "names", type=Names("--policies", SEARCHED), help="Comma-separated.  [default: all]")
@budgeted(8_000_000)
@click.option("--force", is_flag=True, help="Tune again, even where gains ship.")
@click.option(
    "--workers", "count", type=click.IntRange(min=1), default=1, show_default=True, help="Number of processes."
)
@on_cluster
def main(
    suites: tuple[str, ...] | None,
    names: tuple[str, ...] | None,
    frames: int,
    trials: int,
    scenarios: int,
    seed: int,
    force: bool,
    count: int,
) -> None:
    """Tunes every policy for every condition of the published tables, and writes the sets where the package keeps them.

    The budget is that of the longest training by default; slow laws get an eighth of it.
    """
    with shared_out(count) as executor:
        for suite, policy, robot, speed, level in searches():
            file = folder_of(suite) / f"{policy}_{condition(robot, speed, level)}.json"
            if (suites and suite not in suites) or (names and policy not in names) or (file.exists() and not force):
                continue
            known = tuple(each for each in tuned_conditions(policy, suite) if f"{policy}_{each}.json" != file.name)
            budget = frames // SLOW.get(policy, 1)
            nearest = tuple(sorted(known, key=lambda each: _apart(each, robot, speed, level)))[:1]
            starts = tuple(starting_gains(policy, suite, each) for each in nearest)
            search = Search(
                policy, CONTESTS[suite], ROBOTS[robot], speed, level, "lagged", budget, trials, scenarios, seed, starts
            )
            content = search.run(executor)
            write_gains(file, content)
            say(f"{file.stem}: {summary(content)}")


def _apart(known: str, robot: str, speed: float, level: str) -> tuple[bool, bool, float]:
    """Returns how far a condition is from another."""
    of_robot, of_speed, of_level = known.split("_")
    return of_robot != robot, of_level != level, abs(float(of_speed) - speed)


if __name__ == "__main__":
    main()
