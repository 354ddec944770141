"""PPO with action masks on the fast environment, in one file.

    pip install torch
    python examples/ppo.py                       # learns, then drives 500 unseen episodes beside two rules
    python examples/ppo.py --seed 2 --steps 600000
    python examples/ppo.py --preset default      # the whole loop: planner, controllers, shield

Masked actions have no probability. Where an episode was truncated, the value of its last observation takes the place of what would have
followed.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

import lanecraft

#: Episodes of evaluation begin at this seed, far from those of training.
EVALUATION_SEED = 1_000_000


@dataclasses.dataclass
class Args:
    """What can be set on the command line."""

    preset: str = "fast"
    seed: int = 1
    steps: int = 300_000
    num_envs: int = 64
    #: Steps of each environment between two updates.
    rollout: int = 32
    epochs: int = 4
    minibatches: int = 4
    discount: float = 0.95
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.01
    learning_rate: float = 1e-3
    episodes: int = 500


class Agent(nn.Module):
    """Policy and value, each with a network of its own."""

    def __init__(self, observation: int, actions: int) -> None:
        super().__init__()
        self.policy, self.critic = (
            nn.Sequential(nn.Linear(observation, 128), nn.Tanh(), nn.Linear(128, 128), nn.Tanh(), nn.Linear(128, size))
            for size in (actions, 1)
        )

    def distribution(self, observations: torch.Tensor, masks: torch.Tensor) -> Categorical:
        return Categorical(logits=self.policy(observations).masked_fill(~masks, -1e9), validate_args=False)

    def value(self, observations: torch.Tensor) -> torch.Tensor:
        return self.critic(observations).squeeze(-1)


@dataclasses.dataclass
class Rollout:
    """What has been driven since the last update, each of shape (rollout, environments, ...)."""

    observations: torch.Tensor
    masks: torch.Tensor
    actions: torch.Tensor
    log_probabilities: torch.Tensor
    values: torch.Tensor
    rewards: torch.Tensor
    ends: torch.Tensor

    @classmethod
    def empty(cls, steps: int, envs: int, observation: int, actions: int) -> Rollout:
        flat = [torch.zeros(steps, envs) for _ in range(4)]
        masks = torch.zeros(steps, envs, actions, dtype=torch.bool)
        return cls(torch.zeros(steps, envs, observation), masks, torch.zeros(steps, envs, dtype=torch.long), *flat)

    def advantages(self, last_values: torch.Tensor, args: Args) -> torch.Tensor:
        """Generalized advantage estimates (Schulman et al., 2016)."""
        advantages, carried = torch.zeros_like(self.rewards), torch.zeros_like(last_values)
        next_values = last_values
        for step in reversed(range(len(self.rewards))):
            goes_on = 1.0 - self.ends[step]
            error = self.rewards[step] + args.discount * goes_on * next_values - self.values[step]
            carried = error + args.discount * args.gae_lambda * goes_on * carried
            advantages[step], next_values = carried, self.values[step]
        return advantages


def tensors(observations: np.ndarray, masks: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.from_numpy(observations.reshape(len(observations), -1)), torch.from_numpy(masks.astype(bool))


def update(agent: Agent, optimizer: torch.optim.Optimizer, rollout: Rollout, advantages: torch.Tensor, args: Args) -> None:
    columns = [rollout.observations, rollout.masks, rollout.actions, rollout.log_probabilities]
    columns += [advantages, advantages + rollout.values]
    flat = [column.flatten(0, 1) for column in columns]
    for _ in range(args.epochs):
        for rows in torch.randperm(len(flat[0])).chunk(args.minibatches):
            observations, masks, actions, old_log_probabilities, advantage, goals = (column[rows] for column in flat)
            distribution = agent.distribution(observations, masks)
            ratio = (distribution.log_prob(actions) - old_log_probabilities).exp()
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            gain = torch.min(ratio * advantage, ratio.clamp(1.0 - args.clip, 1.0 + args.clip) * advantage).mean()
            value_loss = (agent.value(observations) - goals).square().mean()
            optimizer.zero_grad()
            (0.5 * value_loss - gain - args.entropy * distribution.entropy().mean()).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()


def train(args: Args) -> Agent:
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)  # networks so small lose by more
    envs = lanecraft.VectorEnv(args.num_envs, preset=args.preset, autoreset_mode="SameStep")
    observations, infos = envs.reset(seed=args.seed)
    size, actions = observations[0].size, infos["action_mask"].shape[1]
    agent = Agent(size, actions)
    optimizer = torch.optim.Adam(agent.parameters(), args.learning_rate, eps=1e-5)
    rollout = Rollout.empty(args.rollout, args.num_envs, size, actions)
    updates = max(args.steps // (args.rollout * args.num_envs), 1)
    returns, running, start = [], np.zeros(args.num_envs), time.perf_counter()

    for number in range(updates):
        optimizer.param_groups[0]["lr"] = args.learning_rate * (1.0 - number / updates)
        for step in range(args.rollout):
            seen, masks = tensors(observations, infos["action_mask"])
            with torch.no_grad():
                distribution = agent.distribution(seen, masks)
                action = distribution.sample()
                rollout.values[step] = agent.value(seen)
            rollout.observations[step], rollout.masks[step], rollout.actions[step] = seen, masks, action
            rollout.log_probabilities[step] = distribution.log_prob(action)
            observations, rewards, terminated, truncated, infos = envs.step(action.numpy())
            running += rewards
            ends, cut = terminated | truncated, truncated & ~terminated
            if cut.any():
                last = torch.from_numpy(infos["final_obs"][cut].reshape(cut.sum(), -1))
                with torch.no_grad():
                    rewards[cut] += args.discount * agent.value(last).numpy()
            rollout.rewards[step] = torch.from_numpy(rewards)
            rollout.ends[step] = torch.from_numpy(ends)
            returns += running[ends].tolist()
            running[ends] = 0.0
        with torch.no_grad():
            last_values = agent.value(tensors(observations, infos["action_mask"])[0])
        update(agent, optimizer, rollout, rollout.advantages(last_values, args), args)
        if number % (updates // 10 or 1) == 0 and returns:
            steps, elapsed_s = (number + 1) * args.rollout * args.num_envs, time.perf_counter() - start
            print(f"step {steps:>8}  return of the last 200 episodes {np.mean(returns[-200:]):6.2f}  {elapsed_s:5.0f} s", flush=True)
    return agent


def most_likely(agent: Agent) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The policy that takes the most probable action."""

    def act(observations: np.ndarray, masks: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return agent.distribution(*tensors(observations, masks)).logits.argmax(1).numpy()

    return act


def evaluate(name: str, act: Callable[[np.ndarray, np.ndarray], np.ndarray], args: Args) -> None:
    """Drives one episode of each seed of evaluation; prints means with 95 % intervals (collisions: Wilson's)."""
    envs = lanecraft.VectorEnv(args.episodes, preset=args.preset, autoreset_mode="SameStep")
    observations, infos = envs.reset(seed=EVALUATION_SEED)
    returns, running, collided, speeds_mps = np.zeros(args.episodes), np.ones(args.episodes, bool), 0, []
    while running.any():
        speeds_mps += infos["speed_mps"][running].tolist()
        observations, rewards, terminated, truncated, infos = envs.step(act(observations, infos["action_mask"].astype(bool)))
        returns[running] += rewards[running]
        collided += int((running & terminated).sum())
        running &= ~(terminated | truncated)
    half = 1.96 * returns.std(ddof=1) / math.sqrt(args.episodes)
    low, high = wilson(collided, args.episodes)
    print(
        f"{name:<8} return {returns.mean():6.2f} ± {half:.2f}   collisions {100 * collided / args.episodes:5.1f} % "
        f"[{100 * low:.1f}, {100 * high:.1f}]   speed {np.mean(speeds_mps):5.2f} m/s",
        flush=True,
    )


def wilson(hits: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    share, weight = hits / trials, z * z / trials
    center = (share + weight / 2.0) / (1.0 + weight)
    half = z * math.sqrt(share * (1.0 - share) / trials + weight / (4.0 * trials)) / (1.0 + weight)
    return max(center - half, 0.0), min(center + half, 1.0)


def parsed() -> Args:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for field in dataclasses.fields(Args):
        parser.add_argument(f"--{field.name.replace('_', '-')}", type=type(field.default), default=field.default)
    return Args(**vars(parser.parse_args()))


def main() -> None:
    args = parsed()
    agent = train(args)
    rng = np.random.default_rng(0)
    names = lanecraft.Env(preset=args.preset).action_names
    hold = next(index for index, name in enumerate(names) if "IDLE" in name or "hold" in name)
    evaluate("random", lambda _, masks: np.where(masks, rng.random(masks.shape), -1.0).argmax(1), args)
    evaluate("hold", lambda _, masks: np.full(len(masks), hold), args)
    evaluate("learned", most_likely(agent), args)


if __name__ == "__main__":
    main()
