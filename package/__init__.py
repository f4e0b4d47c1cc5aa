"""Gymnasium environments for wheeled robots in the plane, with classical controllers as reference policies.

Importing `wayfield` registers the environment ids with Gymnasium and nothing more: compiled kernels, physics and
drawing are loaded when an environment is made, so that the import stays light.
"""

import importlib.metadata  # noqa: I001  what comes first is meant
from typing import TYPE_CHECKING, Any

import wayfield.starting  # before all that takes long
import wayfield.envs  # noqa: F401  registers the ids

if TYPE_CHECKING:
    from wayfield.envs.robots.symbolic import Symbolic

    symbolic = Symbolic

__version__ = importlib.metadata.version("wayfield")


def parallel_env(env_id: str, **kwargs: Any) -> Any:
    """Returns a world of a registered id as a `pettingzoo.ParallelEnv`: see `wayfield.envs.parallel.ParallelWorld`.

    Raises:
        DependencyNotInstalled: without PettingZoo.
        ValueError: if the id is none of a team's, or a keyword is wrong.
    """
    from wayfield.envs.parallel import ParallelWorld

    return ParallelWorld(env_id, **kwargs)


def __getattr__(name: str) -> Any:
    """Returns `symbolic`, the robots' CasADi model: see `wayfield.envs.robots.symbolic.Symbolic`."""
    if name == "symbolic":
        from wayfield.envs.robots.symbolic import Symbolic

        return Symbolic
    raise AttributeError(f"module 'wayfield' has no attribute {name!r}")
