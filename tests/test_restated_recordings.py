"""What a recording leaves, field by field: Minari's files, an MCAP file's messages, and what is told of a policy."""

import dataclasses
import hashlib
import json
import math
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wayfield.benchmarks import comparison
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.contests import CONTESTS
from wayfield.envs.engines import Failed

pytest.importorskip("mcap", reason='needs pip install "wayfield[record]"')
pytest.importorskip("minari", reason='needs pip install "wayfield[record]"')

from wayfield.benchmarks import mcap_file, minari_set, record
from wayfield.benchmarks.recorder import Episode, Start
from wayfield.envs.robots import ROBOTS


def episode(seed: int, steps: int) -> Episode:
    rng = np.random.default_rng(seed)
    return Episode(
        Start(seed, seed + 1), rng.random((steps + 1, 3), np.float32), rng.random((steps, 2), np.float32),
        rng.random(steps), np.arange(steps) == steps - 1, np.zeros(steps, bool),
        {"a": rng.random(steps + 1), "b": rng.random(steps + 1) < 0.5},
    )  # fmt: skip


def test_what_is_recorded_and_what_minari_makes_again_are_one_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    conditions = record.Conditions("validation", ROBOTS["omni4"], "pymunk", "slow", "light", "default", 0.25)
    (source,) = record.sources(CONTESTS["goal-obstacles"], ("orca",), ("rooms",), 3, 5, conditions)
    case = source.case
    assert (case.policy, case.gains_name, case.scenario) == ("orca", "default", "rooms/validation")
    assert [(start.seed, start.scenario) for start in source.starts] == [(5, 0), (6, 1), (7, 2)]
    vectors: list[Any] = []
    recorded: list[Any] = []

    def vector(*words: Any) -> Any:
        vectors.append(words)
        return types.SimpleNamespace(close=lambda: None)

    monkeypatch.setattr(record, "make_vector", vector)
    monkeypatch.setattr(record, "robots_for", lambda env, starts: 2)
    monkeypatch.setattr(record, "record", lambda env, policy, *words: recorded.append(words) or iter([(0, "it")]))
    assert list(record.recorded(dataclasses.replace(source, first=4), conditions)) == [(4, "it")]
    assert vectors == [(case, "pymunk", "slow", count) for count in (1, 2)]
    assert recorded == [(source.starts, 0.25)]
    made: list[Any] = []
    monkeypatch.setattr(record.gymnasium, "make", lambda env_id, **told: made.append((env_id, told)))
    record.single(case, conditions)
    assert made == [
        (
            "wayfield/OmniGoalObstacles-v0",
            {
                **{"scenario": "rooms/validation", "dynamics": "pymunk", "actuators": "slow", "robot": "omni4"},
                **{"disturbance": "light", "num_beams": 72, "max_range": 5.0, "max_episode_steps": 1200},
            },
        )
    ]


def test_a_set_s_files_hold_its_episodes_and_what_is_told_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []
    updated: list[Any] = []
    storage = types.SimpleNamespace(update_metadata=updated.append)

    def new(folder: Path, **more: Any) -> Any:
        made.append((folder, more))
        folder.mkdir(parents=True)
        return storage

    monkeypatch.setattr(minari_set.MinariStorage, "new", new)
    env: Any = types.SimpleNamespace(observation_space="o", action_space="a", spec="s")
    found = minari_set.MinariSet(tmp_path, env)
    ((folder, more),) = made
    assert folder == tmp_path / "data"
    assert (more["observation_space"], more["action_space"], more["env_spec"]) == ("o", "a", "s")
    assert (more["data_format"], more["jpeg_encoding"]) == ("arrow", False)
    driven = {7: episode(7, 4), 2: episode(2, 9), 11: episode(11, 1)}
    for number, each in driven.items():
        found.write(number, each, {"policy": f"p{number}"})
        told = json.loads((folder / str(number) / "metadata.json").read_text(encoding="utf-8"))
        assert told == {
            "id": number, "total_steps": len(each.actions), "seed": number, "options": {"scenario": number + 1},
            minari_set.KEY: {"policy": f"p{number}"},
        }  # fmt: skip
        with minari_set.pa.memory_map(str(folder / str(number) / "part-0.arrow")) as source:
            columns = minari_set.pa.ipc.open_file(source).read_all().to_pydict()
        assert np.array_equal(np.array(columns["observations"], np.float32), each.observations)
        for name, values in (("actions", each.actions), ("rewards", each.rewards), ("terminations", each.terminations),
                             ("truncations", each.truncations)):  # fmt: skip
            rows = np.array(columns[name])
            assert len(rows) == len(each.observations)
            assert np.array_equal(rows[:-1].astype(values.dtype), values)
            assert not rows[-1].any()
        assert [told["a"] for told in columns["infos"]] == each.infos["a"].tolist()
        assert [told["b"] for told in columns["infos"]] == each.infos["b"].tolist()
    digest = found.close("x/y-v0", {"command": "c"}, description="d")
    wanted = hashlib.sha256(b"".join(driven[number].digest() for number in (2, 7, 11))).hexdigest()
    assert digest == wanted
    size = sum(minari_set.table(each).nbytes for each in driven.values())
    assert updated == [
        {
            "dataset_id": "x/y-v0", "minari_version": minari_set.minari.__version__, "total_episodes": 3,
            "total_steps": 14, "dataset_size": round(size / 1e6, 1), "description": "d",
            minari_set.KEY: {"command": "c", "digest": wanted},
        }
    ]  # fmt: skip
    found._bytes = 2_345_678
    found.close("x", {})
    assert updated[1]["dataset_size"] == 2.3


def test_what_is_read_back_has_the_digest_of_what_was_driven() -> None:
    driven = {5: episode(5, 3), 1: episode(1, 2)}
    storage = types.SimpleNamespace(
        get_episodes=lambda numbers: [
            {"observations": e.observations, "actions": e.actions, "rewards": e.rewards,
             "terminations": e.terminations, "truncations": e.truncations, "infos": e.infos}
            for e in (driven[k] for k in numbers)
        ],
        get_episode_metadata=lambda numbers: [
            {"seed": driven[k].start.seed, "options": {"scenario": driven[k].start.scenario}} for k in numbers
        ],
    )  # fmt: skip
    dataset: Any = types.SimpleNamespace(storage=storage, episode_indices=np.array([5, 1]))
    assert minari_set.digest_of(dataset) == minari_set.digest_of_digests({k: e.digest() for k, e in driven.items()})
    one = driven[5]
    digests = {one.digest()}
    for change in (
        {"start": Start(5, 7)}, {"start": Start(6, 6)}, {"observations": one.observations + 1},
        {"actions": -one.actions},
        {"rewards": one.rewards + 1}, {"terminations": ~one.terminations}, {"truncations": ~one.truncations},
        {"infos": one.infos | {"a": one.infos["a"] + 1}}, {"infos": {"c": one.infos["a"], "b": one.infos["b"]}},
    ):  # fmt: skip
        digests.add(dataclasses.replace(one, **change).digest())
    assert len(digests) == 10


def test_what_there_is_to_say_of_a_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclasses.dataclass
    class Policy:
        k: float = 1.5
        n: int = 3
        name: str = "x"
        flag: bool = True
        other: Any = None
        knows = "scan"

    monkeypatch.setattr(record, "make_policy", lambda case, seed: Policy(k=2.5))
    case = Case("a", "b", "id", "c", "lqr", gains_name="tuned")
    assert record._card(case) == {
        "policy": "lqr", "gains_name": "tuned", "gains": {"k": 2.5, "n": 3, "name": "x", "flag": True}, "knows": "scan",
    }  # fmt: skip


# ---- an MCAP file


def test_times_poses_and_numbers_as_foxglove_has_them() -> None:
    assert mcap_file._stamp(12.05) == {"sec": 12, "nsec": 50_000_000}
    assert mcap_file._stamp(0.1 + 0.2) == {"sec": 0, "nsec": 300_000_000}
    pose = mcap_file._pose(1.0, 2.0, 0.6, 3.0)
    assert pose["position"] == {"x": 1.0, "y": 2.0, "z": 3.0}
    turned = pose["orientation"]
    assert (turned["x"], turned["y"]) == (0.0, 0.0)
    assert (turned["z"], turned["w"]) == (math.sin(0.3), math.cos(0.3))
    assert mcap_file._pose(1.0, 2.0, 0.6)["position"]["z"] == 0.0
    assert [mcap_file._plain(each) for each in (np.bool_(True), False, 1, np.float32(0.5), math.nan, math.inf)] == [
        True, False, 1.0, 0.5, None, None,
    ]  # fmt: skip
    assert mcap_file._plain(True) is True


def test_topics_are_registered_and_messages_stand_at_their_times() -> None:
    schemas: list[Any] = []
    channels: list[Any] = []
    messages: list[Any] = []
    writer: Any = types.SimpleNamespace(
        register_schema=lambda *words: schemas.append(words) or 10 * len(schemas),
        register_channel=lambda *words: channels.append(words) or 100 + len(channels),
        add_message=lambda *words: messages.append(words),
    )
    said = mcap_file._File(writer)
    assert [(name, kind) for name, kind, _ in schemas] == [
        (name, "jsonschema") for name, _ in mcap_file.TOPICS.values()
    ]
    for (_, _, text), (name, fields) in zip(schemas, mcap_file.TOPICS.values(), strict=True):
        assert json.loads(text) == {
            "type": "object", "title": name, "properties": {field: {"type": kind} for field, kind in fields.items()},
        }  # fmt: skip
    assert channels == [(topic, "json", 10 * (k + 1)) for k, topic in enumerate(mcap_file.TOPICS)]
    said.say("/scan", 1.25, {"a": 1})
    assert messages == [(102, 1_250_000_000, b'{"a": 1}', 1_250_000_000)]


def _obstacle(**cells: float) -> Any:
    names = ("x", "y", "sin", "cos", "radius", "half_length", "half_width")
    found = np.zeros(1, [(name, float) for name in names])
    for name, value in cells.items():
        found[name] = value
    return found[0]


def test_obstacles_hulls_and_lines_are_drawn_to_scale() -> None:
    pose = {"x": 1.0, "y": 2.0, "sin": math.sin(0.8), "cos": math.cos(0.8)}
    ((kind, (disc,)),) = mcap_file._shape(_obstacle(radius=0.3, **pose)).items()
    assert kind == "cylinders"
    assert disc["size"] == {"x": 0.6, "y": 0.6, "z": 0.5}
    assert disc["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 0.25}
    assert 2.0 * math.atan2(disc["pose"]["orientation"]["z"], disc["pose"]["orientation"]["w"]) == pytest.approx(0.8)
    assert (disc["bottom_scale"], disc["top_scale"]) == (1.0, 1.0)
    ((kind, (box,)),) = mcap_file._shape(_obstacle(half_length=0.7, half_width=0.2, **pose)).items()
    assert kind == "cubes"
    assert box["size"] == {"x": 1.4, "y": 0.4, "z": 0.5}
    (wall,) = mcap_file._shape(_obstacle(half_length=0.7, **pose))["cubes"]
    assert wall["size"] == {"x": 1.4, "y": 0.01, "z": 0.5}
    (across,) = mcap_file._shape(_obstacle(half_width=0.7, **pose))["cubes"]
    assert across["size"] == {"x": 0.01, "y": 1.4, "z": 0.5}
    for robot in ROBOTS.values():
        hull = mcap_file._hull(robot)
        assert (hull["id"], hull["frame_id"], hull["frame_locked"]) == ("hull", "base", True)
        shapes = hull["cylinders"] if robot.hull_box is None else hull["cubes"]
        (shape,) = shapes
        length, width = robot.hull_box or (2.0 * robot.hull_radius, 2.0 * robot.hull_radius)
        assert shape["size"] == {"x": length, "y": width, "z": 0.5}
        assert shape["pose"]["position"] == {"x": 0.0, "y": 0.0, "z": 0.25}
        assert not (hull["cubes"] if robot.hull_box is None else hull["cylinders"])
    line = mcap_file._line(np.array([[1.0, 2.0], [3.0, 4.0]]))
    assert line["points"] == [{"x": 1.0, "y": 2.0, "z": 0.0}, {"x": 3.0, "y": 4.0, "z": 0.0}]
    assert (line["type"], line["scale_invariant"], line["thickness"]) == (0, False, 0.02)
    entity = mcap_file._entity("it", 1.5, {"cubes": [1]})
    assert entity["timestamp"] == {"sec": 1, "nsec": 500_000_000}
    assert entity["lifetime"] == {"sec": 0, "nsec": 0}
    assert (entity["frame_id"], entity["id"], entity["frame_locked"], entity["cubes"]) == ("map", "it", False, [1])
    assert all(
        entity[name] == [] for name in ("arrows", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    )


def test_what_stands_still_is_the_path_or_the_goals() -> None:
    def still(**drawn: Any) -> list[dict[str, Any]]:
        task = types.SimpleNamespace(drawing=lambda state: drawn)
        return mcap_file._still(types.SimpleNamespace(task=task, batch=types.SimpleNamespace(states=[0])))

    (path,) = still(path=np.array([[0.0, 1.0]]))
    assert path["id"] == "path"
    assert path["lines"][0]["points"] == [{"x": 0.0, "y": 1.0, "z": 0.0}]
    one, two = still(goals=[[1.0, 2.0, 0.5], [3.0, 4.0, math.nan]], path=None)
    assert [one["id"], two["id"]] == ["goal 0", "goal 1"]
    for each, heading in ((one, 0.5), (two, 0.0)):
        (arrow,) = each["arrows"]
        assert arrow["pose"]["orientation"]["z"] == math.sin(0.5 * heading)
    assert two["arrows"][0]["pose"]["position"] == {"x": 3.0, "y": 4.0, "z": 0.0}
    assert still() == []


class Said:
    def __init__(self) -> None:
        self.told: list[Any] = []

    def say(self, topic: str, time: float, message: Any) -> None:
        self.told.append((topic, time, message))


def test_a_scan_is_told_with_the_angles_of_its_ends() -> None:
    said: Any = Said()
    angles = np.array([-1.0, 0.0, 1.5])
    for ranges in ({"ranges": np.array([1.0, 2.0, 3.0], np.float32)}, {"ranges": np.empty(0)}, {}):
        layout = types.SimpleNamespace(unpack=lambda seen, ranges=ranges: types.SimpleNamespace(**ranges))
        base = types.SimpleNamespace(task=types.SimpleNamespace(layout=layout, beam_angles=angles))
        mcap_file._say_scan(said, base, 0.5, np.zeros(3, np.float32))
    ((topic, time, told),) = said.told
    assert (topic, time) == ("/scan", 0.5)
    assert (told["start_angle"], told["end_angle"], told["ranges"]) == (-1.0, 1.5, [1.0, 2.0, 3.0])
    assert (told["frame_id"], told["intensities"]) == ("base", [])
    assert told["timestamp"] == {"sec": 0, "nsec": 500_000_000}


class Scene:
    """An environment of a robot that steps to the right, with an obstacle that moves at the second step."""

    def __init__(self, moves: bool, count: int = 1) -> None:
        self.unwrapped, self.moves, self.k, self.resets = self, moves, 0, []
        field = [("x", float), ("y", float), ("heading", float), ("field", int)]
        self.batch = types.SimpleNamespace(states=np.zeros(1, field), told_obstacles=None)
        options = types.SimpleNamespace(dt=0.05)
        layout = types.SimpleNamespace(unpack=lambda seen: types.SimpleNamespace())
        self.task = types.SimpleNamespace(
            options=options, layout=layout, obstacle_counts=lambda states: np.array([count]), robot=ROBOTS["p3dx"],
            drawing=lambda state: {"path": np.array([[0.0, 0.0]])},
        )  # fmt: skip

    def _seen(self) -> Any:
        self.batch.states["x"], self.batch.states["y"], self.batch.states["heading"] = self.k, 0.5, 0.1 * self.k
        self.batch.states["field"] = 1
        cells = [
            _obstacle(radius=9.0),
            _obstacle(radius=0.2, x=float(self.moves and self.k > 1)),
            _obstacle(radius=0.9),
        ]
        self.batch.told_obstacles = np.array([[cells[0]] * 2, [cells[1], cells[2]]], cells[0].dtype)
        return np.array([float(self.k)], np.float32)

    def reset(self, seed: int, options: Any) -> Any:
        self.resets.append((seed, options))
        return self._seen(), {"a": 0.0, "b": math.nan}

    def step(self, action: Any) -> Any:
        self.k += 1
        return self._seen(), float(10 * self.k), False, False, {"a": float(self.k), "b": np.bool_(True)}


@pytest.mark.parametrize("moves", [False, True])
def test_an_episode_is_told_step_by_step(moves: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: Any = Said()
    metadata: list[Any] = []
    writer = types.SimpleNamespace(
        start=lambda library: metadata.append(library), add_metadata=lambda *words: metadata.append(words),
        finish=lambda: metadata.append("finish"),
    )  # fmt: skip
    monkeypatch.setattr(mcap_file, "Writer", lambda stream, compression: writer)
    monkeypatch.setattr(mcap_file, "_File", lambda _: said)
    env: Any = Scene(moves)
    observed = np.arange(4.0, dtype=np.float32)[:, None]
    driven = dataclasses.replace(episode(5, 3), observations=observed)
    mcap_file.write_mcap(tmp_path / "a.mcap", env, driven, {"policy": "p", "seed": 5})
    assert env.resets == [(5, {"scenario": 6})]
    assert metadata == ["wayfield", ("episode", {"policy": "p", "seed": "5"}), "finish"]
    assert (tmp_path / "a.mcap").exists()
    by_topic: dict[str, list[Any]] = {}
    for topic, time, message in said.told:
        by_topic.setdefault(topic, []).append((time, message))
    times = [0.0, 0.05, 0.1, pytest.approx(0.15)]
    assert [time for time, _ in by_topic["/tf"]] == times
    for k, (time, told) in enumerate(by_topic["/tf"]):
        assert (told["parent_frame_id"], told["child_frame_id"]) == ("map", "base")
        assert told["translation"] == {"x": float(k), "y": 0.5, "z": 0.0}
        assert told["rotation"]["z"] == math.sin(0.05 * k)
        assert told["timestamp"] == mcap_file._stamp(time)
    rewards = [(told["reward"], told["a"], told["b"]) for _, told in by_topic["/told"]]
    assert rewards == [(0.0, 0.0, None), (10.0, 1.0, True), (20.0, 2.0, True), (30.0, 3.0, True)]
    assert [told["action"] for _, told in by_topic["/action"]] == driven.actions.tolist()
    scenes = by_topic["/scene"]
    assert [time for time, _ in scenes] == ([0.0, 0.1] if moves else [0.0])
    assert [each["id"] for each in scenes[0][1]["entities"]] == ["obstacle 0", "hull", "path"]
    for k, (time, told) in enumerate(scenes):
        (obstacle, *more) = told["entities"]
        assert (more == []) is (k > 0)
        assert told["deletions"] == []
        assert obstacle["timestamp"] == mcap_file._stamp(time)
        assert obstacle["cylinders"][0]["size"]["x"] == 0.4
        assert obstacle["cylinders"][0]["pose"]["position"]["x"] == float(k)
    other = dataclasses.replace(driven, observations=observed + (np.arange(4) == 2)[:, None])
    with pytest.raises(ValueError, match="drives differently from step 2 on"):
        mcap_file.write_mcap(tmp_path / "b.mcap", Scene(moves), other, {})  # type: ignore[arg-type]
    assert not (tmp_path / "b.mcap").exists()
    # where nothing stands the first scene still has the robot, and what does not move
    said.told.clear()
    mcap_file.write_mcap(tmp_path / "c.mcap", Scene(moves, 0), driven, {})  # type: ignore[arg-type]
    (empty,) = (told for topic, _, told in said.told if topic == "/scene")
    assert [each["id"] for each in empty["entities"]] == ["hull", "path"]


# ---- rows of a comparison, as they come


def test_rows_come_in_the_order_of_settings_whatever_is_done_first(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    failure = Failed.__new__(Failed)
    monkeypatch.setattr(comparison, "sent", lambda engine, function, settings: (function, settings))
    for count in (1, 4, 9):
        for lost in (0, 1):
            order = rng.permutation(count).tolist()
            missing = set(order[-lost:]) if lost else set()
            found: list[str] = []

            def as_done(
                function: Any, settings: Any, order: Any = order, missing: Any = missing, found: Any = found
            ) -> Iterator[Any]:
                for j, k in enumerate(order):
                    # what all before it are done with has been told by now
                    told = next((i for i in range(len(order)) if i not in order[:j]), len(order))
                    assert len(found) == 2 * told
                    if k not in missing:
                        yield k, [f"{k}a", f"{k}b"]
                if missing:
                    raise failure

            engine: Any = types.SimpleNamespace(as_done=as_done)
            failures: list[Any] = []
            found += comparison._in_order(engine, list(range(count)), failures)  # type: ignore[arg-type]
            assert found == [f"{k}{each}" for k in range(count) if k not in missing for each in "ab"]
            assert failures == [failure] * lost
