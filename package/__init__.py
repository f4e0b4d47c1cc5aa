"""Gymnasium environments for wheeled robots in the plane, with classical controllers as reference policies.

Importing `wayfield` registers the environment ids with Gymnasium and nothing more: compiled kernels, physics and
drawing are loaded when an environment is made, so that the import stays light.
"""

import wayfield.starting  # noqa: I001  before all that takes long
import wayfield.envs  # noqa: F401  registers the ids
