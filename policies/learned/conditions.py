"""What an agent's card says of where it was trained and what was measured, and the line that warns outside of it."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wayfield.envs.briefing import Briefing
from wayfield.envs.checks import shown
from wayfield.envs.robots import ACTUATORS, Actuators
from wayfield.policies.learned.reading import is_number

SLACK = 0.01  # of the least and the greatest speed trained on, that are no news to an agent


class NewToAgent(UserWarning):
    """An agent is asked to drive what it was not trained on."""


def check_conditions(card: Mapping[str, Any]) -> None:
    """Raises ValueError, naming the field, unless a card's `trained_on`, `cruises`, `measured`, if any, are whole."""
    trained = card.get("trained_on")
    if trained is not None:
        kinds = {"actuators": str, "disturbances": str, "speeds": float, "beams": int}
        if not isinstance(trained, dict) or set(trained) != set(kinds):
            raise ValueError(f"trained_on must have exactly {', '.join(kinds)}, got {shown(trained)}")
        if not set(map(str, trained["actuators"] or ["none"])) <= set(ACTUATORS):
            raise ValueError(
                f"trained_on.actuators must be of {', '.join(ACTUATORS)}, got {shown(trained['actuators'])}"
            )
        for key, kind in kinds.items():
            listed = trained[key]
            if not isinstance(listed, list) or not all(type(each) is kind for each in listed):
                raise ValueError(f"trained_on.{key} must be a list of {kind.__name__}, got {shown(listed)}")
        if not trained["speeds"] or not all(is_number(each) and each > 0.0 for each in trained["speeds"]):
            raise ValueError(f"trained_on.speeds must be speeds above 0 m/s, got {shown(trained['speeds'])}")
    cruises = card.get("cruises", {})
    if not isinstance(cruises, dict) or not set(cruises) <= set(trained["actuators"] if trained else []):
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
            needed = "env_kwargs, asked_speed, success, collision, and error if any"
            raise ValueError(f"measured[{k}] must have {needed}, got {shown(each)}")


def _is_cruise(cruise: Any) -> bool:
    """Returns whether pairs of speeds are as `told_speed` needs them."""
    if not isinstance(cruise, list) or not all(isinstance(each, list) and len(each) == 2 for each in cruise):
        return False
    if not all(is_number(speed) and speed > 0.0 for pair in cruise for speed in pair):
        return False
    return all(low[0] < high[0] and low[1] < high[1] for low, high in itertools.pairwise(cruise))


def _is_measured(condition: Any) -> bool:
    """Returns whether a condition, and what was found in it, are as a card should have them."""
    if not isinstance(condition, dict) or not isinstance(condition.get("env_kwargs"), dict):
        return False
    error = condition.get("error")
    numbers = all(is_number(condition.get(name)) for name in ("asked_speed", "success", "collision"))
    return numbers and (error is None or is_number(error))


def driven_as(card: Mapping[str, Any], briefing: Briefing) -> Actuators:
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


def driven_speed(card: Mapping[str, Any], briefing: Briefing, speed: float) -> float:
    """Returns the speed (m/s) that an agent tells its network where one is asked for.

    On a base that it knows, or drives as one of those, that of which the asked one comes as the mean on a path, by what
    its card says was measured (`told_speed`); where it says nothing, the asked one.

    On a base that is slower than every one that the agent was trained on, no more than it can stop at: the speed v at
    which that stops on the same way as the slowest of those at the asked one: v tau + v^2 / (2 a), tau the lag, a the
    acceleration.
    """
    own, known = briefing.actuators, _known(card, briefing)
    if not known:
        return speed
    driven = driven_as(card, briefing)
    if driven in known:
        tier = card["trained_on"]["actuators"][known.index(driven)]
        return told_speed(card.get("cruises", {}).get(tier, []), speed, max(card["trained_on"]["speeds"]))
    slowest = min(known, key=lambda each: each.acceleration)
    if slowest.acceleration == math.inf:  # it never had to stop
        return speed
    way = speed * slowest.lag + speed * speed / (2.0 * slowest.acceleration)
    lag, acceleration = own.lag, own.acceleration
    if way >= speed * lag + speed * speed / (2.0 * acceleration):
        return speed
    return acceleration * (math.sqrt(lag * lag + 2.0 * way / acceleration) - lag)


def told_speed(cruise: Sequence[Sequence[float]], speed: float, most: float) -> float:
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
    told, driven = zip(*cruise, strict=True)
    if speed > driven[-1]:
        return float(told[-1] if told[-1] < most else max(told[-1], speed))
    return float(np.interp(speed, (0.0, *driven), (0.0, *told)))


def _known(card: Mapping[str, Any], briefing: Briefing) -> list[Actuators]:
    """Returns the actuators that an agent was trained on, of the robot; none where its card does not say."""
    trained = card.get("trained_on")
    return [briefing.robot.actuators(tier) for tier in trained["actuators"]] if trained else []


def outside(card: Mapping[str, Any], briefing: Briefing, speed: float) -> str:
    """Returns a line that says in what an agent is asked to drive that it was not trained in, and what was measured.

    "" where nothing is new to it, or its card does not say what it was trained on.

    Args:
        speed: m/s, that is asked for.
    """
    trained = card.get("trained_on")
    if trained is None:
        return ""
    tiers = (tier for tier in ACTUATORS if briefing.robot.actuators(tier) == briefing.actuators)
    tier, beams, new = next(tiers, ""), len(briefing.beam_angles), []
    if tier not in trained["actuators"] and driven_as(card, briefing) is briefing.actuators:
        slowed = driven_speed(card, briefing, speed)
        new.append(f"with actuators {tier or 'of its own'!r}, not {_listed(trained['actuators'])}")
        if slowed < speed:
            new[-1] += f" (so at no more than {slowed:.2f} m/s)"
    low, high = min(trained["speeds"]), max(trained["speeds"])
    if not (1.0 - SLACK) * low <= speed <= (1.0 + SLACK) * high:
        new.append(f"at {speed:g} m/s, not {low:g}" + (f" to {high:g}" if high > low else ""))
    if beams and beams not in trained["beams"]:
        new.append(f"with {beams} beams, not {_listed(trained['beams'])}")
    if not new:
        return ""
    asked = {"actuators": tier, "num_beams": beams, "speed": speed}
    validated = card.get("validation")
    own = {"asked_speed": card["speed"], "env_kwargs": card.get("env_kwargs")}
    own |= validated if isinstance(validated, dict) else {}
    everywhere = [*([own] if _is_measured(own) else []), *card.get("measured", [])]
    measured = sorted(everywhere, key=lambda each: (-_likeness(each, asked), abs(each["asked_speed"] - speed)))
    found = _found(measured[0]) if measured else "nothing was measured"
    name = str(card.get("name", "an agent")).split(",")[0]
    return f"{name} drives {' and '.join(new)}, which it was trained on; nearest to that, {found}"


def _likeness(measured: Mapping[str, Any], asked: Mapping[str, Any]) -> int:
    """Returns in how many things a condition that was measured is the one that is asked for, the tier first."""
    found = {"actuators": "ideal", "num_beams": 0, **measured["env_kwargs"], "speed": measured["asked_speed"]}
    return 2 * int(found["actuators"] == asked["actuators"]) + sum(int(found[name] == asked[name]) for name in asked)


def _found(measured: Mapping[str, Any]) -> str:
    kwargs, error = measured["env_kwargs"], measured.get("error")
    beams = [f"{kwargs['num_beams']} beams"] if "num_beams" in kwargs else []
    where = ", ".join([str(kwargs.get("actuators", "ideal")), f"{measured['asked_speed']:g} m/s", *beams])
    told = [f"{100.0 * measured['success']:.0f} % succeeded", f"{100.0 * measured['collision']:.0f} % failed badly"]
    if error is not None:
        told.append(f"{error:.1f} s" if beams else f"{error:.4f} m off")
    return f"{', '.join(told)} ({where})"


def _listed(values: list[Any]) -> str:
    return " or ".join(map(str, values)) or "any"
