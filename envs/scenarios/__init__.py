"""Scenarios: the courses of the source documents, random families, and the user's own files.

`path_scenarios` and `goal_scenarios` return the bank of scenarios that an environment draws from at each reset; `split`
returns a frozen split of a family.

The modules: `scenario` (what a scenario is), `obstacles` and `curves` (what it is built from), `path_presets`,
`goal_presets` and `fields` (the names), `path_families` and `goal_families` (from a seed, with `draws`, `tracing` and
the searches of `ways`), `tasks` (each task as one value), `splits` (frozen seeds; `freeze` writes them), `tables` and
`files` (the user's files), `bank` (all of them by name).
"""

from wayfield.envs.scenarios.bank import goal_scenarios, path_scenarios
from wayfield.envs.scenarios.goal_presets import GOAL_SCENARIOS
from wayfield.envs.scenarios.obstacles import box, circle, moving_circle, obstacle_field, wall
from wayfield.envs.scenarios.path_presets import PATH_SCENARIOS
from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario, check_clear
from wayfield.envs.scenarios.splits import SPLITS, split
from wayfield.envs.scenarios.tasks import FAMILIES, TASKS, TIERS, Cost, TaskSpec, task_spec

__all__ = [
    "FAMILIES",
    "GOAL_SCENARIOS",
    "PATH_SCENARIOS",
    "SPLITS",
    "TASKS",
    "TIERS",
    "Cost",
    "GoalScenario",
    "PathScenario",
    "TaskSpec",
    "box",
    "check_clear",
    "circle",
    "goal_scenarios",
    "moving_circle",
    "obstacle_field",
    "path_scenarios",
    "split",
    "task_spec",
    "wall",
]
