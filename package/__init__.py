"""Gymnasium environments for wheeled robots in the plane, with classical controllers as reference policies.

Importing `wayfield` registers the environment ids with Gymnasium and nothing more: compiled kernels, physics and
drawing are loaded when an environment is made, so that the import stays light.
"""

import importlib.metadata  # noqa: I001  what comes first is meant
from typing import Any

import wayfield.starting  # before all that takes long
import wayfield.envs  # noqa: F401  registers the ids

__version__ = importlib.metadata.version("wayfield")


def parallel_env(env_id: str, **kwargs: Any) -> Any:
    """Returns a world of a registered id as a `pettingzoo.ParallelEnv`: see `wayfield.envs.parallel.ParallelWorld`.

    Raises:
        DependencyNotInstalled: without PettingZoo.
        ValueError: if the id is none of a team's, or a keyword is wrong.
    """
    from wayfield.envs.parallel import ParallelWorld

    return ParallelWorld(env_id, **kwargs)
