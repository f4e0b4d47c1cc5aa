"""How a network is taught, lesson by lesson, stated once more beside a teacher and worlds of a few lines."""

import copy
from types import SimpleNamespace
from typing import Any
from unittest import mock

import gymnasium
import numpy as np
import pytest
import torch

from wayfield.policies.training import imitation
from wayfield.policies.training.imitation import Lessons, teach
from wayfield.policies.training.learner import Timed
from wayfield.policies.training.shaping import Shaped, changes_of

ROBOTS, WIDTH = 6, 3


class Net(torch.nn.Module):
    """A policy as stable-baselines3 has it, of two layers."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(3)
        layer = torch.nn.Linear
        self.mlp_extractor = torch.nn.ModuleDict({"policy_net": layer(WIDTH, 4), "value_net": layer(WIDTH, 4)})
        self.mlp_extractor.policy_net, self.mlp_extractor.value_net = self.mlp_extractor.values()
        self.action_net, self.value_net = layer(4, 2), layer(4, 1)

    def get_distribution(self, inputs: Any) -> Any:
        means = self.action_net(torch.tanh(self.mlp_extractor.policy_net(inputs)))
        return SimpleNamespace(mode=lambda: means)

    def predict_values(self, inputs: Any) -> Any:
        return self.value_net(torch.tanh(self.mlp_extractor.value_net(inputs)))

    def numbers(self) -> Any:
        return torch.cat([each.detach().flatten() for each in self.parameters()])


class Worlds:
    """Robots that see what was done last, and a teacher that wants to undo it."""

    num_envs = ROBOTS

    def __init__(self) -> None:
        self.now, self.steps = np.zeros((ROBOTS, WIDTH), np.float32), 0
        self.driven: list[Any] = []
        self.told: list[list[bool]] = []

    def reset(self) -> Any:
        return self.now.copy()

    def make_pilots(self, teacher: Any) -> Any:
        return [teacher(0.6)]

    def ask(self, pilots: Any) -> Any:
        return pilots[0] * self.now[:, :2] + 0.1 * self.steps

    def actions_of(self, twists: Any) -> Any:
        return np.float32(np.sin(3.0 * twists))

    def step_async(self, actions: Any) -> None:
        self.driven.append(np.array(actions))

    def step_wait(self) -> Any:
        self.now[:, :2] = self.driven[-1]
        self.now[:, 2] = 0.01 * self.steps
        self.steps += 1
        ended = np.arange(ROBOTS) == self.steps % 9
        return self.now.copy(), None, ended, None

    def tell(self, pilots: Any, ended: Any) -> None:
        assert pilots == [-0.6]
        self.told.append(ended.tolist())


def learner(net: Net) -> Any:
    """Returns what `teach` needs of PPO: worlds that give returns, a chunk of them at a time."""
    ppo = SimpleNamespace(policy=net, num_timesteps=0, n_steps=7, env="timed", began=[])
    seen = torch.linspace(-1.0, 1.0, 12 * WIDTH).reshape(12, WIDTH)
    data = [SimpleNamespace(observations=each, returns=each.sum(dim=1)) for each in seen.split(5)]
    sizes: list[int] = []
    ppo.rollout_buffer = SimpleNamespace(get=lambda size: sizes.append(size) or data)
    ppo.sizes, ppo.data = sizes, data

    def collected(env: Any, callback: Any, buffer: Any, steps: int) -> None:
        assert (env, callback, buffer, steps) == ("timed", "callback", ppo.rollout_buffer, 7)
        ppo.num_timesteps += steps * ROBOTS

    ppo.collect_rollouts = collected
    ppo._setup_learn = lambda frames: (ppo.began.append(frames), "callback")
    return ppo


def descend(optimizer: Any, loss: Any) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def taught(net: Net, frames: int, rate: float, kept: int, batch: int) -> tuple[list[Any], list[int]]:
    """Teaches a network by the words of `teach`; returns what was driven, and the frames after each chunk."""
    worlds, generator, told, driven = Worlds(), np.random.default_rng(11), [], []
    cloned = round(0.8 * frames)
    adam = torch.optim.Adam([*net.mlp_extractor.policy_net.parameters(), *net.action_net.parameters()], rate)
    lessons = Lessons(min(kept, cloned), WIDTH, generator) if kept else None
    begun = 0
    while begun < cloned:
        # by chance, more and more robots drive by themselves: all from two thirds of the lessons on
        alone = generator.random(ROBOTS) < 1.5 * begun / cloned
        xs, ys = [], []
        for _ in range(8):
            x = worlds.now.copy()
            y = np.float32(np.sin(3.0 * (-0.6 * x[:, :2] + 0.1 * worlds.steps)))
            with torch.no_grad():
                own = net.get_distribution(torch.from_numpy(x)).mode().numpy()
            action = np.where(alone[:, None], own, y) + 0.1 * generator.standard_normal((ROBOTS, 2), np.float32)
            worlds.step_async(action)
            worlds.step_wait()
            driven.append(action)
            xs.append(x)
            ys.append(y)
        if lessons is None:
            x_all, y_all = (torch.from_numpy(np.concatenate(each)) for each in (xs, ys))
            for _ in range(2):
                order = torch.from_numpy(generator.permutation(8 * ROBOTS))
                for first in range(0, 8 * ROBOTS, batch):
                    rows = order[first : first + batch]
                    descend(adam, ((net.get_distribution(x_all[rows]).mode() - y_all[rows]) ** 2).mean())
        else:
            adam.param_groups[0]["lr"] = rate * (1.0 - 0.95 * begun / cloned)
            for x, y in list(zip(xs, ys, strict=True))[::2]:
                lessons.add(x, y)
            batches = list(lessons.batches(3 * 8 * ROBOTS // 2))
            assert len(batches) == max(1, round(72 / batch))  # three rows again for each of the 24 that came
            for x, y in batches:
                off = (net.get_distribution(x).mode() - y).abs()
                descend(adam, torch.where(off < 0.2, 0.5 * off**2 / 0.2, off - 0.1).mean())
        begun += 8 * ROBOTS
        told.append(begun)
    return driven, told


@pytest.mark.parametrize(
    ("kept", "frames", "batch"), [(0, 500, 2048), (40, 500, 2048), (10_000, 333, 2048), (0, 200, 20), (40, 200, 20)]
)
def test_a_network_is_taught_by_its_teacher_and_then_what_that_is_worth(
    kept: int, frames: int, batch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert imitation.BATCH == 2048
    monkeypatch.setattr(imitation, "BATCH", batch)
    net, other = Net(), Net()
    worlds, ppo = Worlds(), learner(net)
    told = list(teach(ppo, worlds, lambda speed: -speed, frames, 0.02, 11, kept))  # type: ignore[arg-type]
    driven, wanted = taught(other, frames, 0.02, kept, batch)
    np.testing.assert_allclose(np.array(worlds.driven), np.array(driven), atol=1e-5)
    assert len(worlds.told) == len(driven)
    assert sum(map(sum, worlds.told)) == sum(k % 9 < ROBOTS for k in range(1, len(driven) + 1))
    # then the value function, until the frames are used up
    adam = torch.optim.Adam([*other.mlp_extractor.value_net.parameters(), *other.value_net.parameters()], 0.02)
    worth = 0
    while worth < frames - len(driven) * ROBOTS:
        for data in ppo.data * 2:
            values = other.predict_values(data.observations).flatten()
            descend(adam, ((values - data.returns) ** 2).mean())
        worth += 7 * ROBOTS
        wanted.append(len(driven) * ROBOTS + worth)
    assert told == wanted
    assert ppo.began == [frames]
    assert set(ppo.sizes) == {batch}
    torch.testing.assert_close(net.numbers(), other.numbers(), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(net.numbers(), Net().numbers())
    assert (imitation.CHUNK, imitation.EPOCHS, imitation.EVERY, imitation.REPEATS) == (8, 2, 2, 3)


def test_lessons_are_a_reservoir_of_all_that_came() -> None:
    """Row by row: the first fill it, and each later one takes the place of one by chance or none."""
    lessons = Lessons(5, 1, np.random.default_rng(4))
    own, kept, came = np.random.default_rng(4), [0.0] * 5, 0
    for count in (3, 4, 9, 1, 20):
        numbers = [float(came + k) for k in range(count)]
        column = np.float32(numbers)[:, None]
        lessons.add(column, np.hstack([column, -column]))
        places = [int(each) for each in own.integers(0, np.arange(came, came + count) + 1)]
        for k, number in enumerate(numbers):
            at = came + k if came + k < 5 else places[k]
            if at < 5:
                kept[at] = number
        came += count
        there = min(came, 5)
        assert lessons._seen[:there, 0].tolist() == kept[:there]
        assert lessons._wanted[:there].tolist() == [[each, -each] for each in kept[:there]]
    assert len(list(lessons.batches(1))) == 1
    assert len(list(lessons.batches(5 * 2048))) == 5
    few = Lessons(5, 1, np.random.default_rng(0))
    few.add(np.float32([[7.0], [8.0]]), np.zeros((2, 2), np.float32))
    ((seen, wanted),) = few.batches(100)
    assert (set(seen.flatten().tolist()), seen.shape, wanted.shape) == ({7.0, 8.0}, (2048, 1), (2048, 2))


@pytest.mark.parametrize("remembered", [0, 1, 2, 3])
def test_how_an_action_changes(remembered: int) -> None:
    rng = np.random.default_rng(remembered)
    actions, before = rng.normal(size=(4, 2)), rng.normal(size=(4, remembered, 2))
    kept = copy.deepcopy(before)
    first = [[a - b for a, b in zip(x, past[0], strict=True)] if remembered else [0.0, 0.0]
             for x, past in zip(actions.tolist(), before.tolist(), strict=True)]  # fmt: skip
    second = [[a - 2.0 * b + c for a, b, c in zip(x, past[0], past[1], strict=True)] if remembered > 1 else [0.0, 0.0]
              for x, past in zip(actions.tolist(), before.tolist(), strict=True)]  # fmt: skip
    wanted = [[sum(v * v for v in each) for each in part] for part in (first, second)]
    np.testing.assert_allclose(changes_of(actions, before), wanted, rtol=1e-12)
    np.testing.assert_array_equal(before, kept)


@pytest.mark.parametrize("around", ["timed", "shaped"])
def test_what_is_asked_of_worlds_within_others_is_passed_on(around: str) -> None:
    """Word by word; what answers, answers for those outside."""
    space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
    inner = mock.Mock(num_envs=3, observation_space=space, action_space=space)
    inner.get_attr.return_value = [None] * 3
    env: Any
    if around == "timed":
        env = Timed(inner, {"environment": 0.0})
    else:
        env = Shaped.__new__(Shaped)
        env.worlds = inner
    inner.reset_mock()
    asked: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = [
        ("env_is_wrapped", (dict, [1]), {}),
        ("get_attr", ("dt", [0, 2]), {}),
        ("set_attr", ("dt", 0.1, [0]), {}),
        ("env_method", ("turn", 1, 2), {"indices": [2], "about": "z"}),
        ("close", (), {}),
    ]
    if around == "timed":
        asked += [("reset", (), {}), ("step_async", ("ahead",), {}), ("step_wait", (), {}), ("seed", (7,), {})]
    for name, words, named in asked:
        answer = getattr(env, name)(*words, **named)
        assert answer is (None if name in ("close", "set_attr", "step_async") else getattr(inner, name).return_value)
    assert inner.mock_calls == [mock.call.__getattr__(name)(*words, **named) for name, words, named in asked]
