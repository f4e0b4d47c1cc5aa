"""SARL's own network and ORCA in CrowdNav's own rules, where people do not see the robot.

    python benchmarks/studies/crowdnav_rules.py WEIGHTS

The rules: a velocity every 0.25 s that is taken up at once, a touch anywhere on the way between two, 25 s, a goal
within 0.3 m; the 500 test cases. People are ORCA's, and alike for all, since they do not see the robot. The file is a
SARL network of CrowdNav's, in a folder of your own (`value_networks`); the rows go to docs/results/papers.csv.
--search searches ORCA's gains anew, on cases of CrowdNav's training seeds, and chooses on those of its validation.

Source: Chen, Liu, Kreiss and Alahi, ICRA 2019; github.com/vita-epfl/CrowdNav (crowd_sim.py, env.config, test.py).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import papers
from numpy.typing import NDArray

from wayfield.benchmarks.entrants.value_networks import ValueNetwork
from wayfield.benchmarks.papers.claim import AGENT, COLUMNS, TUNED, UNTUNED, written
from wayfield.benchmarks.papers.crowdnav_sarl import CLAIM, SEARCHED
from wayfield.benchmarks.papers.search import searched
from wayfield.envs.crowds import people
from wayfield.envs.crowds.people import stroll
from wayfield.envs.scenarios.people_families import crowdnav_case, crowdnav_tests
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.system.storage import write_whole

PERIOD, STEPS, LATEST, RADIUS = 0.25, 98, 24.0, 0.3  # s, of them, s from which on a case is too late, m
START, GOAL = (0.0, -4.0), (0.0, 4.0)
AT_ONCE = 32  # cases
TRAINING, VALIDATION, FINALISTS = range(2000, 2200), range(100), 3  # CrowdNav's seeds
RANGES = {"margin": (0.01, 0.41), "horizon": (0.5, 8.0), "share": (0.5, 1.0)}

Array = NDArray[Any]
Drive = Callable[[int, Array, Array], Array]  # step, cases and their places (n, 2): velocities (n, 2)


def walked(cases: Iterable[TeamScenario], gains: Mapping[str, float]) -> tuple[Array, Array]:
    """Returns where people walk (cases, steps, people, 4), and the velocities of a robot by ORCA with these gains."""
    places = []
    for case in cases:
        walks = np.zeros(len(case.walks) + 1, people.WALK)
        walks[1:] = case.walks
        walks[0] = case.walks[0]
        walks[0]["blind"] = 0.0
        for name, value in zip(("x", "y", "goal_x", "goal_y"), (*START, *GOAL), strict=True):
            walks[0][name] = value
        for name, value in gains.items():
            walks[0][name] = value
        places.append(stroll(walks, STEPS, PERIOD, reach=10.0, robots=(0,))[:, :, :4])
    out = np.array(places)
    return out[:, :, 1:], out[:, 1:, 0, 2:4]


def ends_of(crowd: Array, drive: Drive) -> tuple[Array, Array]:
    """Returns which cases (n,) succeed, and when each ended, s."""
    places = np.tile(START, (len(crowd), 1))
    won, times = np.zeros(len(crowd), bool), np.full(len(crowd), LATEST)
    on = np.arange(len(crowd))
    for k in range(STEPS):
        if PERIOD * k >= LATEST or not len(on):
            break
        velocities = drive(k, on, places[on])
        apart = crowd[on, k, :, :2] - places[on][:, None]
        way = PERIOD * (crowd[on, k, :, 2:4] - velocities[:, None])
        share = np.clip(-(apart * way).sum(axis=2) / np.maximum((way**2).sum(axis=2), 1e-300), 0.0, 1.0)
        touched = np.linalg.norm(apart + share[:, :, None] * way, axis=2).min(axis=1) < 2.0 * RADIUS
        places[on] += PERIOD * velocities
        there = np.linalg.norm(places[on] - GOAL, axis=1) < RADIUS
        won[on] = there & ~touched
        times[on[touched | there]] = PERIOD * (k + 1)
        on = on[~(touched | there)]
    return won, times


def by_network(file: str, crowd: Array) -> Drive:
    """Returns how a value network drives."""
    law = ValueNetwork(file)

    def drive(k: int, on: Array, places: Array) -> Array:
        bodies = np.zeros((len(on), crowd.shape[2], 7))
        bodies[:, :, :4], bodies[:, :, 4], bodies[:, :, 6] = crowd[on, k], RADIUS, 1.0
        bodies[:, :, :2] -= places[:, None]
        order = np.linalg.norm(bodies[:, :, :2], axis=2).argsort(axis=1)
        seen = np.take_along_axis(bodies, order[:, :, None], axis=1)
        observation = SimpleNamespace(pose=np.zeros((len(on), 3)), goal=np.array(GOAL) - places, bodies=seen)
        parts = np.split(np.arange(len(on)), range(AT_ONCE, len(on), AT_ONCE))
        return np.concatenate([law.decided(observation, part, crowd.shape[2], RADIUS) for part in parts])

    return drive


def rows(file: str, count: int) -> Iterator[dict[str, str]]:
    """Yields a row of COLUMNS for each of the first cases and side."""
    for side, gains in ((UNTUNED, {}), (TUNED, SEARCHED), (AGENT, None)):
        crowd, driven = walked(crowdnav_tests(RADIUS)[:count], gains or {})
        drive = by_network(file, crowd) if gains is None else (lambda k, on, _, v=driven: v[on, k])
        for i, (won, time) in enumerate(zip(*ends_of(crowd, drive), strict=True)):
            cells = (CLAIM.name, side, "", "crowdnav", str(i), str(int(won)), f"{time:.6g}")
            yield dict(zip(COLUMNS, cells, strict=True))


def chosen(sets: int) -> tuple[dict[str, float], float, float]:
    """Returns gains of ORCA, and their success and time on validation: by success, then time, as on training seeds."""
    training, validation = (list(map(crowdnav_case, seeds)) for seeds in (TRAINING, VALIDATION))

    def score(cases: Sequence[TeamScenario], gains: dict[str, float]) -> tuple[float, float]:
        crowd, driven = walked(cases, gains)
        won, times = ends_of(crowd, lambda k, on, _: driven[on, k])
        return 1.0 - float(won.mean()), float(times[won].mean()) if won.any() else LATEST

    def worth(gains: dict[str, float]) -> float:
        lost, time = score(training, gains)
        return len(training) * lost + time / LATEST

    best = searched(RANGES, worth, sets)[:FINALISTS]
    (lost, time), gains = min(((score(validation, each), each) for each in best), key=lambda each: each[0])
    return gains, 1.0 - lost, time


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("file", required=False, type=click.Path(exists=True, dir_okay=False))
@click.option("--cases", default=CLAIM.scenes, show_default=True, help="The first cases of the test.")
@click.option("--search", is_flag=True, help="Search ORCA's gains: 100 sets.")
def main(file: str | None, cases: int, search: bool) -> None:
    """Drives all sides of the claim with the weights of FILE, and makes the page."""
    if search:
        gains, share, time = chosen(100)
        click.echo(f"{gains}: success {share:.3f}, {time:.2f} s on validation")
    if file is None:
        return
    others = [row for row in papers.read() if row["claim"] != CLAIM.name]
    write_whole(papers.TABLE, written([*others, *rows(file, cases)]))
    write_whole(papers.PAGE, papers.page().encode())


if __name__ == "__main__":
    main()
