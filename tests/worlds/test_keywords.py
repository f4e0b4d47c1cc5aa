"""Keyword arguments of the environments: a wrong one is answered with the class of the id and the nearest."""

import gymnasium
import pytest

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.scenarios import TASKS

IDS = [env_id for spec in TASKS.values() for env_id in spec.ids.values()]


@pytest.mark.parametrize("env_id", IDS)
def test_a_wrong_keyword_names_the_class_of_the_id_and_the_nearest_keyword(env_id: str) -> None:
    name = env_id.removeprefix("wayfield/").removesuffix("-v0")
    with pytest.raises(TypeError, match=rf"^{name} has no keyword argument 'scenari'. Did you mean 'scenario'\?"):
        gymnasium.make(env_id, scenari="x")
    with pytest.raises(TypeError, match=rf"^{name} has no keyword argument 'scenari'. Did you mean 'scenario'\?"):
        gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point", scenari="x")


def test_a_wrong_keyword_of_a_batch_is_answered_with_those_of_batches_too() -> None:
    with pytest.raises(TypeError, match="Did you mean 'num_threads'"):
        gymnasium.make_vec(IDS[0], 2, vectorization_mode="vector_entry_point", num_thread=2)
