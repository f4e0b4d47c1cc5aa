"""Films: a few representative cases as mp4, through Gymnasium's RecordVideo."""

import logging
import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.rollout import make_policy
from wayfield.policies.lookahead import Lookahead
from wayfield.policies.pilot import Pilot

LONGEST = 800  # steps of a film


def film(folder: Path, cases: Iterable[Case], dynamics: str, actuators: str, seed: int) -> None:
    """Writes an mp4 of the first episode of each case that is to be filmed, of the first case if none is."""
    cases = list(cases)
    for case in [case for case in cases if case.filmed] or cases[:1]:
        _film(folder, case, dynamics, actuators, seed)


def _film(folder: Path, case: Case, dynamics: str, actuators: str, seed: int) -> None:
    env = gymnasium.make(
        case.env_id,
        max_episode_steps=min(case.max_episode_steps, LONGEST),
        render_mode="rgb_array",
        scenario=case.scenario,
        dynamics=dynamics,
        actuators=actuators,
        **case.env_kwargs,
    )
    name = "-".join(re.findall(r"[\w.]+", f"{case.document} {case.experiment} {case.policy} {case.gains_text}"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the folder exists already
        recorded = gymnasium.wrappers.RecordVideo(env, str(folder), name_prefix=name, disable_logger=True)
    logging.getLogger("moviepy").setLevel(logging.ERROR)
    pilot = Pilot(make_policy(case, seed), recorded)
    observation, _ = recorded.reset(seed=seed)
    pilot.reset()
    ended = False
    while not ended:
        _mark(recorded, pilot)
        observation, _, terminated, truncated, _ = recorded.step(pilot.act(observation).astype(np.float32))
        ended = terminated or truncated
    recorded.close()  # type: ignore[no-untyped-call]


def _mark(env: Any, pilot: Pilot) -> None:
    """Shows document A's markers: the look-ahead point, and the path point that is being chased."""
    policy = pilot.policy
    if not isinstance(policy, Lookahead):
        return
    single = env.unwrapped
    state = single.batch.states[0]
    pose = np.array([[state["x"], state["y"], state["heading"]]])
    x, y, *_ = policy.errors(pose, state["arc_length"][None], pilot.briefing)[0]
    (px, py, heading), ahead = pose[0], policy.lookahead_distance
    sine, cosine = np.sin(heading), np.cos(heading)
    single.marks = {
        "lookahead": (float(px + ahead * cosine), float(py + ahead * sine)),
        "reference": (float(px + cosine * x - sine * y), float(py + sine * x + cosine * y)),
    }
