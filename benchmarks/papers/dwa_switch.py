"""A switch between DWA and a learned planner, by whether the way ahead is clear, beats both."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.papers.claim import Claim, Printed, Side, Training
from wayfield.benchmarks.papers.networks import together
from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies import make, tuned_gains
from wayfield.policies.learned.agent import body_of
from wayfield.policies.parts.stopping import beam_directions
from wayfield.policies.trained.ppo import shipped_agent

ASIDE = 0.1  # m beside the hull, of the corridor that has to be clear


@dataclasses.dataclass(frozen=True)
class Switch:
    """DWA (tuned) where the corridor ahead is clear, else the agent that ships.

    Args:
        clearance: m, of the corridor from the robot's middle.
        seed: of the agent.
        speed: m/s, at most.
    """

    clearance: float = 2.2
    seed: int = 0
    speed: float = 0.6

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def _parts(self, briefing: Briefing) -> dict[str, Any]:
        robot = body_of(briefing.robot).name
        gains = {**tuned_gains("dwa", "goal-obstacles", robot, self.speed), "max_speed": self.speed}
        return {"dwa": make("dwa", **gains), "agent": shipped_agent("goal_reaching", robot, self.seed, self.speed)}

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns both memories, (b,)."""
        return together({name: each.reset(briefing) for name, each in self._parts(briefing).items()})

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, 2), m/s and rad/s."""
        parts, states = self._parts(briefing), {name: memory[name].copy() for name in ("dwa", "agent")}
        twists = {name: each.act(observation, briefing, states[name]) for name, each in parts.items()}
        hits = observation.ranges[:, :, None] * beam_directions(briefing)
        aside = np.abs(hits[:, :, 1]) < briefing.robot.hull_radius + ASIDE
        blocked = (aside & (hits[:, :, 0] > 0.0) & (hits[:, :, 0] < self.clearance)).any(axis=1)
        driven: NDArray[np.float64] = np.where(blocked[:, None], twists["agent"], twists["dwa"])
        states["dwa"]["state"]["command"][:, briefing.robot.twist_axes] = driven
        for name, each in states.items():
            memory[name] = each
        return driven


CLAIM = Claim(
    name="dwa_switch",
    sentence="A switch between DWA and a learned planner, by how clear the way ahead is, does better than either.",
    source="Sharma, Lee, Andrews, Hadzic: Hybrid classical/RL local planner, 2024, arXiv 2410.03066",
    printed=(
        Printed("navigation time against the baselines", "26 % less", "abstract"),
        Printed("collisions of the switch", "none in the scenes tested", "abstract"),
    ),
    setting="P3DX, lagged actuators, 72 beams, 0.6 m/s, four static and four moving families of the claims split.",
    differs=(
        "The paper drives one robot live, in few scenes, and prints times. Ours is a simulation, and compares "
        "successes.",
        "The learned part is our PPO agent, which learned from VFH+ first, not their SAC on polar images. Alone it "
        "succeeds far more often than DWA here, so that DWA has little to add.",
        "Our switch looks at whether a corridor ahead is clear for a length that was searched, not at sub-goals.",
        "The paper prints no absolute number of the rival, so nothing can be calibrated.",
    ),
    would_change="A learned part that DWA can help: ours does better alone, so that `holds` is out of reach here. "
    "Another rule of switching. Scenes with more people, where the paper sees the learned part ahead.",
    contest="goal-obstacles",
    families=(
        *("clutter_10", "rooms", "doors_medium", "corridors"),
        *("moving_crossing", "moving_head_on", "moving_overtaking", "moving_crowd"),
    ),
    robot="p3dx",
    measure="success",
    agent=Side(
        "the switch, three seeds of its agent",
        "wayfield.benchmarks.papers.dwa_switch:Switch",
        budget="the clear length: best of four on 64 training scenes, 0.10 M steps; the agents as they ship",
        seeds=(0, 1, 2),
    ),
    untuned=Side("DWA, default gains, nothing foreseen (Fox)", "wayfield.policies.scans.dwa:Dwa foresight=0.0"),
    tuned=Side("`dwa`, hand-tuned", "dwa", "hand-tuned", "8.6 M steps of search, then compared by hand"),
    also=Side("PPO alone, ten seeds", "ppo", "trained", "preset diff_drive_goal, 3.2 M steps a seed"),
    training=Training("diff_drive_goal", "wayfield/DiffDriveGoalObstacles-v0", "goal_reaching_p3dx"),
    scenes=15,
)
