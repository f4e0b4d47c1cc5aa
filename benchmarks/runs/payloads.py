"""Settings on their way to machines that have none of this one's files: a setting travels with the files it names."""

import contextlib
import dataclasses
import functools
import hashlib
import importlib.util
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from wayfield.benchmarks.entrants.own_policies import OwnClass, OwnModel, OwnNetwork, imported
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.run_folder import file_digest
from wayfield.benchmarks.runs.suite import Setting
from wayfield.policies.trained.ppo import trained
from wayfield.system.executors import Executor


@dataclasses.dataclass(frozen=True)
class Payload:
    """A setting, and the content of the files that it names, by their path on the machine that it comes from."""

    setting: Setting
    files: Mapping[str, bytes]

    def __str__(self) -> str:
        return str(self.setting)


def sent(
    executor: Executor, function: Callable[[Setting], Any], settings: Iterable[Setting]
) -> tuple[Callable[[Any], Any], Iterable[Any]]:
    """Returns the function and the items with which an executor does a function with each setting, near or far."""
    if not executor.remote:
        return function, settings
    return functools.partial(_opened, function), (payload(setting) for setting in settings)


def in_order(executor: Executor, function: Callable[[Setting], Any], settings: Iterable[Setting]) -> Iterator[Any]:
    """Yields what an executor makes of each setting, in their order."""
    return executor(*sent(executor, function, settings))


def payload(setting: Setting) -> Payload:
    """Returns a setting with its files: scenarios of one's own, an agent, a model, the module of a policy.

    Raises:
        OSError: if a file cannot be read.
    """
    case = setting.case
    files: list[Path] = []
    if _is_file(case.scenario):
        there = Path(case.scenario)
        files += sorted(each for each in there.rglob("*") if each.is_file()) if there.is_dir() else [there]
    if "home" in case.gains:
        files += sorted(each for each in trained(case.gains["home"])[case.gains["seed"]].iterdir() if each.is_file())
    if isinstance(case.entrant, OwnModel):
        files.append(Path(case.entrant.file))
    if isinstance(case.entrant, OwnNetwork):
        files.append(Path(case.gains["file"]))
    elif isinstance(case.entrant, OwnClass) and (file := imported(case.entrant.module).__file__):
        files.append(Path(file))
    return Payload(setting, {str(file): file.read_bytes() for file in files})


def _is_file(scenario: str) -> bool:
    return Path(scenario).is_absolute()  # names of banks and splits are not


def _opened(function: Callable[[Setting], Any], payload: Payload) -> Any:
    """Returns what a function makes of a payload's setting, with its files in a folder that is there as long."""
    with _unpacked(payload) as setting:
        return function(setting)


@contextlib.contextmanager
def _unpacked(payload: Payload) -> Iterator[Setting]:
    """Yields the setting with its files where they are here; rows name them as they were given."""
    if not payload.files:
        yield payload.setting
        return
    with tempfile.TemporaryDirectory() as folder:
        case = payload.setting.case
        here = {name: _written(Path(folder), name, content, case.scenario) for name, content in payload.files.items()}
        yield dataclasses.replace(payload.setting, case=_moved(case, here, payload.files), given=case)


def _written(folder: Path, name: str, content: bytes, scenario: str) -> Path:
    """Writes a file below a folder, under as much of its path as readers look at; returns where."""
    parts = Path(name).absolute().parts[1:]
    levels = 3 + max(_below(name, scenario), 1)
    file = folder.joinpath(hashlib.sha256("/".join(parts[:-levels]).encode()).hexdigest()[:8], *parts[-levels:])
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    return file


def _below(name: str, folder: str) -> int:
    """Returns how many parts of a file's path are below a folder; 0: it is none of its files."""
    return len(Path(name).relative_to(folder).parts) if Path(name).is_relative_to(folder) else 0


def _moved(case: Case, here: Mapping[str, Path], files: Mapping[str, bytes]) -> Case:
    """Returns a case that names its files where they are here."""
    for name, file in here.items():
        if name == case.scenario or (below := _below(name, case.scenario)):
            place = file if name == case.scenario else file.parents[below - 1]
            case = dataclasses.replace(case, scenario=str(place))
            break
    if "home" in case.gains:
        agents = [file for file in here.values() if file.parent.parent.name == f"seed_{case.gains['seed']}"]
        case = dataclasses.replace(case, gains={**case.gains, "home": str(agents[0].parents[2])})
    if isinstance(case.entrant, OwnModel):
        case = dataclasses.replace(case, entrant=dataclasses.replace(case.entrant, file=str(here[case.entrant.file])))
    if isinstance(case.entrant, OwnNetwork):
        case = dataclasses.replace(case, gains={**case.gains, "file": str(here[case.gains["file"]])})
    elif isinstance(case.entrant, OwnClass):
        _loaded(case.entrant, here, files)
    return case


def _loaded(entrant: OwnClass, here: Mapping[str, Path], files: Mapping[str, bytes]) -> None:
    """Makes the module of a policy be the one of the machine where the run was started.

    Raises:
        ValueError: if it is part of a package, and another or none here.
    """
    there = sys.modules.get(entrant.module)
    if there is not None and getattr(there, "__wayfield_digest__", "") == entrant.digest:
        return
    if "." in entrant.module:
        file = imported(entrant.module).__file__
        if file is None or file_digest(Path(file)) != entrant.digest:
            raise ValueError(f"module {entrant.module!r} is another one here: install the same on every worker")
        return
    name = next(name for name, content in files.items() if hashlib.sha256(content).hexdigest() == entrant.digest)
    spec = importlib.util.spec_from_file_location(entrant.module, here[name])
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[entrant.module] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[entrant.module]
        raise ValueError(f"module {entrant.module!r} cannot be imported there: {error}") from error
    module.__dict__["__wayfield_digest__"] = entrant.digest
