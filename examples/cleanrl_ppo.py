"""PPO in one file and plain torch, in the manner of CleanRL, on native vector environments.

Both autoreset modes, which differ in what the step after an end is:
- SameStep: a row whose episode ends is reset at once; its last observation stands in infos["final_obs"]. Every step is
  a transition.
- NextStep: the last observation is returned as it is; the *next* step resets the row, ignores its action and rewards
  nothing. It is no transition and is left out of the loss.
A cut by the clock (truncated) is no end of the task: the value of the last observation is bootstrapped.

pip install -c constraints.txt ".[train]"; python examples/cleanrl_ppo.py --steps 1000000 --autoreset SameStep
"""

import argparse

import gymnasium
import numpy as np
import torch
from torch import nn
from torch.distributions import Normal

import wayfield  # noqa: F401  registers the ids

GAMMA, GAE_LAMBDA, CLIP, ENTROPY, VALUE, MAX_NORM = 0.99, 0.95, 0.2, 0.0, 0.5, 0.5


class Agent(nn.Module):
    """A Gaussian policy and a value, two layers each; actions in units of the action space's bounds."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()

        def layers(out: int) -> nn.Sequential:
            return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, out))

        self.actor, self.critic = layers(outputs), layers(1)
        self.log_std = nn.Parameter(torch.full((outputs,), -0.5))

    def policy(self, observations: torch.Tensor) -> Normal:
        return Normal(self.actor(observations), self.log_std.exp())

    def value(self, observations: torch.Tensor) -> torch.Tensor:
        values: torch.Tensor = self.critic(observations).squeeze(-1)
        return values


def tensor(array: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(np.clip(array, -10.0, 10.0), dtype=torch.float32)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1_000_000, help="of all robots together")
    parser.add_argument("--robots", type=int, default=64)
    parser.add_argument("--autoreset", choices=["NextStep", "SameStep"], default="NextStep")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    rollout, epochs, parts = 64, 4, 4

    envs = gymnasium.make_vec(
        "wayfield/DiffDrivePathFollowing-v0", options.robots, actuators="lagged", autoreset_mode=options.autoreset
    )
    same_step = options.autoreset == "SameStep"
    n, scale = options.robots, envs.single_action_space.high
    agent = Agent(envs.single_observation_space.shape[0], len(scale))
    optimizer = torch.optim.Adam(agent.parameters(), lr=3e-4, eps=1e-5)

    seen, _ = envs.reset(seed=options.seed)
    resetting = np.zeros(n, bool)  # rows that the coming step only resets (NextStep)
    earned, finished = np.zeros(n), []
    for update in range(max(1, options.steps // (rollout * n))):
        observations = torch.zeros(rollout, n, *envs.single_observation_space.shape)
        actions = torch.zeros(rollout, n, len(scale))
        log_probs, rewards, values, following = (torch.zeros(rollout, n) for _ in range(4))
        ended, counts = torch.zeros(rollout, n, dtype=torch.bool), torch.zeros(rollout, n, dtype=torch.bool)
        for t in range(rollout):
            observations[t] = tensor(seen)
            with torch.no_grad():
                policy = agent.policy(observations[t])
                actions[t] = policy.sample()
                log_probs[t] = policy.log_prob(actions[t]).sum(-1)
                values[t] = agent.value(observations[t])
            seen, reward, terminated, truncated, infos = envs.step(actions[t].numpy() * scale)
            over = terminated | truncated
            last = seen.copy()  # what the step led to, before any reset
            if same_step and over.any():
                last[over] = np.stack(infos["final_obs"][over])
            with torch.no_grad():
                following[t] = torch.where(tensor(terminated) > 0, 0.0, agent.value(tensor(last)))
            rewards[t], ended[t], counts[t] = tensor(reward), torch.as_tensor(over), torch.as_tensor(~resetting)
            earned += reward
            finished += earned[over].tolist()
            earned[over] = 0.0
            resetting = over & (not same_step)

        # generalised advantage estimation; nothing flows back over an end, nor over a step that only resets
        advantages, ahead = torch.zeros(rollout, n), torch.zeros(n)
        for t in reversed(range(rollout)):
            delta = rewards[t] + GAMMA * following[t] - values[t]
            ahead = torch.where(counts[t], delta + GAMMA * GAE_LAMBDA * torch.where(ended[t], 0.0, ahead), 0.0)
            advantages[t] = ahead
        returns = advantages + values

        rows = counts.flatten().nonzero().squeeze(-1)
        flat = [each.flatten(0, 1) for each in (observations, actions, log_probs, advantages, returns)]
        for _ in range(epochs):
            for batch in rows[torch.randperm(len(rows))].chunk(parts):
                x, a, old, advantage, target = (each[batch] for each in flat)
                policy = agent.policy(x)
                ratio = (policy.log_prob(a).sum(-1) - old).exp()
                advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
                gain = torch.min(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage).mean()
                miss = (agent.value(x) - target).square().mean()
                loss = VALUE * miss - gain - ENTROPY * policy.entropy().sum(-1).mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), MAX_NORM)
                optimizer.step()
        mean = f"{np.mean(finished[-100:]):.2f}" if finished else "none yet"
        print(f"update {update + 1}: {(update + 1) * rollout * n} steps, mean return of the last 100 episodes {mean}")
    print(f"trained for {(update + 1) * rollout * n} steps")


if __name__ == "__main__":
    main()
