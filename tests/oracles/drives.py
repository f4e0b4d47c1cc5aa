"""Episodes that tests drive to their end."""

from typing import Any

from wayfield.policies import Pilot


def end_of(env: Any, pilot: Pilot) -> dict[str, Any]:
    """Returns the last info of the episode of seed 0 that a pilot drives."""
    seen, info = env.reset(seed=0)
    pilot.reset()
    over = False
    while not over:
        seen, _, terminated, truncated, info = env.step(pilot.act(seen))
        over = terminated or truncated
    return dict(info)
