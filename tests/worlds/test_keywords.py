"""Keyword arguments of the environments: a wrong one is answered with the class of the id and the nearest."""

import inspect
import re
import warnings
from typing import Any

import gymnasium
import pytest

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.scenarios import TASKS
from wayfield.system.objects import FileNote

IDS = [env_id for spec in TASKS.values() for env_id in spec.ids.values()]


@pytest.mark.parametrize("env_id", IDS)
def test_a_wrong_keyword_names_the_class_of_the_id_and_the_nearest_keyword(env_id: str) -> None:
    name = env_id.removeprefix("wayfield/").removesuffix("-v0")
    with pytest.raises(
        TypeError, match=rf"^{name} got an unexpected keyword argument 'scenari'. Did you mean 'scenario'\?"
    ):
        gymnasium.make(env_id, scenari="x")
    with pytest.raises(
        TypeError, match=rf"^{name} got an unexpected keyword argument 'scenari'. Did you mean 'scenario'\?"
    ):
        gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point", scenari="x")


def test_a_wrong_keyword_is_told_in_the_words_of_python() -> None:
    # TorchRL's GymEnv makes every environment with this keyword, and without it where the error has these words
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        gymnasium.make(IDS[0], frameskip=1)


def test_a_seed_is_for_reset() -> None:
    for made in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(TypeError, match=r"reset\(seed=3\)"):
            made(IDS[0], seed=3)


@pytest.mark.parametrize("env_id", IDS)
def test_an_argument_that_is_set_afterwards_is_refused_and_any_other_attribute_is_not(env_id: str) -> None:
    env = gymnasium.make(env_id, disable_env_checker=True)
    for name in ("scenario", "robot", "actuators", "disturbance", "dynamics", "noise"):
        with pytest.raises(AttributeError, match=rf"^{name} is read when .*make\(id, {name}=\.\.\.\)"):
            setattr(env.unwrapped, name, "x")
    env.unwrapped.level = 3
    env.unwrapped.render_mode = "rgb_array"
    env.reset(seed=0)
    assert env.get_wrapper_attr("level") == 3
    assert env.render().ndim == 3


def test_a_wrong_keyword_of_a_batch_is_answered_with_those_of_batches_too() -> None:
    with pytest.raises(TypeError, match="Did you mean 'num_threads'"):
        gymnasium.make_vec(IDS[0], 2, vectorization_mode="vector_entry_point", num_thread=2)


@pytest.mark.parametrize("env_id", IDS)
def test_an_editor_shows_the_arguments_that_the_sheet_tells(env_id: str) -> None:
    kind: Any = type(gymnasium.make(env_id, disable_env_checker=True).unwrapped)
    section = kind.__doc__.partition("## Arguments")[2].partition("##")[0]
    told = re.findall(r"^\s*\| ([a-z_, ]+) \|", section, re.MULTILINE)[1:]
    assert sorted(", ".join(told).split(", ")) == sorted(inspect.signature(kind).parameters)


@pytest.mark.parametrize("argument", ["num_preview", "preview_spacing"])
def test_a_truth_is_no_number(argument: str) -> None:
    with pytest.raises(ValueError, match=f"{argument} must be a .*number.*, got True"):
        gymnasium.make("wayfield/DiffDrivePathFollowing-v0", disable_env_checker=True, **{argument: True})


@pytest.mark.parametrize(
    ("task", "given", "said"),
    [
        ("goal_reaching", {"max_range": 5000.0}, "max_range is 5000 m, usual is 0.05 to 300"),
        ("docking", {"noise": 100.0}, "noise is 100 times"),
        ("goal_reaching", {"shove": (2.0, 50.0, 0.0, 0.1)}, r"shove\[1\] is 50 m"),
        ("path_following", {"shove": (2.0, 0.1, 0.0, 90.0)}, r"shove\[3\] is 90 rad"),
        ("path_following", {"shove": (2000.0, 0.1, 0.0, 0.1)}, r"shove\[0\] is 2000 s"),
        ("trajectory_tracking", {"preview_spacing": 100.0}, "preview_spacing is 100 m, or s"),
        ("path_following", {"scale": 1000.0}, "scale is 1000"),
        ("path_following", {"noise": 3.0, "shove": (0.0, -1.0, 0.5, -3.0)}, ""),
    ],
)
def test_keywords_in_other_units_are_doubted_in_a_line(task: str, given: dict[str, Any], said: str) -> None:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        gymnasium.make(TASKS[task].ids[False], disable_env_checker=True, **given).close()
    lines = [str(each.message) for each in found if issubclass(each.category, FileNote)]
    assert [bool(re.match(said, each)) for each in lines] == [True] * bool(said)
