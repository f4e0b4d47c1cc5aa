"""PPO with the numbers of stable-baselines3, bit for bit, in fewer operations: its gradients are written out."""

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor
from torch.nn.functional import linear

Pairs = list[tuple[Tensor, Tensor]]  # weights (outputs, inputs) and biases, layer after layer
_LINE = 16  # numbers of a cache line: products may round otherwise where a matrix begins elsewhere
_NORMAL = math.log(math.sqrt(2.0 * math.pi))


class Proximal(PPO):
    """stable-baselines3's PPO of two networks without common layers, tanh or relu, whose actions are normal.

    Weights, moments and random numbers are those of `PPO` in every bit, on as many threads. For networks as small as
    ours, autograd's graph and Adam's dozen operations for each array take as long as the products of matrices.
    """

    policy: Any

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fills the buffer with `n_rollout_steps` steps of every robot; asks no callback."""
        buffer, box = rollout_buffer, self.action_space
        assert box.shape is not None
        means, values = (_pairs(each) for each in self._networks())
        buffer.reset()
        with torch.no_grad():
            zeros, ones = torch.zeros(env.num_envs, *box.shape), torch.ones(env.num_envs, *box.shape)
            spread = self.policy.log_std.exp()
            for k in range(n_rollout_steps):
                seen: Any = self._last_obs
                x = torch.from_numpy(seen)
                mean = self._passed(x, means)[-1]
                buffer.values[k] = self._passed(x, values)[-1].numpy()[:, 0]
                actions = mean + torch.normal(zeros, ones).mul_(spread)
                buffer.log_probs[k] = _log_densities(actions - mean, spread)[1].sum(dim=1).numpy()
                chosen = actions.numpy()
                buffer.observations[k], buffer.actions[k] = seen, chosen
                buffer.episode_starts[k] = self._last_episode_starts
                observations, rewards, ended, infos = env.step(np.clip(chosen, box.low, box.high))  # type: ignore[attr-defined]
                self.num_timesteps += env.num_envs
                for i in np.flatnonzero(ended).tolist():
                    if infos[i]["TimeLimit.truncated"]:  # one by one: in a batch products may round otherwise
                        last = torch.from_numpy(infos[i]["terminal_observation"][None])
                        rewards[i] += np.float32(self.gamma) * self._passed(last, values)[-1].numpy()[0, 0]
                buffer.rewards[k] = rewards
                self._last_obs, self._last_episode_starts = observations, ended  # type: ignore[assignment]
            end = self._passed(torch.from_numpy(observations), values)[-1]
        buffer.pos, buffer.full = n_rollout_steps, True
        buffer.compute_returns_and_advantage(last_values=end, dones=ended)
        return True

    @torch.no_grad()
    def train(self) -> None:
        """Makes the passes over what the buffer holds, or fewer, where the policy moves by more than `target_kl`."""
        buffer, optimizer = self.rollout_buffer, self.policy.optimizer
        self._update_learning_rate(optimizer)
        clip: float = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        parts = _Parameters(optimizer)
        means, values = (_pairs(each, parts.values) for each in self._networks())
        of_means, of_values = (_pairs(each, parts.gradients) for each in self._networks())
        deviation, of_deviation = (each[id(self.policy.log_std)] for each in (parts.values, parts.gradients))
        arrays = buffer.observations, buffer.actions, buffer.log_probs, buffer.advantages, buffer.returns
        frames = [torch.from_numpy(each.reshape(-1, *each.shape[2:])) for each in arrays]
        periods, robots = buffer.buffer_size, buffer.n_envs
        half, far = torch.tensor(self.vf_coef), False
        for _ in range(self.n_epochs):
            divergences = []
            # robot by robot, as stable-baselines3 counts
            order = np.random.permutation(periods * robots)  # noqa: NPY002
            for rows in torch.from_numpy(order % periods * robots + order // periods).split(self.batch_size):
                x, actions, before, advantages, returns = (each.index_select(0, rows) for each in frames)
                passed = self._passed(x, means)
                surrogate = _Surrogate(passed[-1], deviation, actions, before, advantages, clip)
                divergences.append(surrogate.divergence)
                far = self.target_kl is not None and bool(surrogate.divergence > 1.5 * self.target_kl)
                if far:
                    break
                self._back(surrogate.gradient(of_deviation, self.ent_coef), passed, means, of_means)
                passed = self._passed(x, values)
                error = torch.ops.aten.mse_loss_backward(half, passed[-1][:, 0], returns, 1)
                self._back(error[:, None], passed, values, of_values)
                parts.descend(self.max_grad_norm)
            self._n_updates += 1
            if far:
                break
        parts.put_back()
        self.logger.record("train/approx_kl", np.mean(divergences))
        value, wanted = (each.swapaxes(0, 1).flatten() for each in (buffer.values, buffer.returns))
        self.logger.record("train/explained_variance", explained_variance(value, wanted))
        self.logger.record("train/std", self.policy.log_std.exp().mean().item())

    def _networks(self) -> tuple[list[torch.nn.Linear], list[torch.nn.Linear]]:
        """Returns the layers of the policy's mean and those of the value function."""
        policy, hidden = self.policy, self.policy.mlp_extractor
        means, values = (
            [each for each in layers if isinstance(each, torch.nn.Linear)]
            for layers in ([*hidden.policy_net, policy.action_net], [*hidden.value_net, policy.value_net])
        )
        return means, values

    def _passed(self, x: Tensor, layers: Pairs) -> list[Tensor]:
        """Returns the inputs (b, n) of every layer and what comes out of the last."""
        result = [x]
        for k, (weight, bias) in enumerate(layers):
            x = linear(x, weight, bias)
            if k < len(layers) - 1:
                x = x.tanh_() if self._tanh else x.relu_()
            result.append(x)
        return result

    def _back(self, gradient: Tensor, passed: list[Tensor], layers: Pairs, gradients: Pairs) -> None:
        """Fills the gradients of layers, from that (b, n) of what comes out of the last and what `_passed` returned."""
        for k in range(len(layers) - 1, -1, -1):
            torch.mm(gradient.t(), passed[k], out=gradients[k][0])
            torch.sum(gradient, 0, out=gradients[k][1])
            if k:
                gradient = gradient.mm(layers[k][0])
                if self._tanh:
                    torch.ops.aten.tanh_backward.grad_input(gradient, passed[k], grad_input=gradient)
                else:
                    torch.ops.aten.threshold_backward.grad_input(gradient, passed[k], 0, grad_input=gradient)

    @property
    def _tanh(self) -> bool:
        return self.policy.activation_fn is torch.nn.Tanh


def _pairs(layers: list[torch.nn.Linear], views: dict[int, Tensor] | None = None) -> Pairs:
    """Returns weights and biases of layers: themselves, or the views of their own."""
    pairs = [(each.weight, each.bias) for each in layers]
    return [(views[id(weight)], views[id(bias)]) for weight, bias in pairs] if views else list(pairs)


def _log_densities(away: Tensor, deviation: Tensor) -> tuple[Tensor, Tensor]:
    """Returns -x^2 / (2 s^2) (b, n), x from the means of normal numbers, and the logarithms of densities."""
    exponents = (away * away).neg_().div_(2.0 * deviation**2)
    return exponents, (exponents - deviation.log()).sub_(_NORMAL)


class _Surrogate:
    """PPO's clipped objective over a minibatch, and how far the policy has moved by now."""

    def __init__(
        self, mean: Tensor, log_std: Tensor, actions: Tensor, before: Tensor, advantages: Tensor, clip: float
    ) -> None:
        self.deviation = log_std.exp()
        self.away = actions - mean
        self.exponents, densities = _log_densities(self.away, self.deviation)
        moved = densities.sum(dim=1).sub_(before)
        self.ratio = moved.exp()
        self.advantages, self.clip = advantages, clip
        if len(advantages) > 1:
            self.advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        self.divergence: NDArray[np.float32] = ((self.ratio - 1.0) - moved).mean().numpy()

    def gradient(self, out: Tensor, entropy: float) -> Tensor:
        """Returns the gradient (b, n) of the loss by the means, and fills that (n,) by the logarithms of deviations."""
        ratio, low, high, scale = self.ratio, 1.0 - self.clip, 1.0 + self.clip, self.deviation
        count = len(ratio)
        free, clipped = self.advantages * ratio, self.advantages * ratio.clamp(low, high)
        # as autograd has it, each of two that are equal has half
        shares = (free == clipped).float().mul_(0.5)
        weights = shares + ((ratio >= low) & (ratio <= high)) * shares + (free < clipped)
        outward = (weights.mul_(torch.tensor(-1.0) / count) * self.advantages).mul_(ratio)[:, None]
        double = 2.0 * scale**2
        by_scale = (-outward * (self.exponents / double)).mul_(2.0) * (2.0 * scale)
        by_log = -outward / scale
        if entropy:
            by_log += torch.tensor(-entropy) / count / scale
        torch.mul((by_log + by_scale).sum(0), scale, out=out)
        return (outward / double).mul_(2.0 * self.away)


class _Parameters:
    """An optimizer's parameters, their gradients and Adam's moments: one array of each, with views."""

    def __init__(self, optimizer: torch.optim.Optimizer) -> None:
        self._group, self._state = optimizer.param_groups[0], optimizer.state
        self._own: list[torch.nn.Parameter] = self._group["params"]
        self._ends = np.cumsum([-(-each.numel() // _LINE) * _LINE for each in self._own]).tolist()
        self._values, self._gradient, self._mean, self._square = (torch.zeros(self._ends[-1]) for _ in range(4))
        self.values, self.gradients = (
            {id(own): view for own, view in zip(self._own, self._views(each), strict=True)}
            for each in (self._values, self._gradient)
        )
        self._moments = {"exp_avg": self._views(self._mean), "exp_avg_sq": self._views(self._square)}
        self._steps = 0.0
        for k, own in enumerate(self._own):
            self.values[id(own)].copy_(own)
            if self._state[own]:
                self._steps = self._state[own]["step"].item()
                for name, views in self._moments.items():
                    views[k].copy_(self._state[own][name])

    def _views(self, array: Tensor) -> list[Tensor]:
        firsts = [0, *self._ends[:-1]]
        return [array[k : k + each.numel()].view(each.shape) for k, each in zip(firsts, self._own, strict=True)]

    def descend(self, most: float) -> None:
        """Makes a step of Adam by gradients of norm `most` or less."""
        norms = torch._foreach_norm(list(self.gradients.values()))
        gradient = self._gradient.mul_((most / (torch.stack(norms).norm() + 1e-6)).clamp_(max=1.0))
        first, second = self._group["betas"]
        self._steps += 1.0
        self._mean.lerp_(gradient, 1.0 - first)
        self._square.mul_(second).addcmul_(gradient, gradient, value=1.0 - second)
        root = (self._square.sqrt() / (1.0 - second**self._steps) ** 0.5).add_(self._group["eps"])
        self._values.addcdiv_(self._mean, root, value=-self._group["lr"] / (1.0 - first**self._steps))

    def put_back(self) -> None:
        """Gives what was learned to the parameters and to the optimizer."""
        for k, own in enumerate(self._own):
            own.copy_(self.values[id(own)])
            if self._steps:
                self._state[own] = {"step": torch.tensor(self._steps)}
                self._state[own] |= {name: views[k].clone() for name, views in self._moments.items()}
