"""A training state that was changed and signed anew: compiled steps index by it and look at no bounds."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from wayfield.policies.training import checkpoints
from wayfield.policies.training.learner import PpoLearner
from wayfield.policies.training.presets import PRESETS, Ppo, Preset
from wayfield.policies.training.run import Job, train

TINY: dict[str, Any] = {"num_envs": 4, "horizon": 4, "batch_size": 16, "steps": 48, "paces": (0.6,), "validations": 1}
PATH = PRESETS["path_following_plain"].changed(
    shares=((1.0, {"scenario": "s_curve", "noise": 1.0}),),
    validation={"scenario": "s_curve"},
    conditions=(),
    algorithm=Ppo(epochs=1),
    **TINY,
)
GOAL = PRESETS["diff_drive_goal"].changed(
    shares=((1.0, {"scenario": "clutter_10/train"}),),
    validation={"scenario": "clutter_10/train"},
    conditions=(),
    algorithm=Ppo(epochs=1),
    controller="",
    imitation=0,
    shortest_ways=False,
    **TINY,
)
VAST = 10**12


def saved(preset: Preset, folder: Path) -> Job:
    """Returns a job that goes on from the state of a run that has begun."""
    job = Job(preset.worlds.env_ids[0], preset, (), 0, folder)
    folder.mkdir()
    checkpoints.write_run(folder, job.described())
    learner = PpoLearner(preset, job.env_id, 0)
    learner.update()
    checkpoints.write_state(folder, *learner.state())
    return dataclasses.replace(job, resume=True)


@pytest.mark.parametrize(
    ("preset", "field", "value"),
    [
        *((PATH, "scenario", VAST), (PATH, "segment", -1), (PATH, "noise_row", VAST), (PATH, "x", np.nan)),
        *((GOAL, "waypoint", -1), (GOAL, "num_obstacles", VAST)),
    ],
)
def test_a_state_that_no_robot_can_have_is_refused_in_a_line(
    preset: Preset, field: str, value: float, tmp_path: Path
) -> None:
    job = saved(preset, tmp_path / "run")
    arrays, numbers = checkpoints.read_state(job.folder / checkpoints.LAST)
    learner = PpoLearner(preset, job.env_id, 0)
    states = np.frombuffer(arrays["world_0.states"].tobytes(), learner.env.worlds.parts[0].batch.states.dtype).copy()
    states[field][1] = value
    changed = {**arrays, "world_0.states": np.frombuffer(states.tobytes(), np.uint8)}
    with pytest.raises(ValueError, match=f"{field} of robot 1 is|must be an int or 4 ints from 0") as refused:
        learner.restore(changed, numbers)
    assert "\n" not in str(refused.value)
    # by the command's own way too: the file and what is wrong with it
    checkpoints.write_state(job.folder, changed, numbers)
    with pytest.raises(ValueError, match=r"last\.safetensors is damaged or of another run: "):
        train(job, lambda report: None)


@pytest.mark.parametrize("preset", [PATH, GOAL])
def test_a_state_as_it_was_saved_goes_on_to_the_same_bits(preset: Preset, tmp_path: Path) -> None:
    del tmp_path
    first = PpoLearner(preset, preset.worlds.env_ids[0], 0)
    first.update()
    kept = first.state()
    again = PpoLearner(preset, preset.worlds.env_ids[0], 1)
    again.restore(*kept)
    for learner in (first, again):
        if learner is again:
            again.restore(*kept)  # draws of torch and NumPy are the process's
        else:
            first.restore(*kept)
        learner.update()
    for name, array in first.state()[0].items():
        np.testing.assert_array_equal(array, again.state()[0][name], err_msg=name)
