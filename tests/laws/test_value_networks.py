"""Value networks of the CrowdNav family from a user's file, against PyTorch's own layers, and what they drive."""

import itertools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.benchmarks.entrants.value_networks import PERSON, ValueNetwork, network
from wayfield.policies import Pilot

torch = pytest.importorskip("torch")
safetensors = pytest.importorskip("safetensors.torch")

Array = NDArray[Any]


def layers(*sizes: int, last: bool = False) -> Any:
    found: list[Any] = []
    for k, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        found += [torch.nn.Linear(inputs, outputs), *([torch.nn.ReLU()] if last or k < len(sizes) - 2 else [])]
    return torch.nn.Sequential(*found)


class Cadrl(torch.nn.Module):  # type: ignore[misc]
    def __init__(self) -> None:
        super().__init__()
        self.value_network = layers(PERSON, 20, 10, 1)

    def forward(self, states: Any) -> Any:
        return self.value_network(states).min(dim=1).values


class LstmRl(torch.nn.Module):  # type: ignore[misc]
    def __init__(self, pairwise: bool = False) -> None:
        super().__init__()
        if pairwise:
            self.mlp1 = layers(PERSON, 11, 9)
        self.lstm = torch.nn.LSTM(9 if pairwise else PERSON, 8, batch_first=True)
        self.mlp = layers(6 + 8, 12, 1)

    def forward(self, states: Any) -> Any:
        people = self.mlp1(states) if hasattr(self, "mlp1") else states
        return self.mlp(torch.cat([states[:, 0, :6], self.lstm(people)[1][0][0]], 1))


class Sarl(torch.nn.Module):  # type: ignore[misc]
    def __init__(self, whole: bool = True) -> None:
        super().__init__()
        self.whole = whole
        self.mlp1 = layers(PERSON, 15, 10, last=True)
        self.mlp2 = layers(10, 10, 5)
        self.attention = layers(20 if whole else 10, 10, 1)
        self.mlp3 = layers(6 + 5, 15, 1)

    def forward(self, states: Any) -> Any:
        seen = self.mlp1(states)
        mean = seen.mean(1, keepdim=True).expand(seen.shape)
        shares = torch.softmax(self.attention(torch.cat([seen, mean], 2) if self.whole else seen), 1)
        return self.mlp3(torch.cat([states[:, 0, :6], (shares * self.mlp2(seen)).sum(1)], 1))


KINDS = {"cadrl": Cadrl, "lstm": LstmRl, "pairs": lambda: LstmRl(True), "sarl": Sarl, "alone": lambda: Sarl(False)}


def drawn(kind: str, folder: Path, suffix: str = ".safetensors", seed: int = 0) -> tuple[Any, str]:
    """Returns a network of drawn weights, and its file."""
    torch.manual_seed(seed)
    made, file = KINDS[kind](), folder / f"{kind}{seed}{suffix}"
    if suffix == ".safetensors":
        safetensors.save_file(made.state_dict(), file)
    else:
        torch.save(made.state_dict(), file)
    return made, str(file)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("people", [1, 5])
def test_values_are_those_of_torch(kind: str, people: int, tmp_path: Path) -> None:
    made, file = drawn(kind, tmp_path)
    states = np.random.default_rng(people).normal(size=(50, people, PERSON)).astype(np.float32)
    with torch.no_grad():
        wanted = made(torch.from_numpy(states)).reshape(-1).numpy()
    np.testing.assert_allclose(network(file)(states), wanted, rtol=1e-4, atol=1e-5)


def test_a_pickle_drives_as_safetensors_do_and_is_warned_of(tmp_path: Path) -> None:
    states = np.ones((4, 3, PERSON), np.float32)
    _, plain = drawn("sarl", tmp_path)
    _, pickled = drawn("sarl", tmp_path, ".pth")
    with pytest.warns(UserWarning, match="is a pickle, of which tensors alone are read"):
        value = network(pickled)
    np.testing.assert_array_equal(value(states), network(plain)(states))
    torch.save({"hook": print}, tmp_path / "code.pth")  # a pickle that names a function is not loaded
    warned, refused = "code.pth is a pickle", "holds no plain dictionary of tensors"
    with pytest.raises(ValueError, match=refused), pytest.warns(UserWarning, match=warned):
        network(str(tmp_path / "code.pth"))


def test_an_onnx_graph_drives_as_its_network(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    weights = np.random.default_rng(0).normal(size=(PERSON, 1)).astype(np.float32)
    tensor = onnx.helper.make_tensor_value_info
    nodes = [onnx.helper.make_node("MatMul", ["states", "w"], ["each"])]
    nodes += [onnx.helper.make_node("ReduceMin", ["each"], ["value"], axes=[1], keepdims=0)]
    graph = onnx.helper.make_graph(
        nodes,
        "cadrl",
        [tensor("states", 1, ["b", "people", PERSON])],
        [tensor("value", 1, ["b", 1])],
        [onnx.numpy_helper.from_array(weights, "w")],
    )
    file = str(tmp_path / "cadrl.onnx")
    onnx.save(onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=8), file)
    states = np.random.default_rng(1).normal(size=(7, 4, PERSON)).astype(np.float32)
    np.testing.assert_allclose(network(file)(states), (states @ weights).min(axis=1)[:, 0], rtol=1e-5)


def crowd(count: int, seed: int) -> Any:
    """Returns what a robot along the x axis sees of people about it."""
    rng = np.random.default_rng(seed)
    bodies = np.zeros((1, 10, 7))
    bodies[0, :count] = np.column_stack([rng.uniform(-3, 3, (count, 2)), rng.uniform(-1, 1, (count, 2))] + 3 * [
        np.full((count, 1), 0.3)
    ])  # fmt: skip
    bodies[0, :count, 6] = 1.0
    order = np.argsort(np.hypot(bodies[0, :count, 0], bodies[0, :count, 1]))
    bodies[0, :count] = bodies[0, order]
    return SimpleNamespace(pose=np.zeros((1, 3)), goal=np.array([[3.0, 1.0]]), bodies=bodies)


@pytest.mark.parametrize("kind", KINDS)
def test_a_turned_world_is_driven_turned(kind: str, tmp_path: Path) -> None:
    """By sixteenths of a turn, which the velocities have; goal and people are told in the body's frame."""
    _, file = drawn(kind, tmp_path, seed=3)
    law = ValueNetwork(file)
    for seed in range(8):
        seen = crowd(5, seed)
        first = law.decided(seen, np.array([0]), 5, 0.3)[0]
        seen.pose[0, 2] = angle = 2.0 * math.pi * (seed + 1) / 16.0
        turned = law.decided(seen, np.array([0]), 5, 0.3)[0]
        wanted = np.exp(1j * angle) * complex(*first)
        assert complex(*turned) == pytest.approx(wanted, abs=1e-6)


def test_nobody_in_sight_is_a_straight_way_and_contact_is_avoided(tmp_path: Path) -> None:
    made, _ = drawn("cadrl", tmp_path)
    with torch.no_grad():
        for parameter in made.parameters():
            parameter.zero_()
    safetensors.save_file(made.state_dict(), tmp_path / "zero.safetensors")
    law = ValueNetwork(str(tmp_path / "zero.safetensors"))
    far = crowd(0, 0)
    assert law.decided(far, np.array([0]), 0, 0.3)[0] == pytest.approx(np.array([3.0, 1.0]) / math.sqrt(10.0))
    near = crowd(1, 0)  # without a value the reward decides: away from who would be touched
    near.bodies[0, 0, :5] = 0.65, 0.0, -1.0, 0.0, 0.3
    assert law.decided(near, np.array([0]), 1, 0.3)[0][0] < -0.5


def test_a_file_of_ones_own_drives_among_people_alone_as_among_others(tmp_path: Path) -> None:
    _, file = drawn("sarl", tmp_path)
    law = own_policy(f"{file} period=0.2").make({"file": file, "period": 0.2})
    poses = []
    for count in (1, 3):
        kwargs: Any = {"scenario": "crowdnav_5/test", "sees": "bodies", "vectorization_mode": "vector_entry_point"}
        env: Any = gymnasium.make_vec("wayfield/OmniPeople-v0", count, **kwargs)
        pilot = Pilot(law, env)
        seen, _ = env.reset(seed=0)
        pilot.reset()
        for _ in range(30):
            seen, *_ = env.step(pilot.act(seen))
        poses.append(env.task.layout.unpack(seen).pose[0])
        env.close()
    np.testing.assert_array_equal(*poses)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: folder / "absent.safetensors", "cannot be read"),
        (lambda folder: folder / "absent.onnx", "must be an ONNX graph|cannot be read"),
        (lambda folder: _with_maps(folder), "without occupancy maps"),
    ],
)
def test_what_is_no_such_network_is_refused_in_a_line(make: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        own_policy(str(make(tmp_path)))
    assert "\n" not in str(caught.value)


def _with_maps(folder: Path) -> Path:
    """Returns the file of a network that reads occupancy maps beside the states."""
    safetensors.save_file(
        {f"value_network.{k}": v for k, v in layers(61, 5, 1).state_dict().items()}, folder / "om.pth"
    )
    (folder / "om.pth").rename(folder / "om.safetensors")
    return folder / "om.safetensors"
