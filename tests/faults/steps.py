"""Random settings, random, extreme and wrong actions: a step is refused in a line, or all that it yields is sound.

The process that does them checks the bounds of every array in compiled code.
"""

import copy
import inspect
import json
import random
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from inside import alive

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.robots import ACTUATORS, ROBOTS, robots_with
from wayfield.envs.robots.disturbances import DISTURBANCES
from wayfield.envs.robots.records import pose_sources
from wayfield.envs.scenarios import SPLITS
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.envs.team_worlds import ENDS, SEES

_SPECS = {env_id: spec for spec in EVERY.values() for env_id in spec.ids.values()}
IDS = sorted(_SPECS)
_REFUSALS = (ValueError, TypeError, gymnasium.error.Error)
_CHECKED = 40  # steps in which rows are compared with the single environment
_MANY = 16_384  # robots
# keyword arguments are changed to these; texts stand for what JSON cannot hold
EXTREME: tuple[Any, ...] = (
    1e20, -1e20, 1e160, 1e300, -1e300, 1e-320, "nan", "inf", "-inf", "huge", -1, 0, 0.5, 2**63, 10**9, None, True, "",
    "x", [], [1, 2], {}, "array", "complex", "\ud800",
)  # fmt: skip
_MEANT = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf, "huge": 10**400, "array": np.zeros(3), "complex": 1j}
_LISTED = (
    {"shove": [0, 0, 0, 1e20]}, {"shove": [0, 1e160, 0, 0]}, {"shove": [0, 0, 0, 1e300]}, {"shove": [1e300, 1, 1, 1]},
    {"preview_spacing": 1e6}, {"preview_spacing": 30.0, "scenario": "circle"}, {"num_beams": 10**7},
)  # fmt: skip
_PATH_ONLY, _GOAL_ONLY = ("preview_spacing", "num_preview", "scale"), ("num_beams", "max_range", "field_of_view")


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields what once crashed, then random settings and changed arguments in turn, without end."""
    for env_id in IDS:
        along = _SPECS[env_id].observes == "path"
        foreign = _GOAL_ONLY if along else _PATH_ONLY
        for kwargs in _LISTED:
            if not any(name in foreign for name in kwargs) and (along or "scenario" not in kwargs):
                yield {"env": env_id, "kwargs": kwargs, "num_envs": 0, "actions": "random", "steps": 60, "seed": 1}
        # driven straight back along the path: rounding must not take progress below its bound
        yield {"env": env_id, "kwargs": {}, "num_envs": 256, "actions": "corner", "steps": 300, "seed": 2}
    while True:
        yield _setting(rng)
        for _ in range(10):
            yield _argument(rng)


def _setting(rng: random.Random) -> dict[str, Any]:
    """Returns a random setting, many robots at once or one.

    Most steps are those of thousands of robots: what makes each of theirs dear (wide observations, a reset at every
    step, actions that are refused) is drawn for fewer at a time, who run the same code.
    """
    env_id = rng.choice(IDS)
    task = _SPECS[env_id]
    path, crowd = task.observes == "path", task.name in CROWDS
    family = f"{rng.choice((*task.families, *(() if crowd else ('all',))))}/{rng.choice(tuple(SPLITS))}"
    named = tuple(task.presets) or (family,)
    names = robots_with(holonomic="DiffDrive" not in env_id)
    robot = rng.choice([name for name in names if ROBOTS[name].hull_radius <= LARGEST_HULL])
    dynamics = rng.choice(("kinematic", "kinematic", "kinematic", *(() if crowd else ("pymunk",))))
    counts = (0, 1, 64, 1024, 4096, _MANY, _MANY)
    if crowd or dynamics == "pymunk":
        counts = (0, 1, 3, 64)
    robots = rng.choice(counts)
    many = robots >= _MANY
    kwargs: dict[str, Any] = {
        "scenario": rng.choice((rng.choice(named), family)),
        "robot": robot,
        "actuators": rng.choice(tuple(ACTUATORS)),
        "action_mode": rng.choice(("twist", "wheel_speeds")),
        "noise": rng.choice((0.0, 1.0, rng.uniform(0.0, 10.0))),
        "pose_source": rng.choice(pose_sources(ROBOTS[robot])),
        "disturbance": rng.choice(tuple(DISTURBANCES)),
    }
    if rng.random() < 0.3:
        kwargs["shove"] = [
            rng.uniform(0.0, 3.0),
            *(rng.choice((0.1, 1.0, 100.0)) * rng.uniform(-1, 1) for _ in range(3)),
        ]
    if path:
        kwargs |= {"num_preview": rng.choice((0, 1, 10) if many else (0, 1, 10, 100))}
        kwargs |= {"preview_spacing": rng.choice((1e-3, 0.1, 5.0)), "scale": rng.choice((1.0, 1.0, 0.1, 10.0))}
    else:
        kwargs |= {"num_beams": rng.choice((0, 1, 8) if many else (0, 1, 32, 72))}
        kwargs |= {"max_range": rng.choice((0.1, 5.0, 100.0)), "field_of_view": rng.uniform(0.1, 6.28)}
    if crowd:
        kwargs |= {"sees": rng.choice(SEES), "sight": rng.choice((0.1, 5.0, 100.0)), "visible": rng.random() < 0.5}
        if task.name == "teams":
            kwargs |= {"ends": rng.choice(ENDS), "parks": rng.random() < 0.5}
    else:
        kwargs["dynamics"] = dynamics
    if not (path or crowd):
        kwargs["end_on_success"] = rng.random() < 0.5
        kwargs["end_on_contact"] = dynamics == "kinematic" or rng.random() < 0.5
    return {
        "env": env_id,
        "kwargs": kwargs,
        "num_envs": robots,  # 0: the single environment; of teams the number of worlds
        "autoreset_mode": rng.choice(("NextStep", "SameStep")),
        "clock": rng.choice((None, 37, 1200) if robots > 1024 else (None, 1, 37, 1200)),
        "actions": rng.choice(("random", "random", "corner", "extreme", *(() if robots > 1024 else ("wrong",)))),
        "steps": 1000 if many else rng.choice((100, 300)),
        "seed": rng.randrange(2**31),
    }


def _argument(rng: random.Random) -> dict[str, Any]:
    """Returns a setting with one argument changed to something extreme."""
    env_id, value = rng.choice(IDS), rng.choice(EXTREME)
    spec: dict[str, Any] = {"env": env_id, "kwargs": {}, "actions": "random", "steps": 20, "seed": 1}
    spec["num_envs"] = rng.choice((0, 2))
    entry = gymnasium.registry[env_id].entry_point
    parameters = inspect.signature(gymnasium.envs.registration.load_env_creator(entry)).parameters  # type: ignore[arg-type]
    names = [*parameters, "reset seed", "options", "scenario option", "num_envs", "clock", "autoreset_mode"]
    name = rng.choice(names)
    if name == "shove":
        spec["kwargs"] = {"shove": [0, 0, 0, 0]}
        spec["kwargs"]["shove"][rng.randrange(4)] = value
    elif name in parameters:
        spec["kwargs"] = {name: value}
        if name == "render_mode":
            spec["kwargs"] = {name: "x"}  # a window may open otherwise
    else:
        spec |= {"num_envs": 2, name: value}
    return spec | {"mutated": name}


def attempt(spec: dict[str, Any], place: Any) -> str | None:
    """Returns what is wrong with the outcome of a trial."""
    return place.inside.ask("steps", spec)


def inside(spec: dict[str, Any]) -> dict[str, Any]:
    """Returns how many steps were taken and what was wrong with them, in the process of `place.Inside`."""
    kwargs = {name: _value(value) for name, value in spec["kwargs"].items()}
    single = spec["num_envs"] == 0
    try:
        if single:
            env: Any = gymnasium.make(spec["env"], disable_env_checker=True, **kwargs)
        else:
            more = {"autoreset_mode": _value(spec["autoreset_mode"])} if "autoreset_mode" in spec else {}
            clock = {"max_episode_steps": _value(spec["clock"])} if "clock" in spec else {}
            count = _value(spec["num_envs"])
            if _SPECS[spec["env"]].name == "teams" and spec.get("mutated") != "num_envs":
                count *= gymnasium.make(spec["env"], disable_env_checker=True, **kwargs).action_space.shape[0]
            env = gymnasium.make_vec(
                spec["env"],
                count,
                vectorization_mode="vector_entry_point",
                **clock,
                **more,
                **kwargs,
            )
        options = _value(spec["options"]) if "options" in spec else None
        if "scenario option" in spec:
            options = {"scenario": _value(spec["scenario option"])}
        seed = _value(spec.get("reset seed", spec["seed"]))
        observation, info = env.reset(seed=seed, options=options)
    except _REFUSALS as error:
        return _refused(error, spec)
    try:
        return _driven(env, observation, info, spec, kwargs)
    finally:
        env.close()


def _driven(env: Any, observation: Any, info: Any, spec: dict[str, Any], kwargs: dict[str, Any]) -> dict[str, Any]:
    base = env.unwrapped
    single = spec["num_envs"] == 0
    rng = np.random.default_rng(spec["seed"])
    twin = None
    crowd = _SPECS[spec["env"]].name in CROWDS  # whose rows share worlds, and whose bodies press on each other
    if not (single or crowd) and "autoreset_mode" in spec and "mutated" not in spec:
        twin = gymnasium.make(spec["env"], disable_env_checker=True, **kwargs).unwrapped
        row = int(rng.integers(spec["num_envs"]))
        mine, _ = twin.reset(seed=spec["seed"] + row)
        if not np.array_equal(mine, observation[row]):
            return {"problem": f"row {row} starts otherwise than the single environment"}
    names = set(info)
    taken = 0
    # what a shove or something that moves pushes into a hull is no fault of the kinematic plant
    moves = bool(base.task.params["moving"][0])
    shoved = kwargs.get("shove") is not None or base.task.options.disturbance.shove > 0.0
    solid = base.task.options.dynamics == "kinematic" and not (moves or shoved or crowd)
    for k in range(spec["steps"]):
        action = _actions(base, spec["actions"], rng, k)
        alive()
        try:
            observation, reward, terminated, truncated, info = env.step(action)
        except _REFUSALS as error:
            if spec["actions"] == "wrong":
                refused = _refused(error, spec)
                if "problem" in refused:
                    return refused
                continue
            return {"problem": f"a finite action is refused: {error}"}
        taken += max(spec["num_envs"] if isinstance(spec["num_envs"], int) else 1, 1)
        problem = _unsound(base, observation, reward, info, names, solid)
        if problem:
            return {"problem": f"step {k}: {problem}", "steps": taken}
        if twin is not None and k < _CHECKED:
            problem, ended = _unequal(twin, action[row], row, observation, reward, terminated, truncated, info)
            if problem:
                return {"problem": f"step {k}: {problem}", "steps": taken}
            twin = None if ended else twin
        if single and (terminated or truncated):
            observation, info = env.reset()
    return {"steps": taken}


def _unsound(base: Any, observation: Any, reward: Any, info: Any, names: set[str], solid: bool) -> str | None:
    space = base.observation_space
    if observation.shape != space.shape or observation.dtype != space.dtype:
        return f"the observation has shape {observation.shape} and type {observation.dtype}"
    if not ((observation >= space.low) & (observation <= space.high)).all():
        wrong = np.argwhere(~((observation >= space.low) & (observation <= space.high)))[0]
        return f"observation {wrong.tolist()} is {observation[tuple(wrong)]!r}, out of its space"
    if not np.isfinite(reward).all():
        return f"a reward is {reward}"
    states = base.batch.states
    for name in states.dtype.names or ():
        if states[name].dtype.kind == "f" and np.isnan(states[name]).any():
            return f"state {name} is NaN"
    found = {name for name in info if not name.lstrip("_").startswith("final_")}
    if found != names:
        return f"info has other keys than at the reset: {sorted(found ^ names)}"
    if solid and "clearance" in info and np.min(info["clearance"]) < -1e-9:
        return f"a hull is {-np.min(info['clearance']):.3g} m inside an obstacle"
    if "arc_length" in info and np.min(info["progress"]) < 0.0:  # along a path nothing counts but what lies ahead
        return f"progress is {np.min(info['progress'])}"
    return None


def _unequal(
    twin: Any, action: Any, row: int, observation: Any, reward: Any, terminated: Any, truncated: Any, info: Any
) -> tuple[str | None, bool]:
    mine, own_reward, own_terminated, _, told = twin.step(action)
    ended = bool(own_terminated or truncated[row])
    if bool(terminated[row]) != bool(own_terminated) or reward[row] != own_reward:
        return f"row {row} is rewarded or ends otherwise than the single environment", True
    final = ended and "final_obs" in info
    seen = info["final_obs"][row] if final else observation[row]
    if not np.array_equal(seen, mine):
        return f"row {row} observes otherwise than the single environment", True
    source = info["final_info"] if final else info
    for name, value in told.items():
        if not np.array_equal(source[name][row], value, equal_nan=True):
            return f"row {row} has another {name} than the single environment", True
    return None, ended


def _actions(base: Any, kind: str, rng: np.random.Generator, k: int) -> Any:
    space = base.action_space
    if kind == "random":
        return rng.uniform(space.low, space.high)
    if kind == "corner":
        return np.where(rng.random(space.shape) < 0.5, space.low, space.high) if k % 20 < 10 else space.low.copy()
    if kind == "extreme":
        return rng.choice([0.0, -0.0, 1e-320, 1.0, -1e20, 1e38, -1e160, 1e300, -1.7e308], size=space.shape)
    wrong: list[Any] = [
        np.full(space.shape, np.nan), np.full(space.shape, np.inf), "x", None, {}, [], np.zeros(0), 1j, True,
        np.zeros((*space.shape, 1)), np.full(space.shape, "1"), np.full(space.shape, None), space.low.tolist(),
        np.zeros(space.shape, np.complex128), np.zeros(space.shape, np.int8), [[1], [2, 3]], 10**400,
    ]  # fmt: skip
    return wrong[k % len(wrong)]


def _refused(error: Exception, spec: dict[str, Any]) -> dict[str, Any]:
    """Returns no problem where a refusal is one line that names the argument that was changed."""
    text = str(error)
    if "\n" in text or len(text) > 1000 or not text:
        return {"problem": f"{type(error).__name__} of {len(text)} characters is no clear line: {text[:200]!r}"}
    name = spec.get("mutated", "").split()[-1:]
    if name and name[0] in spec["kwargs"] and name[0] not in text:
        return {"problem": f"{type(error).__name__} does not name {name[0]}: {text}"}
    return {}


def _value(value: Any) -> Any:
    if isinstance(value, str):
        return copy.copy(_MEANT.get(value, value))
    if isinstance(value, list):
        return tuple(_value(each) for each in value)
    return json.loads(json.dumps(value))
