"""Gymnasium environments for wheeled robots in the plane, with classical controllers as reference policies.

Importing `wayfield` registers the environment ids with Gymnasium and nothing more: compiled kernels, physics and
drawing are loaded when an environment is made, so that the import stays light.
"""

import importlib.metadata  # noqa: I001  what comes first is meant

import wayfield.starting  # before all that takes long
import wayfield.envs  # noqa: F401  registers the ids

__version__ = importlib.metadata.version("wayfield")
