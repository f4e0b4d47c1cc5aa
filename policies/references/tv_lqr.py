"""Time-varying LQR about a reference that is told, on the exact motion of a control period."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.robots.references import References, sample_index
from wayfield.envs.scenarios.reference_proofs import Lag, regulated, regulator
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.params import plant
from wayfield.system.compiled import any_layout, compiled

MEMORY = np.dtype([("period", np.int64)])  # of the reference, that comes next


@dataclasses.dataclass(frozen=True)
class TvLqr(Gains):
    """The command after which the wheels turn as the reference does, less gains on what the base is off by.

    With z the robot minus the reference in the reference's frame, behind it the twist that its wheels turn for minus
    the reference's, v_k the reference's twist and d what the lag leaves of a deviation after a period:

        u = c_k - K_k z_k,  c_k = (v_k+1 - d v_k) / (1 - d)

    K_k minimises the sum of z'Qz + (u - c)'R(u - c) for the base's exact motion, linearised about the reference, by the
    Riccati recursion backwards in time. It knows no limits: heavier weights on the error are nearer to the reference,
    and swing for seconds where a start is off it. It is what proves a reference in `envs.scenarios.reference_proofs`.

    Source: Anderson, Moore, Optimal Control: Linear Quadratic Methods, 1990, section 2.4.
    """

    q_place: float = gain(10.0, "1/m^2", "weight of the error in x and y", above=0.0, search=(1.0, 200.0))
    q_heading: float = gain(1.0, "1/rad^2", "of the heading's", above=0.0, search=(0.1, 20.0))
    r_speed: float = gain(1.0, "s^2/m^2", "of the command's speed off that of the reference", above=0.0)
    r_turn: float = gain(0.5, "s^2/rad^2", "of its yaw rate", above=0.0, search=(0.05, 5.0))

    knows: ClassVar[str] = "path"
    observes: ClassVar[tuple[type, ...]] = (trajectory_tracking.Observation,)
    needs: ClassVar[tuple[str, ...]] = ()

    def reset(self, briefing: Briefing) -> NDArray[np.void]:
        """Returns the memories (b,): each reference begins."""
        self._gains(briefing)
        return np.zeros(briefing.num_envs, MEMORY)

    def act(
        self, observation: trajectory_tracking.Observation, briefing: Briefing, memory: NDArray[np.void]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        assert briefing.reference is not None
        gains, first = self._gains(briefing)
        twists = np.empty((len(memory), len(briefing.robot.twist_axes)))
        base = plant(briefing.robot, briefing.actuators, briefing.dt)
        regulate(
            base, briefing.robot.holonomic, gains, first, *briefing.reference, observation.pose, observation.twist,
            memory, twists,
        )  # fmt: skip
        return twists

    def _gains(self, briefing: Briefing) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Returns the gains (n, t, 3 + t) of all samples that robots are on, and where those of each robot begin."""
        assert briefing.reference is not None
        reference = briefing.reference
        base = plant(briefing.robot, briefing.actuators, briefing.dt)
        key = (self, id(reference.samples), reference.which.tobytes(), base.tobytes())
        if key not in _MADE:
            if len(_MADE) >= _MOST_MADE:
                del _MADE[next(iter(_MADE))]
            _MADE[key] = (reference, *self._made(reference, base, briefing.robot.holonomic))
        return _MADE[key][1:]

    def _made(self, reference: References, base: NDArray[np.void], holonomic: bool) -> Any:
        weights = np.array([self.q_place, self.q_place, self.q_heading])
        prices = np.array([self.r_speed, self.r_speed, self.r_turn])
        each, whose = np.unique(reference.which, return_inverse=True)
        gains = [
            regulator(reference.samples, reference.times[k : k + 1], Lag.of(base), holonomic, weights, prices)
            for k in each
        ]
        return np.concatenate(gains), np.cumsum([0, *map(len, gains[:-1])])[whose]


# by policy, references and robots' places among them; the references are kept, so that their ids stay theirs
_MADE: dict[tuple[Any, ...], tuple[References, NDArray[np.float64], NDArray[np.int64]]] = {}
_MOST_MADE = 16


@any_layout
@compiled
def regulate(bases, holonomic, gains, first, samples, times, index, poses, wheels, memory, twists):
    """Fills the (b, t) twists of `TvLqr.act`, and counts the periods of the memory."""
    last = twists.shape[1] - 1
    for i in range(twists.shape[0]):
        run = times[index[i]]
        k = memory[i].period
        memory[i].period = k + 1
        at = sample_index(run, k)
        there = samples[sample_index(run, k + 1)]
        wheel = wheels[i, 0], wheels[i, 1] if last == 2 else 0.0, wheels[i, last]
        pose = poses[i, 0], poses[i, 1], poses[i, 2]
        twist = regulated(bases[0], holonomic, gains[first[i] + at - run.first], samples[at], there, pose, wheel)
        twists[i, 0] = twist[0]
        if last == 2:
            twists[i, 1] = twist[1]
        twists[i, last] = twist[2]
