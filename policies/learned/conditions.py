"""What an agent's card says of where it was trained and what was measured, and the line that warns outside of it."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import ACTUATORS, Actuators
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.features import LIMIT
from wayfield.policies.learned.features_sheet import SHEET, numbers_of
from wayfield.system.checks import LAST_SEED, shown
from wayfield.system.reading import is_number, is_whole

SLACK = 0.01  # of the least and the greatest speed trained on, that are no news to an agent


class NewToAgent(UserWarning):
    """An agent drives what it was not trained on."""


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and value.isprintable()


def _is_count(value: Any) -> bool:
    return is_whole(value, 0, LAST_SEED)


def _is_time(value: Any) -> bool:
    return is_number(value) and value >= 0.0


def _is_plain(value: Any) -> bool:
    return isinstance(value, bool | str) or is_number(value)


def _is_score(value: Any) -> bool:
    return value is None or is_number(value)


def _maps_to(kind: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(kind(each) for each in value.values())


def _lists(kind: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(kind(each) for each in value)


# fields that a card may have besides those that decide how it drives: what they must be, and whether a value is that
_DESCRIBED: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    "name": ("a line of text", _is_text),
    "env_kwargs": ("an object of numbers, truths and text", _maps_to(_is_plain)),
    "observation": ("a list of text", _lists(_is_text)),
    "validation": ("an object of finite numbers", _maps_to(_is_score)),
    "network.parameters": ("a whole number >= 0", _is_count),
    **{f"training.{key}": ("a line of text", _is_text)
       for key in ("env_id", "preset", "algorithm", "taught_by", "began_as")},
    "training.command": ("text", lambda value: isinstance(value, str)),
    **{f"training.{key}": ("a whole number >= 0", _is_count)
       for key in ("steps", "seed", "frames", "run_frames", "gradient_steps")},
    **{f"training.{key}": ("a finite number >= 0", _is_time) for key in ("seconds", "run_seconds", "run_cpu_seconds")},
    "training.settings": ("a list", lambda value: isinstance(value, list)),
    "training.taught_with": ("an object of numbers, truths and text", _maps_to(_is_plain)),
    "training.versions": ("an object of text", _maps_to(_is_text)),
    "training.data": ("an object of text", _maps_to(_is_text)),
}  # fmt: skip


def check_described(card: Mapping[str, Any]) -> None:
    """Raises ValueError, naming the field, unless what a card says of its agent, where it does, is of its kind."""
    for field, (wanted, fits) in _DESCRIBED.items():
        room, _, key = field.rpartition(".")
        of = card[room] if room else card
        if key in of and not fits(of[key]):
            raise ValueError(f"{field} must be {wanted}, got {shown(of[key])}")


def check_conditions(card: Mapping[str, Any]) -> None:
    """Raises ValueError, naming the field, unless a card's `trained_on`, `cruises`, `measured`, if any, are whole."""
    trained = card.get("trained_on")
    if isinstance(trained, dict) and "ranges" in trained:
        _check_ranges(trained)
    elif trained is not None:
        kinds = {"actuators": str, "disturbances": str, "speeds": float, "beams": int}
        if isinstance(trained, dict) and "teams" in trained:
            kinds["teams"] = int
        if not isinstance(trained, dict) or set(trained) != set(kinds):
            raise ValueError(f"trained_on must have exactly {', '.join(kinds)}, got {shown(trained)}")
        for key, kind in kinds.items():
            listed = trained[key]
            if not isinstance(listed, list) or not all(type(each) is kind for each in listed):
                raise ValueError(f"trained_on.{key} must be a list of {kind.__name__}, got {shown(listed)}")
        if not trained["actuators"] or not set(trained["actuators"]) <= set(ACTUATORS):
            raise ValueError(
                f"trained_on.actuators must be of {', '.join(ACTUATORS)}, got {shown(trained['actuators'])}"
            )
        if not trained["speeds"] or not all(is_number(each) and each > 0.0 for each in trained["speeds"]):
            raise ValueError(f"trained_on.speeds must be speeds above 0 m/s, got {shown(trained['speeds'])}")
    cruises = card.get("cruises", {})
    tiers = trained.get("actuators", []) if trained else []
    if not isinstance(cruises, dict) or not set(cruises) <= set(tiers):
        raise ValueError(f"cruises must be for actuators of trained_on, got {shown(cruises)}")
    for tier, cruise in cruises.items():
        if not _is_cruise(cruise):
            raise ValueError(
                f"cruises.{tier} must be pairs of speeds above 0, told and driven, both rising, got {shown(cruise)}"
            )
    measured = card.get("measured", [])
    if not isinstance(measured, list):
        raise ValueError(f"measured must be a list, got {shown(measured)}")
    for k, each in enumerate(measured):
        if not _is_measured(each):
            needed = "env_kwargs, and numbers: asked_speed, success and collision (0 to 1), error if any"
            raise ValueError(f"measured[{k}] must have {needed}; got {shown(each)}")


def _check_ranges(trained: Mapping[str, Any]) -> None:
    """Raises ValueError unless what a card says of robots that were drawn is whole."""
    if set(trained) != {"ranges", "robots", "disturbances"} or not is_whole(trained["robots"], 1, LAST_SEED):
        raise ValueError(f"trained_on must have exactly ranges, robots, disturbances, got {shown(dict(trained))}")
    if not _lists(_is_text)(trained["disturbances"]):
        raise ValueError(f"trained_on.disturbances must be a list of text, got {shown(trained['disturbances'])}")
    ranges = trained["ranges"]
    pairs = isinstance(ranges, dict) and all(_lists(is_number)(each) and len(each) == 2 for each in ranges.values())
    if not pairs or set(ranges) != set(SHEET) or not all(low <= high for low, high in ranges.values()):
        raise ValueError(f"trained_on.ranges must be least and most of {', '.join(SHEET)}, got {shown(ranges)}")


def _is_cruise(cruise: Any) -> bool:
    """Returns whether pairs of speeds are as `commanded_speed` needs them."""
    if not isinstance(cruise, list) or not all(isinstance(each, list) and len(each) == 2 for each in cruise):
        return False
    if not all(is_number(speed) and speed > 0.0 for pair in cruise for speed in pair):
        return False
    return all(low[0] < high[0] and low[1] < high[1] for low, high in itertools.pairwise(cruise))


def _is_measured(condition: Any) -> bool:
    """Returns whether a condition, and what was found in it, are as a card should have them."""
    if not isinstance(condition, dict) or not _maps_to(_is_plain)(condition.get("env_kwargs")):
        return False
    if not all(is_number(condition.get(name)) for name in ("asked_speed", "success", "collision")):
        return False
    shares = all(0.0 <= condition[name] <= 1.0 for name in ("success", "collision"))
    return shares and all(_is_score(value) for name, value in condition.items() if name != "env_kwargs")


def effective_actuators(card: Mapping[str, Any], briefing: Briefing) -> Actuators:
    """Returns the actuators that an agent drives its base by: the base's own, or slower ones that it knows.

    A base that is quicker than every one that the agent was trained on is held to the quickest of those, so that it
    moves as in training.
    """
    own, known = briefing.actuators, _known(card, briefing)
    if not known or own in known:
        return own
    quickest = max(known, key=lambda each: each.acceleration)
    quicker = (
        own.acceleration >= quickest.acceleration
        and own.yaw_acceleration >= quickest.yaw_acceleration
        and own.lag <= quickest.lag
    )
    return quickest if quicker else own


def network_speed(card: Mapping[str, Any], briefing: Briefing, speed: float) -> float:
    """Returns the speed (m/s) that an agent tells its network where one is asked for.

    On a base that it knows, or drives as one of those, that of which the asked one comes as the mean on a path, by what
    its card says was measured (`commanded_speed`); where it says nothing, the asked one.

    On a base that is slower than every one that the agent was trained on, no more than it can stop at: the speed v at
    which that stops on the same way as the slowest of those at the asked one: v tau + v^2 / (2 a), tau the lag, a the
    acceleration.
    """
    own, known = briefing.actuators, _known(card, briefing)
    if not known:
        return speed
    driven = effective_actuators(card, briefing)
    if driven in known:
        tier = card["trained_on"]["actuators"][known.index(driven)]
        return commanded_speed(card.get("cruises", {}).get(tier, []), speed, max(card["trained_on"]["speeds"]))
    slowest = min(known, key=lambda each: each.acceleration)
    if slowest.acceleration == math.inf:  # it never had to stop
        return speed
    way = speed * slowest.lag + speed * speed / (2.0 * slowest.acceleration)
    lag, acceleration = own.lag, own.acceleration
    if way >= speed * lag + speed * speed / (2.0 * acceleration):
        return speed
    return acceleration * (math.sqrt(lag * lag + 2.0 * way / acceleration) - lag)


def commanded_speed(cruise: Sequence[Sequence[float]], speed: float, most: float) -> float:
    """Returns the speed (m/s) that an agent has to be told to drive another one in the mean.

    In proportion between those that were measured, and below them. Above them the greatest of them; the asked one where
    that is greater still, unless it was seen that the agent drives no faster by being told more.

    Args:
        cruise: pairs of the speed told and the mean one driven, m/s, both rising; none: the asked one is told.
        speed: m/s, asked for.
        most: m/s, that the agent was told in training.
    """
    if not cruise:
        return speed
    requested, driven = zip(*cruise, strict=True)
    if speed > driven[-1]:
        return float(requested[-1] if requested[-1] < most else max(requested[-1], speed))
    return float(np.interp(speed, (0.0, *driven), (0.0, *requested)))


def held_pace(speed: float, paced: NDArray[np.float64], twists: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    """Returns the way (b,), m, that robots are late by: the asked speed times the time, less the way driven.

    An agent that is told a speed in proportion to it holds the asked mean on any path where it can: proportional
    control of the way is integral control of the speed.

    Args:
        speed: m/s, asked for.
        paced: (b, 2) the way that they were late by, m, and the speed measured then, m/s; they are replaced.
        twists: (b, t) measured, m/s and rad/s.
        dt: control period, s.
    """
    driven = np.sqrt(np.square(twists[:, :-1]).sum(axis=1))
    paced[:, 0] += dt * (speed - 0.5 * (driven + paced[:, 1]))
    paced[:, 1] = driven
    late: NDArray[np.float64] = paced[:, 0].copy()
    return late


def _known(card: Mapping[str, Any], briefing: Briefing) -> list[Actuators]:
    """Returns the actuators that an agent was trained on, of the robot; none where its card does not say."""
    trained = card.get("trained_on") or {}
    return [briefing.robot.actuators(tier) for tier in trained.get("actuators", [])]


def out_of_distribution(card: Mapping[str, Any], briefing: Briefing, speed: float) -> str:
    """Returns a line that says in what an agent is asked to drive that it was not trained in, and what was measured.

    "" where nothing is new to it, or its card does not say what it was trained on.

    Args:
        speed: m/s, that is asked for.
    """
    trained = card.get("trained_on")
    if trained is None:
        return ""
    if "ranges" in trained:
        return _out_of_ranges(card, trained["ranges"], briefing, speed)
    tiers = (tier for tier in ACTUATORS if briefing.robot.actuators(tier) == briefing.actuators)
    tier, beams, new = next(tiers, ""), len(briefing.beam_angles), []
    late = briefing.actuators.response is not None
    if tier not in trained["actuators"] and (late or effective_actuators(card, briefing) is briefing.actuators):
        slowed = network_speed(card, briefing, speed)
        how = "with a response of its own, predicted" if late else f"with actuators {tier or 'of its own'!r}"
        new.append(f"{how}, not {_listed(trained['actuators'])}")
        if slowed < speed:
            new[-1] += f" (so at no more than {slowed:.2f} m/s)"
    low, high = min(trained["speeds"]), max(trained["speeds"])
    if not (1.0 - SLACK) * low <= speed <= (1.0 + SLACK) * high:
        new.append(f"at {speed:g} m/s, not {low:g}" + (f" to {high:g}" if high > low else ""))
    if beams and beams not in trained["beams"]:
        new.append(f"with {beams} beams, not {_listed(trained['beams'])}")
    teams = trained.get("teams", [])
    if teams and briefing.team > max(teams):
        new.append(f"in a team of {briefing.team}, not {min(teams)} to {max(teams)}")
    if not new:
        return ""
    return _warning(card, new, {"actuators": tier, "num_beams": beams, "speed": speed})


def _out_of_ranges(
    card: Mapping[str, Any], ranges: Mapping[str, Sequence[float]], briefing: Briefing, speed: float
) -> str:
    """Returns the line of an agent that drives any robot: which numbers of the data sheet are beyond those it met.

    What is denser or farther than the network can tell, 360 beams and 25 m, is as the greatest of those.
    """
    new = []
    for name, value in numbers_of(briefing, speed).items():
        low, high = ranges[name]
        seen = min(value, LIMIT * SHEET[name])
        if not (1.0 - SLACK) * low <= seen <= (1.0 + SLACK) * high:
            unit = UNITS.get(name, "")
            new.append(f"with {name} {value:.3g}{unit}, not {low:.3g} to {high:.3g}")
    if not new:
        return ""
    tiers = (tier for tier in ACTUATORS if briefing.robot.actuators(tier) == briefing.actuators)
    requested = {"actuators": next(tiers, ""), "num_beams": len(briefing.beam_angles), "speed": speed}
    return _warning(card, [f"{briefing.robot.name} {new[0]}", *new[1:]], requested | {"robot": briefing.robot.name})


UNITS = {
    **dict.fromkeys(("hull", "stopping_way", "range"), " m"),
    **dict.fromkeys(("lag", "braking_time", "turning_time"), " s"),
    **{"speed": " m/s", "yaw_rate": " rad/s", "view": " rad"},
}


def _warning(card: Mapping[str, Any], new: Sequence[str], requested: Mapping[str, Any]) -> str:
    """Returns the line that says what is new, and what was measured nearest to what is asked for."""
    speed = requested["speed"]
    validated = card.get("validation")
    own = {"asked_speed": card["speed"], "env_kwargs": card["env_kwargs"]}
    own |= validated if isinstance(validated, dict) else {}
    everywhere = [*([own] if _is_measured(own) else []), *card.get("measured", [])]
    measured = sorted(everywhere, key=lambda each: (-_likeness(each, requested), abs(each["asked_speed"] - speed)))
    result = _result(measured[0], "robot" in requested) if measured else "nothing was measured"
    name = str(card.get("name", "an agent")).split(",")[0]
    return f"{name} drives {' and '.join(new)}, which it was trained on; nearest to that, {result}"


def _likeness(measured: Mapping[str, Any], requested: Mapping[str, Any]) -> int:
    """Returns in how many things a condition that was measured is the one that is asked for, the tier first."""
    result = {"actuators": "ideal", "num_beams": 0, **measured["env_kwargs"], "speed": measured["asked_speed"]}
    same = sum(int(result.get(name) == requested[name]) for name in requested)
    return 2 * int(result["actuators"] == requested["actuators"]) + same


def _result(measured: Mapping[str, Any], of_any: bool) -> str:
    """Returns what was found in a condition, with the robot where an agent of any was measured."""
    kwargs, error = measured["env_kwargs"], measured.get("error")
    beams = [f"{kwargs['num_beams']} beams"] if "num_beams" in kwargs else []
    robot = [str(kwargs.get("robot", "the default robot"))] if of_any else []
    where = ", ".join([*robot, str(kwargs.get("actuators", "ideal")), f"{measured['asked_speed']:g} m/s", *beams])
    results = [f"{100.0 * measured['success']:.0f} % succeeded", f"{100.0 * measured['collision']:.0f} % failed badly"]
    if error is not None:
        results.append(f"{error:.1f} s" if beams else f"{error:.4f} m off")
    return f"{', '.join(results)} ({where})"


def _listed(values: list[Any]) -> str:
    return " or ".join(map(str, values)) or "any"
