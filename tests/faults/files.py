"""Damaged files of every registered kind: read, or refused in one line that names the file; what is read is used.

A file that a digest vouches for is damaged in three ways: at random; so that it reads as well but says something else,
which must be refused; and with the digest made right again, so that what stands behind the comparison is tried too.
"""

import base64
import contextlib
import dataclasses
import functools
import hashlib
import importlib
import json
import lzma
import os
import pkgutil
import random
import resource
import shutil
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import mutations
import numpy as np
from safetensors.numpy import load

import wayfield.policies
from wayfield import benchmarks, envs, policies
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.scenarios import TASKS, GoalScenario, PathScenario
from wayfield.envs.world.paths import Path as DrivenPath
from wayfield.policies.learned.agent import Agent, signed, weights_digest
from wayfield.policies.pilot import Pilot
from wayfield.system.readers import READERS

_DEEP, _LARGE = "[" * 100_000 + "]" * 100_000, "1" + "0" * 400
_LISTED = (
    *(("goal scenario", key, raw) for key in ("start", "goal") for raw in ("[0, 0, 1e20]", "[0, 0, 1e300]")),
    *(("goal scenario", "start_turn", "1e20"), ("goal scenario", "start_turn", "1e300")),
    *(("path scenario", "start", "[0, 0, 1e20]"), ("path scenario", "start_turn", "1e300")),
    *(("path scenario", "laps", _LARGE), ("gains", "gains", _DEEP), ("gains", "trials", _LARGE)),
    *(("agent's card", "dt", "1e400"), ("agent's card", "features", _DEEP), ("training run", "steps", _LARGE * 10)),
)
_STEPS = 25
_GROWTH = 1 << 30  # bytes that reading and using a file of these sizes may take at most


def _sign_agent(file: Path) -> None:
    """Gives a card the digests of its weights and of itself."""
    card, weights = (file.with_name(name) for name in ("card.json", "weights.safetensors"))
    tensors = load(weights.read_bytes())
    layers = [(tensors[f"layer_{k}.weight"], tensors[f"layer_{k}.bias"]) for k in range(len(tensors) // 2)]
    content = signed(json.loads(card.read_bytes()) | {"sha256": weights_digest(layers)})
    card.write_text(json.dumps(content), encoding="utf-8")


def _sign_part(file: Path) -> None:
    """Writes the digests of a part anew."""
    digests = file.with_name(READERS["digests of a part"].file)
    found = {
        name: hashlib.sha256(file.with_name(name).read_bytes()).hexdigest() for name in json.loads(digests.read_bytes())
    }
    digests.write_text(json.dumps(found), encoding="utf-8")


def _sign_state(file: Path) -> None:
    """Writes a training state again, as what it holds now."""
    from wayfield.policies.training.checkpoints import write_state

    content = file.read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    write_state(file.parent, load(content), json.loads(header["__metadata__"]["numbers"]))


def _sign_submission(file: Path) -> None:
    """Writes the digests of a submission's episodes anew."""
    from wayfield.benchmarks.commands.submission import CARD, signed

    header, *lines = lzma.decompress(file.read_bytes()).decode().splitlines()
    rows = [dict(zip(header.split(","), line.split(","), strict=False)) for line in lines]
    card = file.with_name(CARD)
    card.write_text(json.dumps(json.loads(card.read_bytes()) | {"episodes": [signed(row) for row in rows]}))


# the readers whose files a digest vouches for: what makes it right again, and the keys below which it vouches
_SIGNED: dict[str, tuple[Callable[[Path], None] | None, tuple[str, ...]]] = {
    **dict.fromkeys(("agent's card", "path agent's card", "agent's weights"), (_sign_agent, ())),
    **dict.fromkeys(("rows of a part", "sources of a part", "trajectories of a part"), (_sign_part, ())),
    "digests of a part": (None, ()),
    "training state": (_sign_state, ()),
    "state before the last": (None, ()),
    "card of a submission": (None, ("episodes",)),
    "episodes of a submission": (_sign_submission, ()),
    "split": (None, ("families", next(iter(TASKS["path_following"].families)), "test")),
}


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields what once went wrong, then a random mutation of each kind of file in turn, without end."""
    load_all()
    names = sorted(READERS)
    for name in _SIGNED:
        for _ in range(5):
            yield {"reader": name, "mutation": "nudged", "seed": rng.randrange(2**31)}
    for name, key, raw in _LISTED:
        if name in names:
            yield {"reader": name, "key": key, "raw": raw}
    for name in names:
        kinds = ["missing", "folder", "whole", "truncate"]
        kinds += ["bomb"] if READERS[name].file.endswith(("npz", "zip")) else []
        for kind in kinds:
            yield {"reader": name, "mutation": kind, "seed": rng.randrange(2**31)}
    while True:
        for name in names:
            yield {"reader": name, "mutation": "any", "seed": rng.randrange(2**31)}
            if name in _SIGNED:
                yield {"reader": name, "mutation": "nudged", "seed": rng.randrange(2**31)}
                for _ in range(3 if _SIGNED[name][0] else 0):
                    yield {"reader": name, "mutation": "any", "seed": rng.randrange(2**31), "signed": True}


def attempt(spec: dict[str, Any], place: Any) -> str | None:
    """Returns what is wrong with the outcome of a trial."""
    load_all()
    sample = place.samples / READERS[spec["reader"]].name.replace(" ", "_").replace("'", "")
    if not sample.exists():
        problem = place.inside.ask("files", {"sample": spec["reader"], "folder": str(sample)})
        if problem:
            shutil.rmtree(sample, ignore_errors=True)
            return f"no sample: {problem}"
    if "content" not in spec and spec.get("mutation") not in ("missing", "folder", "bomb"):
        content = _content(spec, sample / READERS[spec["reader"]].file)
        if len(content) < 200_000:  # so that a finding can be repeated whatever becomes of the mutations
            spec["content"] = base64.b64encode(zlib.compress(content)).decode()
    with place.folder() as folder:
        return place.inside.ask("files", spec | {"from": str(sample), "folder": str(folder)})


@functools.cache
def load_all() -> None:
    """Imports every module of the package whose extra is installed, so that every reader is known."""
    for part in (envs, policies, benchmarks):
        for module in pkgutil.walk_packages(part.__path__, f"{part.__name__}."):
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError as error:
                if (error.name or "").startswith("wayfield"):
                    raise


def _content(spec: Mapping[str, Any], good: Path) -> bytes:
    if "content" in spec:
        return zlib.decompress(base64.b64decode(spec["content"]))
    content = good.read_bytes()
    if "raw" in spec:
        return mutations.with_value(content, spec["key"], spec["raw"])
    rng = random.Random(spec["seed"])
    if spec["mutation"] == "any":
        return mutations.damaged(content, good.name, rng)
    if spec["mutation"] == "nudged":
        return mutations.nudged(content, good.name, rng, _SIGNED[spec["reader"]][1])
    return mutations.NAMED[spec["mutation"]](content, rng)


def inside(spec: dict[str, Any]) -> dict[str, Any]:
    """Returns what was wrong with reading a damaged file, in the process of `place.Inside`."""
    load_all()
    folder = Path(spec["folder"])
    if "sample" in spec:
        folder.mkdir(parents=True)
        file = READERS[spec["sample"]].fill(folder)
        READERS[spec["sample"]].read(file)
        return {}
    reader = READERS[spec["reader"]]
    for each in Path(spec["from"]).rglob("*"):
        target = folder / each.relative_to(spec["from"])
        if each.is_dir():
            target.mkdir(exist_ok=True)
        elif target != folder / reader.file:
            target.parent.mkdir(exist_ok=True, parents=True)
            shutil.copyfile(each, target)  # no link: it may be signed anew
    file = folder / reader.file
    if spec.get("mutation") == "folder":
        file.mkdir()
    elif spec.get("mutation") != "missing":
        file.write_bytes(_content(spec, Path(spec["from"]) / reader.file))
    if spec.get("signed"):
        with contextlib.suppress(Exception):  # what cannot be signed is tried as it is
            _SIGNED[spec["reader"]][0](file)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    _watch()
    _SEEN.clear()
    seen = None
    try:
        found = reader.read(file)
        seen = list(_SEEN)
        if spec.get("mutation") == "nudged":
            return {"problem": "another content under the same digest is accepted"}
        if not (spec.get("signed") and isinstance(found, tuple)):  # a run trusts a state that it has signed itself
            used(found, file)
    except (ValueError, OSError) as error:
        seen = list(_SEEN) if seen is None else seen
        text = str(error)
        if "\n" in text or len(text) > 2000 or not (file.name in text or str(folder) in text):
            return {"problem": f"{type(error).__name__} is no line that names the file: {text[:300]!r}"}
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10
    if seen:
        return {"problem": f"reading did {seen[0]}"}
    if grown > _GROWTH:
        return {"problem": f"reading took {grown >> 20} MiB"}
    return {}


@functools.singledispatch
def used(found: Any, file: Path) -> None:
    """Uses a value of a kind that needs no care: nothing."""
    del found, file


@used.register
def _(found: GoalScenario, file: Path) -> None:
    del found
    for env_id in ("wayfield/DiffDriveGoalObstacles-v0", "wayfield/OmniGoalObstacles-v0"):
        _driven(env_id, scenario=str(file))


@used.register(PathScenario)
@used.register(DrivenPath)
def _(found: Any, file: Path) -> None:
    del found
    _driven("wayfield/DiffDrivePathFollowing-v0", scenario=str(file))


@used.register
def _(found: Agent, file: Path) -> None:
    """Drives a few steps; an agent may be for a robot or scan that its card does not go with, and says so."""
    kwargs = {
        name: value for name, value in (found.card.get("env_kwargs") or {}).items() if name != "max_episode_steps"
    }
    try:
        envs: Any = gymnasium.make_vec(found.card["env_id"], 2, vectorization_mode="vector_entry_point", **kwargs)
        observation, _ = envs.reset(seed=0)
        pilot = Pilot(found, envs)
        pilot.reset()
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file.name}: {error}") from None
    for _ in range(3):
        action = pilot.act(observation)
        if not np.isfinite(action).all():
            raise AssertionError("an agent that was read asks for what is not finite")
        observation, *_ = envs.step(action)


@used.register
def _(found: tuple, file: Path) -> None:  # type: ignore[type-arg]
    """Goes on from the state of a training run: restores it, and makes one update."""
    if not (len(found) == 2 and isinstance(found[0], dict)):
        return
    from wayfield.policies.training import run
    from wayfield.policies.training.checkpoints import sample_job
    from wayfield.policies.training.learner import PpoLearner

    job = dataclasses.replace(sample_job(file.parent), resume=True)
    going_on = run._Run(job, PpoLearner(job.preset, job.env_id, job.seed))
    try:
        going_on.learner.update()
        if not all(np.isfinite(part).all() for layer in going_on.learner.layers() for part in layer):
            raise AssertionError("a training that was restored makes weights that are not finite")
    finally:
        going_on.writer.close()
        going_on.learner.env.close()


@used.register
def _(found: dict, file: Path) -> None:  # type: ignore[type-arg]
    """Gains make their policy; trajectories are of numbers that have a length."""
    if isinstance(found.get("gains"), dict) and isinstance(found.get("policy"), str):
        try:
            wayfield.policies.make(found["policy"], **found["gains"])
        except (TypeError, ValueError) as error:
            raise ValueError(f"{file.name}: {error}") from None
    for each in found.values():
        if isinstance(each, Trajectory) and not np.isfinite(np.asarray(each.poses, float)).all():
            raise AssertionError("a trajectory that was read is not finite")


def _driven(env_id: str, **kwargs: Any) -> None:
    """Takes some steps, with what moves and senses checked to be numbers."""
    env: Any = gymnasium.make(env_id, disable_env_checker=True, **kwargs).unwrapped
    rng = np.random.default_rng(0)
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(_STEPS):
            observation, reward, terminated, *_ = env.step(rng.uniform(env.action_space.low, env.action_space.high))
            if not (env.observation_space.contains(observation) and np.isfinite(reward)):
                raise AssertionError(f"{env_id} yields reward {reward} and an observation out of its space")
            if terminated:
                break


_SEEN: list[str] = []  # what the trial under way has executed or written, by the interpreter's audit events
_EXECUTED = ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.fork", "socket.connect")
_WRITTEN = ("os.remove", "os.rename", "os.rmdir", "shutil.rmtree")


@functools.cache
def _watch() -> None:
    """Has what is executed or written noted from now on, but for what Python and the compiler keep."""
    own = (os.environ["NUMBA_CACHE_DIR"], "/dev/")

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        path = str(arguments[0]) if arguments else ""
        if event == "open":
            mode, flags = arguments[1:]
            if not ((isinstance(mode, str) and set(mode) & set("wax+")) or (flags or 0) & (os.O_WRONLY | os.O_RDWR)):
                return
        elif event not in _EXECUTED + _WRITTEN:
            return
        if event in _EXECUTED or not (path.startswith(own) or ".pyc" in path):
            _SEEN.append(f"{event} {path}"[:200])

    sys.addaudithook(note)
