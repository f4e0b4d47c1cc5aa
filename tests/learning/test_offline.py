"""Agents from data: a network sees in a recorded set what it would have seen driving, and learns what it should."""

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from click.testing import CliRunner

pytest.importorskip("pyarrow", reason='needs pip install "wayfield[record]"')
pytest.importorskip("minari", reason='needs pip install "wayfield[record]"')

from wayfield.benchmarks.recordings import record
from wayfield.policies.learned.agent import Agent, load_agent
from wayfield.policies.learned.conditions import commanded_speed
from wayfield.policies.trained.ppo import shipped
from wayfield.policies.training import offline
from wayfield.policies.training.offline import Transitions, opened, task_of, transitions
from wayfield.policies.training.presets import PRESETS

PRESET = PRESETS["path_following_tiers"]  # of the agents that ship


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder of a set that a shipped agent has driven, without exploration or what a set does not tell."""
    home = tmp_path_factory.mktemp("minari")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(home))
        patch.setattr(Agent, "keeps_pace", False)
        words = ["ppo", "--suite", "path-following", "--family", "splines", "--episodes", "3", "--dataset", "mine-v0"]
        result = CliRunner().invoke(record.main, words)
        assert result.exit_code == 0, result.output
    return home / "mine-v0"


def steps_of(source: Path) -> tuple[Any, Transitions]:
    data = opened(str(source))
    return data, transitions(data, task_of(data), PRESET)


def test_a_network_sees_in_the_data_what_it_saw_when_it_drove(recorded: Path) -> None:
    """In each episode the recorded actions are those of an agent whose network gets the inputs made of the record."""
    data, steps = steps_of(recorded)
    assert len(steps.inputs) == data.total_steps
    # episodes go side by side, the longest first; those that have ended have no row any more
    lengths = np.sort([len(each["actions"]) for each in data.storage.get_episodes([0, 1, 2])])[::-1]
    rows = np.concatenate([np.flatnonzero(lengths > k) for k in range(lengths[0])])
    drove = set()
    for seed, folder in shipped("path_following", "p3dx").items():
        agent = load_agent(folder)
        assert agent.features == PRESET.features
        told = commanded_speed(agent.card["cruises"]["lagged"], agent.speed, 1.2)
        steps = transitions(data, task_of(data), PRESET.changed(speed=told))
        errors = np.abs(np.clip(agent.network(steps.inputs), -1.0, 1.0) - steps.actions).max(axis=1)
        drove |= {(k, seed) for k in range(3) if errors[rows == k].max() < 2e-5}
    assert sorted(k for k, _ in drove) == [0, 1, 2]


def test_what_follows_a_step_is_the_next_one_and_the_task_s_end_goes_on_to_nothing(recorded: Path) -> None:
    data, steps = steps_of(recorded)
    episodes = list(data.storage.get_episodes([int(k) for k in data.episode_indices]))
    assert steps.going_on.sum() == len(steps.going_on) - sum(each["terminations"].sum() for each in episodes)
    np.testing.assert_allclose(steps.rewards.sum(), sum(each["rewards"].sum() for each in episodes), rtol=1e-4)
    seen = {row.tobytes() for row in steps.inputs}
    later = sum(row.tobytes() in seen for row in steps.following)
    assert later == len(steps.inputs) - len(episodes)
    # whatever ended an episode: the clock alone, the task alone, or both at once
    ends = [(False, True), (True, False), (True, True)]
    for each, (terminated, truncated) in zip(episodes, ends, strict=True):
        each["terminations"][-1], each["truncations"][-1] = terminated, truncated
    data = SimpleNamespace(episode_indices=range(3), storage=SimpleNamespace(get_episodes=lambda _: episodes))
    last = {row.tobytes() for row in steps.following} - seen
    found = transitions(data, task_of(opened(str(recorded))), PRESET)
    assert len(last) == 3
    over = [k for k, row in enumerate(found.following) if row.tobytes() in last]
    in_order = sorted(
        zip(episodes, ends, strict=True), key=lambda each: len(each[0]["actions"])
    )  # the longest ends last
    assert found.going_on[over].tolist() == [0.0 if terminated else 1.0 for _, (terminated, _) in in_order]
    assert np.delete(found.going_on, over).all()


def test_an_end_by_the_clock_goes_on_and_the_task_s_end_does_not(recorded: Path) -> None:
    """The recorded episodes end once by the clock and otherwise by the task, whatever ended them."""
    data = opened(str(recorded))
    episodes = list(data.storage.get_episodes([0, 1, 2]))
    late = max(range(3), key=lambda k: len(episodes[k]["actions"]))  # its last step is the last of all
    for k, each in enumerate(episodes):
        each["terminations"] = np.arange(len(each["actions"])) == (-1 if k == late else len(each["actions"]) - 1)
    told = SimpleNamespace(episode_indices=[0, 1, 2], storage=SimpleNamespace(get_episodes=lambda numbers: episodes))
    steps = transitions(told, task_of(data), PRESET)
    assert steps.going_on[-1] == 1.0
    assert (steps.going_on == 0.0).sum() == 2


class _Says(torch.nn.Module):
    """A network that answers by its last two inputs, an action."""

    def __init__(self, answer: Any) -> None:
        super().__init__()
        self.answer = answer

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        found: torch.Tensor = self.answer(x)
        return found


def test_a_step_is_worth_its_reward_and_what_the_lower_critic_makes_of_what_follows() -> None:
    """Of an action that is cut, gets its noise, and is cut again; nothing follows where the task has ended."""
    rng = np.random.default_rng(9)
    rewards, asked, noise = rng.normal(size=60), rng.uniform(-1.8, 1.8, (60, 2)), rng.uniform(-0.5, 0.5, (60, 2))
    discounts = rng.choice([0.9, 0.0], 60)
    critics = [_Says(lambda x: 5.0 + x[:, -2:-1] - 2.0 * x[:, -1:]), _Says(lambda x: 4.5 - x[:, -2:-1] + x[:, -1:])]
    given = [torch.from_numpy(each) for each in (rewards, asked, discounts, noise)]
    found = offline.worth(*given[:3], [_Says(lambda x: x), *critics], given[3])
    first, second = np.clip(np.clip(asked, -1.0, 1.0) + noise, -1.0, 1.0).T
    lower = np.minimum(5.0 + first - 2.0 * second, 4.5 - first + second)
    np.testing.assert_allclose(found.numpy(), rewards + discounts * lower, rtol=1e-12)


@pytest.mark.slow
def test_better_actions_than_the_mean_of_the_recorded_ones_are_found_by_value_alone() -> None:
    """Actions are even in [-1, 1] and the reward falls with (a - 0.6)^2: the mean of the data is 0."""
    rng = np.random.default_rng(0)
    n = 4000
    inputs = rng.standard_normal((n, 3)).astype(np.float32)
    actions = rng.uniform(-1.0, 1.0, (n, 2)).astype(np.float32)
    rewards = -((actions - 0.6) ** 2).sum(axis=1)
    steps = Transitions(inputs, actions, rewards, inputs, np.zeros(n, np.float32))
    small = PRESET.changed(hidden=(32, 32))
    found = {}
    for name in offline.ALGORITHMS:
        *_, (_, _, layers) = offline.LEARNERS[name](steps, small, 1000, 0)
        hidden = inputs
        for k, (weight, bias) in enumerate(layers):
            hidden = hidden @ weight.T + bias
            hidden = np.tanh(hidden) if k + 1 < len(layers) else hidden
        found[name] = hidden.mean()
    assert abs(found["bc"]) < 0.1
    assert abs(found["td3bc"] - 0.6) < 0.35


def by_hand(sizes: list[int], activation: Any) -> Any:
    """Returns the weights and biases of a perceptron as torch draws them, and what applies them."""
    layers = [torch.nn.Linear(come, go) for come, go in itertools.pairwise(sizes)]

    def applied(inputs: Any) -> Any:
        for layer in layers[:-1]:
            inputs = activation(inputs @ layer.weight.T + layer.bias)
        return inputs @ layers[-1].weight.T + layers[-1].bias

    return [each for layer in layers for each in (layer.weight, layer.bias)], applied


@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_gradient_steps_are_those_of_the_equations(activation: str) -> None:
    """Behaviour cloning, and TD3+BC with its delayed actor and targets that follow slowly."""
    rng, n = np.random.default_rng(6), 50
    numbers = [rng.normal(size=size).astype(np.float32) for size in ((n, 3), (n, 2), (n,), (n, 3))]
    numbers[1] = np.tanh(numbers[1])
    steps = Transitions(*numbers, (rng.random(n) < 0.7).astype(np.float32))
    preset = PRESET.changed(hidden=(6, 5), activation=activation, discount=0.9)
    between = {"tanh": torch.tanh, "relu": torch.relu}[activation]
    data = [torch.from_numpy(each) for each in steps]
    for name in offline.ALGORITHMS:
        told = list(offline.LEARNERS[name](steps, preset, 7, 4))
        assert [k for k, _, _ in told] == [7]
        torch.manual_seed(4)
        numbers_of, asks = by_hand([3, 6, 5, 2], between)
        actor = torch.optim.Adam(numbers_of, 3e-4)
        draws = np.random.default_rng(4)
        if name == "td3bc":
            q = [by_hand([5, 6, 5, 1], torch.relu) for _ in range(2)]
            slow = [by_hand(*each) for each in (([3, 6, 5, 2], between), *[([5, 6, 5, 1], torch.relu)] * 2)]
            fast = [numbers_of, *(each for each, _ in q)]
            for (mine, _), other in zip(slow, fast, strict=True):
                for a, b in zip(mine, other, strict=True):
                    a.data.copy_(b.data)
            critics = torch.optim.Adam([each for mine, _ in q for each in mine], 3e-4)
            scale = 0.1 / float(np.std(steps.rewards))
        loss: Any = torch.zeros(())
        for k in range(1, 8):
            rows = torch.from_numpy(draws.integers(n, size=offline.BATCH))
            s, a, r, s2, on = (each[rows] for each in data)
            if name == "bc":
                loss = ((asks(s) - a) ** 2).mean()
            else:
                noise = torch.clamp(0.2 * torch.randn(offline.BATCH, 2), -0.5, 0.5)
                with torch.no_grad():
                    a2 = torch.clamp(torch.clamp(slow[0][1](s2), -1, 1) + noise, -1, 1)
                    low = torch.minimum(*(each(torch.cat([s2, a2], 1))[:, 0] for _, each in slow[1:]))
                    target = scale * r + 0.9 * on * low
                both = torch.cat([s, a], 1)
                critics.zero_grad()
                sum(((each(both)[:, 0] - target) ** 2).mean() for _, each in q).backward()
                critics.step()
                if k % 2 == 0:
                    value = q[0][1](torch.cat([s, torch.clamp(asks(s), -1, 1)], 1)).mean(dim=1)
                    loss = ((asks(s) - a) ** 2).mean() - 2.5 * value.mean() / value.abs().mean().detach()
            if name == "bc" or k % 2 == 0:
                actor.zero_grad()
                loss.backward()
                actor.step()
                if name == "td3bc":
                    for (mine, _), other in zip(slow, fast, strict=True):
                        for x, y in zip(mine, other, strict=True):
                            x.data += 0.005 * (y.data - x.data)
            if k == 7:
                ((_, found, layers),) = told
                assert found == pytest.approx(loss.item(), rel=1e-4)
                flat = [each for pair in layers for each in pair]
                for mine, other in zip(flat, numbers_of, strict=True):
                    np.testing.assert_allclose(mine, other.detach().numpy(), atol=1e-5)


@pytest.mark.slow
def test_what_ends_the_task_is_left_alone_though_it_pays_as_well_as_anything_else() -> None:
    """Every step pays alike, and half of the actions end the episode: those that do not are worth more."""
    rng = np.random.default_rng(0)
    n = 4000
    inputs = np.zeros((n, 3), np.float32)
    actions = rng.uniform(-1.0, 1.0, (n, 2)).astype(np.float32)
    rewards = (1.0 + 0.2 * rng.standard_normal(n)).astype(np.float32)
    going_on = (actions[:, 0] < 0.0).astype(np.float32)
    small = PRESET.changed(hidden=(32, 32))
    *_, (_, _, layers) = offline.improved(Transitions(inputs, actions, rewards, inputs, going_on), small, 600, 0)
    hidden = inputs[:1]
    for k, (weight, bias) in enumerate(layers):
        hidden = hidden @ weight.T + bias
        hidden = np.tanh(hidden) if k + 1 < len(layers) else hidden
    assert hidden[0, 0] < -0.25
    assert abs(hidden[0, 1]) < 0.15


def test_a_seed_gives_one_agent_that_drives_and_is_not_overwritten(recorded: Path, tmp_path: Path) -> None:
    words = ["bc", str(recorded), "--gradient-steps", "30", "--seeds", "2", "--out"]
    for more, name in (([], "a"), (["--seed", "1", "--seeds", "1"], "b")):
        result = CliRunner().invoke(offline.main, [*words, str(tmp_path / name), *more])
        assert result.exit_code == 0, result.output
        assert "seed 1: " in result.output
    assert [sorted(each.name for each in (tmp_path / name).iterdir()) for name in "ab"] == [
        ["seed_0", "seed_1"], ["seed_1"],
    ]  # fmt: skip
    weights = [tmp_path / name / "seed_1" / "best" / "weights.safetensors" for name in "ab"]
    assert weights[0].read_bytes() == weights[1].read_bytes()
    agent = load_agent(tmp_path / "a" / "seed_1" / "best")
    other = load_agent(tmp_path / "a" / "seed_0" / "best")
    assert not np.array_equal(agent.network.numbers, other.network.numbers)
    assert not (agent.network.numbers.view(np.uint32) & 0xFFFF).any()  # rounded as all that are saved
    training, data = agent.card["training"], opened(str(recorded))
    assert (training["algorithm"], training["seed"], training["gradient_steps"]) == ("bc", 1, 30)
    assert training["steps"] == data.total_steps  # frames that it has seen
    assert training["data"]["digest"] == data.storage.metadata[offline.KEY]["digest"]
    # judged on the robot that was recorded, where its preset is judged
    assert agent.card["env_kwargs"] == {**PRESETS[training["preset"]].worlds.validation, "robot": "p3dx"}
    assert agent.card["robots"] == ["p3dx"]
    again = CliRunner().invoke(offline.main, [*words, str(tmp_path / "a")])
    assert again.exit_code == 2
    assert "is there already" in again.output


def test_what_is_no_set_of_ours_is_refused_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    (tmp_path / "mine" / "data").mkdir(parents=True)
    for source in ("nothing/there-v0", str(tmp_path / "mine")):
        result = CliRunner().invoke(offline.main, ["bc", source, "--out", str(tmp_path / "out")])
        assert result.exit_code == 2, result.output
        assert f"DATASET {source!r} cannot be read" in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["CartPole-v1", "wayfield/NoSuchTask-v0", None])
def test_data_of_an_environment_that_is_not_there_are_refused(name: str | None) -> None:
    recorded_in = None if name is None else gymnasium.envs.registration.EnvSpec(name)
    with pytest.raises(ValueError, match=rf"^the data are of '?{name}'?, which this wayfield does not have$"):
        task_of(SimpleNamespace(spec=SimpleNamespace(env_spec=recorded_in)))
