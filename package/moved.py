"""Modules under their names before 0.2: each is the module of today, with a warning, for one release."""

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import warnings
from collections.abc import Sequence
from types import CodeType, ModuleType
from typing import Any

MOVED = {
    "wayfield.benchmarks.comparison": "wayfield.benchmarks.commands.comparison",
    "wayfield.benchmarks.coppelia": "wayfield.benchmarks.commands.coppelia",
    "wayfield.benchmarks.decisions": "wayfield.benchmarks.runs.decisions",
    "wayfield.benchmarks.evaluate": "wayfield.benchmarks.commands.evaluate",
    "wayfield.benchmarks.metrics": "wayfield.benchmarks.episodes.metrics",
    "wayfield.benchmarks.play": "wayfield.benchmarks.commands.play",
    "wayfield.benchmarks.record": "wayfield.benchmarks.recordings.record",
    "wayfield.benchmarks.results": "wayfield.benchmarks.records.results",
    "wayfield.benchmarks.rollout": "wayfield.benchmarks.episodes.rollout",
    "wayfield.benchmarks.tune": "wayfield.benchmarks.tuning.tune",
    "wayfield.benchmarks.tune_all": "wayfield.benchmarks.tuning.tune_all",
    "wayfield.benchmarks.video": "wayfield.benchmarks.figures.video",
    "wayfield.envs.briefing": "wayfield.envs.tasks.briefing",
    "wayfield.envs.checks": "wayfield.system.checks",
    "wayfield.envs.compiled": "wayfield.system.compiled",
    "wayfield.envs.disturbances": "wayfield.envs.robots.disturbances",
    "wayfield.envs.geometry": "wayfield.envs.world.geometry",
    "wayfield.envs.grids": "wayfield.envs.world.grids",
    "wayfield.envs.kinematics": "wayfield.envs.robots.kinematics",
    "wayfield.envs.observation": "wayfield.envs.tasks.observation",
    "wayfield.envs.paths": "wayfield.envs.world.paths",
    "wayfield.envs.patrols": "wayfield.envs.world.movers",
    "wayfield.envs.specs": "wayfield.envs.tasks.specs",
    "wayfield.envs.task": "wayfield.envs.tasks.task",
}


class _Moved(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds a module under its old name; `python -m` runs it under that too."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname not in MOVED:
            return None
        warnings.warn(f"{fullname} is {MOVED[fullname]} now", DeprecationWarning, stacklevel=2)
        today: Any = importlib.util.find_spec(MOVED[fullname])
        return importlib.util.spec_from_file_location(fullname, today.origin, loader=self)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        return importlib.import_module(MOVED[spec.name])

    def exec_module(self, module: ModuleType) -> None:
        """Does nothing: it has been executed under its name of today."""

    def get_code(self, fullname: str) -> CodeType:
        """Returns the code of the module of today, for `python -m`."""
        spec: Any = importlib.util.find_spec(MOVED[fullname])
        code: CodeType = spec.loader.get_code(MOVED[fullname])
        return code


sys.meta_path.append(_Moved())
