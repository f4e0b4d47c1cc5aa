"""Policies of the user's own in the contests: a class of a module, a model of stable-baselines3, or an object.

`evaluate.py --policy my_module:MyPolicy` needs a class with the four members of `Policy`, no more. A model reads the
environment's flat observation and answers with its flat action, as it was trained.
"""

import ast
import dataclasses
import functools
import importlib
import importlib.util
import inspect
import json
import os
import re
import shlex
import sys
import sysconfig
import traceback
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield
from wayfield.benchmarks.entrants import value_networks
from wayfield.benchmarks.records.run_folder import file_digest
from wayfield.envs import goal_reaching, path_following
from wayfield.envs.tasks.briefing import KNOWS, Briefing
from wayfield.policies.parts.policy import Policy
from wayfield.policies.registry import POLICIES
from wayfield.system.checks import shown, suggestion, unread
from wayfield.system.extras import installs
from wayfield.system.readers import reader
from wayfield.system.reading import MOST_NUMBERS, MOST_TEXT, parsed_object
from wayfield.system.unpacking import check_members

OWN = "own"  # the name of the gains of all that the user brings
ALGORITHMS = ("PPO", "A2C", "SAC", "TD3", "DDPG")  # of stable-baselines3, with continuous actions
_MEMBERS = ("knows", "observes", "reset", "act")
_SPEEDS = ("speed", "max_speed")  # the names of a cruising speed


class Mismatch(ValueError):
    """A policy cannot read what an environment gives, or drive it."""


@dataclasses.dataclass(frozen=True)
class OwnClass:
    """A policy that a class, or another callable, of a module makes."""

    module: str
    attribute: str
    gains: Mapping[str, Any]
    digest: str  # SHA-256 of the module's file

    @property
    def name(self) -> str:
        """Returns "module:Class"."""
        return f"{self.module}:{self.attribute}"

    @property
    def gains_name(self) -> str:
        """Returns "own", with the gains that were given."""
        return _own_gains(self.gains)

    def make(self, gains: Mapping[str, Any]) -> Policy:
        """Returns the policy with these gains.

        Raises:
            ValueError: if the module cannot be imported, holds no such class, or the class makes no policy.
        """
        made = Checked(self.name, self._made(gains))
        sources()  # as they are now that they are loaded
        return made

    def _made(self, gains: Mapping[str, Any]) -> Any:
        module = imported(self.module)
        maker = getattr(module, self.attribute, None)
        if maker is None:
            hint = suggestion(self.attribute, [each for each in vars(module) if not each.startswith("_")])
            raise ValueError(f"{self.name!r}: {module.__file__} has no {self.attribute!r}.{hint}")
        if not callable(maker):
            raise ValueError(f"{self.name!r} is {shown(maker)}; it must be a class that makes a policy")
        try:
            return maker(**gains)
        except Exception as error:
            given = " ".join(f"{key}={value}" for key, value in gains.items()) or "no gains"
            raise ValueError(f"{self.name!r} cannot be made with {given}: {_line_of(error)}") from error

    def cruising(self, speed: float) -> dict[str, Any] | None:
        """Returns the gain `speed` or `max_speed`, whichever the class takes and keeps; None if it has neither."""
        made = self._made(self.gains)
        takes = inspect.signature(getattr(imported(self.module), self.attribute)).parameters
        return next(({key: speed} for key in _SPEEDS if key in takes and hasattr(made, key)), None)

    def described(self) -> tuple[str, str]:
        """Returns how many gains it has if it is a dataclass, and nothing of what they were learned from."""
        made = self._made(self.gains)
        return str(len(dataclasses.fields(made))) if dataclasses.is_dataclass(made) else "", ""


@dataclasses.dataclass(frozen=True)
class OwnNetwork(OwnClass):
    """A value network of a file: `value_networks`."""

    @property
    def name(self) -> str:
        """Returns the name of the file."""
        return Path(self.gains["file"]).name

    @property
    def gains_name(self) -> str:
        """Returns "own", with the gains that were given."""
        return _own_gains({name: value for name, value in self.gains.items() if name != "file"})


@dataclasses.dataclass(frozen=True)
class OwnModel:
    """A model that stable-baselines3 has saved."""

    file: str
    algorithm: str  # one of ALGORITHMS
    digest: str  # SHA-256 of the file
    gains: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        """Returns the name of the file."""
        return Path(self.file).name

    @property
    def gains_name(self) -> str:
        """Returns "own"."""
        return OWN

    def make(self, gains: Mapping[str, Any]) -> Policy:
        """Returns the policy of the model; ValueError, in one line, if it cannot be loaded."""
        del gains
        return Checked(self.name, _ModelPolicy(self.name, loaded(self.file, self.algorithm, self.digest)))

    def cruising(self, speed: float) -> None:
        """Returns None: a model drives as it was trained."""
        del speed

    def described(self) -> tuple[str, str]:
        """Returns the numbers of its networks, and the control periods that it was trained for."""
        model = loaded(self.file, self.algorithm, self.digest)
        count = sum(each.numel() for each in model.policy.parameters())
        return f"{count:,}", f"{model.num_timesteps / 1e6:.1f} M frames"


@dataclasses.dataclass(frozen=True)
class OwnObject:
    """A policy that is there already; it must be possible to pickle it where there are several workers."""

    policy: Any
    number: int = 1  # among those of its class

    @property
    def name(self) -> str:
        """Returns the name of its class, numbered from the second on."""
        name = type(self.policy).__name__
        return name if self.number == 1 else f"{name} {self.number}"

    @property
    def gains_name(self) -> str:
        """Returns "own"."""
        return OWN

    @property
    def gains(self) -> Mapping[str, Any]:
        """Returns the gains that are not the defaults of its dataclass; none of others."""
        if not dataclasses.is_dataclass(self.policy):
            return {}
        fields = [field for field in dataclasses.fields(self.policy) if isinstance(field.default, int | float | str)]
        values = {field.name: getattr(self.policy, field.name) for field in fields}
        return {field.name: values[field.name] for field in fields if values[field.name] != field.default}

    def make(self, gains: Mapping[str, Any]) -> Policy:
        """Returns the policy itself, with the gains that it does not have yet."""
        other = {key: value for key, value in gains.items() if getattr(self.policy, key) != value}
        return Checked(self.name, dataclasses.replace(self.policy, **other) if other else self.policy)

    def cruising(self, speed: float) -> dict[str, Any] | None:
        """Returns the field `speed` or `max_speed` of a dataclass; None if it has neither."""
        names = [field.name for field in dataclasses.fields(self.policy)] if self._is_record else []
        return next(({key: speed} for key in _SPEEDS if key in names), None)

    def described(self) -> tuple[str, str]:
        """Returns how many gains it has if it is a dataclass, and nothing of what they were learned from."""
        return str(len(dataclasses.fields(self.policy))) if self._is_record else "", ""

    @property
    def _is_record(self) -> bool:
        return dataclasses.is_dataclass(self.policy)


def own_policy(text: str) -> OwnClass | OwnModel:
    """Returns what a text names: "module:Class", with gains as key=value behind it, or "model.zip", "ppo:model.zip".

    A file of weights (`value_networks.SUFFIXES`) is a value network of the CrowdNav family, its gains behind it. A
    model is not loaded yet; a UserWarning says what loading it means.

    Raises:
        ValueError: if it names no such thing; the message quotes it and says what would be right.
    """
    source, gains = source_and_gains(text)
    if source.lower().endswith(".zip"):
        if gains:
            raise ValueError(f"{text!r}: a model takes no gains")
        model = _model(source)
        warnings.warn(f"{model.name} is loaded with pickle, which can run any code: give models only that you trust",
                      UserWarning, stacklevel=2)  # fmt: skip
        return model
    if source.lower().endswith(value_networks.SUFFIXES):
        network = OwnNetwork(
            value_networks.__name__, "ValueNetwork", {"file": os.path.abspath(source), **gains}, _weights(source)
        )
        value_networks.network(network.gains["file"])  # whose errors are one line as they are
        network.make(network.gains)
        return network
    module, colon, attribute = source.partition(":")
    if module.endswith(".py") or "/" in module or os.sep in module:
        stem = Path(module).stem
        raise ValueError(
            f"{source!r} is a file; name its module, found from this folder: {stem}:{attribute or 'Class'}"
        )
    if source in POLICIES:
        kind = type(POLICIES[source]())
        raise ValueError(
            f"{source!r} is a policy of the package: --policies {source}; with gains of your own it is --policy "
            f'"{kind.__module__}:{kind.__qualname__} {" ".join(f"{k}={v}" for k, v in gains.items()) or "gain=value"}"'
        )
    if not colon or not all(each.isidentifier() for each in (*module.split("."), attribute)):
        raise ValueError(
            f"{source!r} must be module:Class, such as my_module:MyPolicy, a model.zip or weights.safetensors"
        )
    file = imported(module).__file__
    entrant = OwnClass(module, attribute, gains, file_digest(Path(file)) if file else "")
    entrant.make(gains)
    return entrant


def _weights(file: str) -> str:
    """Returns the digest of a file of weights; ValueError if it cannot be read."""
    try:
        return file_digest(Path(file))
    except OSError as error:
        raise ValueError(f"{file!r} cannot be read: {unread(file, error)}") from None


def source_and_gains(text: str) -> tuple[str, dict[str, Any]]:
    """Returns the first word of a text, and the gains key=value behind it; ValueError, quoting it, if it has others.

    A model's file may have spaces in its path.
    """
    if text.lower().endswith(".zip") and any(os.path.isfile(each) for each in (text, text.partition(":")[2])):
        return text, {}
    try:
        source, *words = shlex.split(text) or [""]
    except ValueError as error:
        raise ValueError(f"{text!r} cannot be read: {error}") from None
    return source, dict(_gain(text, word) for word in words)


def own_object(policy: Any, number: int) -> OwnObject:
    """Returns a policy that is there already, the n-th of its class; ValueError, naming the member, if it is none."""
    entrant = OwnObject(policy, number)
    entrant.make({})
    return entrant


def _gain(text: str, word: str) -> tuple[str, Any]:
    """Returns the name and the value of a gain: a number, a truth or text."""
    key, sign, value = word.partition("=")
    if not sign or not key.isidentifier() or not value:
        raise ValueError(f"{text!r}: {word!r} must be a gain, such as speed=0.5")
    if value.lower() in ("true", "false"):
        return key, value.lower() == "true"
    try:
        number = ast.literal_eval(value)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return key, value
    return key, number if isinstance(number, int | float) else value


def _own_gains(gains: Mapping[str, Any]) -> str:
    return " ".join(
        (OWN, *(f"{key}={value:g}" if type(value) is float else f"{key}={value}" for key, value in gains.items()))
    )


def imported(name: str) -> ModuleType:
    """Returns a module, found from the current folder or as Python finds others.

    The folder comes first while the module is imported and last from then on, so that files of the user's own take the
    place of no others that are loaded later.
    """
    if name in sys.modules:
        return sys.modules[name]
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{name}.".startswith(f"{error.name}."):
            raise ValueError(f"there is no module {name!r}, in {here} or installed") from None
        raise ValueError(f"module {name!r} cannot be imported: {_line_of(error)}") from error
    except (Exception, SystemExit) as error:
        raise ValueError(f"module {name!r} cannot be imported: {_line_of(error)}") from error
    finally:
        sys.path.remove(here)
        if here not in sys.path:
            sys.path.append(here)


def sources() -> dict[str, str]:
    """Returns the modules of the user's own that this process has loaded, with the SHA-256s of their files.

    They are all modules but those of Python, of installed packages and of wayfield, whoever imported them: a policy's
    own, its helpers, and what it imported while it acted. A file's digest is that of when it was first seen here.
    """
    digests = {}
    for name, module in sorted(sys.modules.items()):
        known = getattr(module, "__wayfield_digest__", "")
        if known and isinstance(known, str):  # sent from another machine; torch.classes has an attribute of any name
            digests[name] = known
        elif (file := _own_file(name)) is not None:
            digests[name] = _SEEN.setdefault(str(file), file_digest(file))
    return digests


def changed_source(loaded: Mapping[str, str]) -> str:
    """Returns the first of some modules whose file here has another SHA-256; "" where none has.

    Modules that this machine does not have are not compared.
    """
    for name, sha256 in loaded.items():
        if (file := _own_file(name)) is not None and file_digest(file) != sha256:
            return str(file)
    return ""


_SEEN: dict[str, str] = {}  # SHA-256 of a file of the user's own, by its path
_INSTALLED = (
    *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib", "scripts")),
    os.path.dirname(wayfield.__file__),
)


def _own_file(name: str) -> Path | None:
    """Returns the file of a module of the user's own; None of others, and where there is none."""
    if name.partition(".")[0] in ("wayfield", "__main__", "__mp_main__"):
        return None
    if name in sys.modules:
        origin = getattr(sys.modules[name], "__file__", None)
    else:
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, AttributeError, ValueError):
            return None
        origin = spec.origin if spec is not None else None
    return _outside(origin) if isinstance(origin, str) else None


@functools.cache
def _outside(origin: str) -> Path | None:
    """Returns the path of a file that belongs neither to Python nor to an installed package; None of others."""
    file = Path(os.path.abspath(origin))
    installed = {"site-packages", "dist-packages"} & set(file.parts) or any(map(file.is_relative_to, _INSTALLED))
    return file if file.is_file() and not installed else None


def _line_of(error: BaseException) -> str:
    """Returns the last line of what Python would say of an error, and where in the user's code it came up."""
    said = traceback.format_exception_only(error)[-1].strip()
    ours = str(Path(__file__).parents[2])
    frames = [each for each in traceback.extract_tb(error.__traceback__) if not each.filename.startswith(ours)]
    frames = [each for each in frames if "importlib" not in each.filename and os.path.isfile(each.filename)]
    if isinstance(error, SyntaxError):
        return f"{said} ({error.filename}, line {error.lineno})"
    return f"{said} ({frames[-1].filename}, line {frames[-1].lineno})" if frames else said


class Checked:
    """A policy of the user's own, checked at each call: an error is one line that names the policy.

    Raises:
        ValueError: if it lacks a member, or a member is nothing that a policy can have.
    """

    def __init__(self, name: str, policy: Any) -> None:
        for member in _MEMBERS:
            try:
                there = hasattr(policy, member)
            except Exception as error:
                raise ValueError(f"{name!r}: {member} raises {_line_of(error)}") from error
            if not there:
                raise ValueError(f"{name!r} is no policy: it lacks {member!r}; a policy has {', '.join(_MEMBERS)}")
        if policy.knows not in KNOWS:
            raise ValueError(f"{name!r}: knows is {shown(policy.knows)}; it must be one of {', '.join(KNOWS)}")
        observes = policy.observes
        if not isinstance(observes, tuple) or not observes or not all(isinstance(each, type) for each in observes):
            raise ValueError(f"{name!r}: observes is {shown(observes)}; it must be a tuple of observation types")
        for member in ("reset", "act"):
            if not callable(getattr(policy, member)):
                raise ValueError(f"{name!r}: {member} must be a method")
        self.name, self.policy = name, policy
        self.knows: str = policy.knows
        self.observes: tuple[type, ...] = observes

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the policy's memory.

        Raises:
            Mismatch: if it says that it cannot drive here.
            ValueError: if it fails, or returns no array with a row for each robot.
        """
        memory = self._answer("reset", briefing)
        if not isinstance(memory, np.ndarray) or not memory.ndim or len(memory) != briefing.num_envs:
            got = memory.shape if isinstance(memory, np.ndarray) else shown(memory)
            raise ValueError(f"{self.name!r}: reset must return an array with {briefing.num_envs} rows, got {got}")
        return memory

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the policy's twists (b, t); ValueError if it fails, or they have another shape or are not finite."""
        answer = self._answer("act", observation, briefing, memory)
        wanted = (briefing.num_envs, len(briefing.robot.twist_axes))
        try:
            twists = np.asarray(answer, np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"{self.name!r}: act must return twists {wanted}, got {shown(answer)}") from None
        if twists.shape != wanted:
            raise ValueError(
                f"{self.name!r}: act must return twists {wanted} for {briefing.robot.name}, got shape {twists.shape}"
            )
        if not np.isfinite(twists).all():
            odd = float(twists[~np.isfinite(twists)][0])
            raise ValueError(f"{self.name!r}: act must return finite twists, got {odd:g}")
        return twists

    def _answer(self, member: str, *arguments: Any) -> Any:
        try:
            return getattr(self.policy, member)(*arguments)
        except Mismatch:
            raise
        except Exception as error:
            raise ValueError(f"{self.name!r}: {member} raises {_line_of(error)}") from error


# Models of stable-baselines3.


class _ModelPolicy:
    """Drives as a model says, without chance."""

    knows = "sensors"
    observes = (path_following.Observation, goal_reaching.Observation)

    def __init__(self, name: str, model: Any) -> None:
        self._name, self._model = name, model

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory; Mismatch, naming both, if the model's spaces are not those of the environment."""
        top = np.asarray(briefing.robot.max_twist, np.float32)
        beams = len(briefing.beam_angles)
        made = f": num_beams={beams}, max_range={briefing.max_range:g}" if beams else ""
        for what, mine, theirs in (
            ("reads", self._model.observation_space, briefing.layout.space),
            ("acts in", self._model.action_space, gymnasium.spaces.Box(-top, top, dtype=np.float32)),
        ):
            if not _alike(mine, theirs):
                raise Mismatch(
                    f"{self._name!r} {what} {_space(mine)}, but the contest has {_space(theirs)}"
                    f" ({briefing.task.suite}, {briefing.robot.name}{made})"
                )
        return np.empty((briefing.num_envs, 0))

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t), which are the actions of the environments' mode "twist"."""
        del memory
        actions, _ = self._model.predict(briefing.layout.pack(observation), deterministic=True)
        return np.asarray(actions, np.float64)


def _alike(a: Any, b: gymnasium.spaces.Box) -> bool:
    return (
        isinstance(a, gymnasium.spaces.Box)
        and a.shape == b.shape
        and bool(np.allclose(a.low, b.low, rtol=1e-5) and np.allclose(a.high, b.high, rtol=1e-5))
    )


def _space(space: Any) -> str:
    """Returns a space in short: its type, shape and bounds."""
    if not isinstance(space, gymnasium.spaces.Box):
        return shown(space)
    bounds = " ".join(
        f"{low:.4g}..{high:.4g}" for low, high in zip(space.low.flat[:3], space.high.flat[:3], strict=True)
    )
    return f"Box{space.shape} of {bounds}{' ...' if space.low.size > 3 else ''}"


def _sample_model(folder: Path) -> None:
    data = {"policy_class": {"__module__": "stable_baselines3.common.policies"}, "clip_range": 0.2, "gamma": 0.99}
    with zipfile.ZipFile(folder / "model.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data", json.dumps(data, indent=4))
        archive.writestr("policy.pth", bytes(100))


@reader("model of stable-baselines3", "model.zip", _sample_model)
def _model(source: str) -> OwnModel:
    """Returns the model of a file, "model.zip" or "algorithm:model.zip", without loading it."""
    wanted, colon, file = source.partition(":")
    if not colon or os.path.exists(source):
        wanted, file = "", source
    if wanted and wanted.upper() not in ALGORITHMS:
        raise ValueError(f"{source!r}: {wanted!r} is no algorithm; choose from {', '.join(ALGORITHMS)}")
    try:
        with zipfile.ZipFile(file) as archive:
            check_members(archive, MOST_NUMBERS)
            sizes = {each.filename: each.file_size for each in archive.infolist()}
            content = b""
            if read := {"data", "policy.pth"} <= set(sizes) and sizes["data"] <= MOST_TEXT:
                with archive.open("data") as member:  # `ZipFile.read` unpacks whatever size is declared
                    content = member.read(MOST_TEXT)
    except OSError as error:
        raise ValueError(f"{file!r} cannot be read: {unread(file, error)}") from None
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        NotImplementedError,
        RuntimeError,
        LookupError,
        ValueError,
    ) as error:
        raise ValueError(f"{file!r} is no zip of a model: {shown(str(error))}") from None
    if not read:
        lacks = f"its data has more than {MOST_TEXT} bytes" if "data" in sizes else "it lacks data"
        raise ValueError(
            f"{file!r} is no model of stable-baselines3: {lacks if 'policy.pth' in sizes else 'it lacks policy.pth'}"
        )
    data = parsed_object(content, f"data of {file!r}")
    algorithm = wanted.upper() or _algorithm(data)
    if not algorithm:
        raise ValueError(f"{file!r} does not tell its algorithm; give it: {ALGORITHMS[0].lower()}:{file}")
    return OwnModel(os.path.abspath(file), algorithm, file_digest(Path(file)))


def _algorithm(data: Any) -> str:
    """Returns the algorithm that the data of a model was written by, as its policy's module and options tell; or ""."""
    if not isinstance(data, dict) or not isinstance(data.get("policy_class"), dict):
        return ""
    match = re.search(r"stable_baselines3\.(\w+)\.policies", str(data["policy_class"].get("__module__")))
    if match is None:
        return ""
    if match[1] == "common":
        return "PPO" if "clip_range" in data else "A2C"
    return match[1].upper() if match[1].upper() in ALGORITHMS else ""


@functools.lru_cache(maxsize=16)
def loaded(file: str, algorithm: str, digest: str) -> Any:
    """Returns the model of a file.

    Raises:
        ValueError: if stable-baselines3 is missing or cannot load it, or the file has changed.
    """
    try:
        import stable_baselines3
    except ImportError:
        raise ValueError(f"{file!r} needs stable-baselines3: {installs('train')}") from None
    try:
        if file_digest(Path(file)) != digest:
            raise ValueError("it has changed since the command began")
        return getattr(stable_baselines3, algorithm).load(file, device="cpu")
    except Exception as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{file!r} cannot be loaded as a model of {algorithm}: {said[:300]}") from error
