"""Scenarios: the courses of the source documents, random families, and the user's own files.

`path_scenarios` and `field_scenarios` return the bank of scenarios that an environment draws from at each reset, of
a task on paths and of one among obstacles; `split` returns a frozen split of a family.

The modules: `scenario` (what a scenario is), `obstacles` and `curves` (what it is built from), `path_presets`,
`goal_presets` and `fields` (the names), `path_families`, `goal_families` and `docking_families` (from a seed, with
`draws`, `tracing` and the searches of `ways`), `splits` (frozen seeds; `freeze` writes them), `tables` and `files`
(the user's files), `bank` (all of them by name). Each task as one value stands in `wayfield.envs.tasks.specs`.
"""

from wayfield.envs.scenarios.bank import field_scenarios, goal_scenarios, path_scenarios, scenarios_of
from wayfield.envs.scenarios.goal_presets import GOAL_SCENARIOS
from wayfield.envs.scenarios.obstacles import box, circle, moving_circle, obstacle_field, wall
from wayfield.envs.scenarios.path_presets import PATH_SCENARIOS
from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario, check_clear
from wayfield.envs.scenarios.splits import SPLITS, split
from wayfield.envs.tasks.specs import TASKS, TIERS, Cost, TaskSpec, spec_of, task_spec

FAMILIES = {name: spec.families for name, spec in TASKS.items()}  # by task and name

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
    "field_scenarios",
    "goal_scenarios",
    "moving_circle",
    "obstacle_field",
    "path_scenarios",
    "scenarios_of",
    "spec_of",
    "split",
    "task_spec",
    "wall",
]
