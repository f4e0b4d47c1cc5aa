"""Settings that decide what an agent sees: it is trained with, and drives by, what every value of their ranges says."""

import collections

import pytest

pytest.importorskip("stable_baselines3")

from wayfield.policies.learned.agent import Agent, Network
from wayfield.policies.training.presets import PRESETS, overridden
from wayfield.policies.training.run import LEARNERS, described_agent
from wayfield.policies.training.validation import validate

PATH, GOAL = "path_following_plain", "diff_drive_goal"
TINY = ("num_envs=24", "horizon=8")


@pytest.mark.parametrize(
    ("name", "setting"),
    [
        *((PATH, "features.num_preview=0"), (GOAL, "features.num_beams=2")),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in ((PATH, "features.num_preview=30"), (GOAL, "features.pool=72"))
        ),
    ],
)
def test_an_agent_is_trained_and_validated_by_what_it_is_set_to_see(name: str, setting: str) -> None:
    more = ("steps=384",) if name == PATH else ("steps=768", "imitation=192", "lessons=64", "features.pool=1")
    preset = overridden(PRESETS[name], [*TINY, *more, setting])
    env_id = preset.worlds.env_ids[0]
    learner = LEARNERS[preset.learning.algorithm.name](preset, env_id, 0)
    for _ in learner.teach() if preset.prior.imitation else ():
        pass
    learner.update()
    layers, kwargs = learner.layers(), preset.env_kwargs(preset.worlds.validation)
    card = described_agent(preset, learner.env.worlds.task, env_id, kwargs, "tiny", layers)
    agent = Agent(
        Network.of(layers, preset.learning.activation), preset.features, preset.actions, card, preset.worlds.speed
    )
    assert 0.0 <= validate(agent, env_id, kwargs, 3, every=100).success <= 1.0


def test_what_diverges_and_what_a_robot_cannot_drive_end_in_one_line() -> None:
    preset = overridden(PRESETS[PATH], [*TINY, "steps=384", "learning_rate=1e3"])
    learner = LEARNERS[preset.learning.algorithm.name](preset, preset.worlds.env_ids[0], 0)
    with pytest.raises(FloatingPointError, match="the training diverged"):
        collections.deque((learner.update() for _ in range(3)), maxlen=0)
    planar = overridden(PRESETS[PATH], ["actions.kind=planar"])
    with pytest.raises(ValueError, match=r"actions\.kind must be unicycle with 'p3dx'"):
        LEARNERS[planar.learning.algorithm.name](planar, planar.worlds.env_ids[0], 0)
    with pytest.raises(ValueError, match="shortest_ways must be false where a path is followed"):
        overridden(PRESETS[PATH], ["shortest_ways=true"])
    with pytest.raises(ValueError, match="log_std must be a finite number >= -20 and <= 2, got -1000"):
        overridden(PRESETS[PATH], ["log_std=-1000"])
