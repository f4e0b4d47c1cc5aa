"""Keyword arguments of the environments: a wrong one is answered with the class of the id and the nearest."""

import inspect
import re
from typing import Any

import gymnasium
import pytest

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.scenarios import TASKS

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
