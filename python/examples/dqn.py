"""Double DQN on the fast environment, in one file.

    pip install torch
    python examples/dqn.py                       # learns, then drives 500 unseen episodes beside two rules
    python examples/dqn.py --seed 2 --steps 300000
    python examples/dqn.py --preset default      # the whole loop: planner, controllers, shield

Actions that the mask forbids are neither taken nor bootstrapped from. A truncated episode goes on unseen, so that only a collision stops
bootstrapping.
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

import lanecraft

#: Episodes of evaluation begin at this seed, far from those of training.
EVALUATION_SEED = 1_000_000


@dataclasses.dataclass
class Args:
    """What can be set on the command line."""

    preset: str = "fast"
    seed: int = 1
    steps: int = 120_000
    num_envs: int = 32
    discount: float = 0.9
    learning_rate: float = 1e-3
    batch: int = 256
    replay: int = 100_000
    #: Steps of all environments together before learning begins.
    warm_up: int = 3_200
    #: Updates from one copy of the target network to the next.
    target_period: int = 500
    #: Share of the steps over which the share of random actions falls from 1 to its last value.
    exploration: float = 0.5
    last_random: float = 0.02
    #: Updates for each step of all environments.
    updates: int = 4
    episodes: int = 500


class Replay:
    """A ring of transitions."""

    def __init__(self, capacity: int, observation: int, actions: int) -> None:
        self.observations = np.zeros((capacity, observation), np.float32)
        self.actions = np.zeros(capacity, np.int64)
        self.rewards = np.zeros(capacity, np.float32)
        self.next_observations = np.zeros((capacity, observation), np.float32)
        self.next_masks = np.ones((capacity, actions), bool)
        self.terminated = np.zeros(capacity, np.float32)
        self.added = 0

    def add(self, *columns: np.ndarray) -> None:
        rows = (self.added + np.arange(len(columns[0]))) % len(self.rewards)
        for own, new in zip(self._columns(), columns, strict=True):
            own[rows] = new
        self.added += len(rows)

    def sample(self, rng: np.random.Generator, batch: int) -> list[torch.Tensor]:
        rows = rng.integers(min(self.added, len(self.rewards)), size=batch)
        return [torch.from_numpy(own[rows]) for own in self._columns()]

    def _columns(self) -> list[np.ndarray]:
        return [self.observations, self.actions, self.rewards, self.next_observations, self.next_masks, self.terminated]


def network(observation: int, actions: int) -> nn.Module:
    return nn.Sequential(
        nn.Linear(observation, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, actions)
    )


def greedy(net: nn.Module) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The policy that takes the best action that is allowed."""

    def act(observations: np.ndarray, masks: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            values = net(torch.from_numpy(observations.reshape(len(observations), -1))).numpy()
        return np.where(masks, values, -np.inf).argmax(1)

    return act


def loss(net: nn.Module, target: nn.Module, batch: list[torch.Tensor], discount: float) -> torch.Tensor:
    observations, actions, rewards, next_observations, next_masks, terminated = batch
    with torch.no_grad():
        best = net(next_observations).masked_fill(~next_masks, -torch.inf).argmax(1, keepdim=True)
        goal = rewards + discount * (1.0 - terminated) * target(next_observations).gather(1, best).squeeze(1)
    return nn.functional.smooth_l1_loss(net(observations).gather(1, actions[:, None]).squeeze(1), goal)


def train(args: Args) -> nn.Module:
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)  # networks so small lose by more
    rng = np.random.default_rng(args.seed)
    envs = lanecraft.VectorEnv(args.num_envs, preset=args.preset, autoreset_mode="SameStep")
    observations, infos = envs.reset(seed=args.seed)
    size, actions = observations[0].size, infos["action_mask"].shape[1]
    net, target = network(size, actions), network(size, actions)
    target.load_state_dict(net.state_dict())
    optimizer = torch.optim.Adam(net.parameters(), args.learning_rate)
    replay, act, updates = Replay(args.replay, size, actions), greedy(net), 0
    returns, running, start = [], np.zeros(args.num_envs), time.perf_counter()

    for step in range(0, args.steps, args.num_envs):
        masks = infos["action_mask"].astype(bool)
        share = max(args.last_random, 1.0 - (1.0 - args.last_random) * step / (args.exploration * args.steps))
        random = np.where(masks, rng.random(masks.shape), -1.0).argmax(1)
        chosen = np.where(rng.random(args.num_envs) < share, random, act(observations, masks))
        next_observations, rewards, terminated, truncated, infos = envs.step(chosen)

        ends = terminated | truncated
        last, next_masks = next_observations.copy(), infos["action_mask"].astype(bool)
        if ends.any():
            last[ends] = infos["final_obs"][ends]
            next_masks[ends] = True
        rows = observations.reshape(args.num_envs, -1), chosen, rewards, last.reshape(args.num_envs, -1), next_masks, terminated
        replay.add(*rows)
        observations = next_observations
        running += rewards
        returns += running[ends].tolist()
        running[ends] = 0.0

        optimizer.param_groups[0]["lr"] = args.learning_rate * (1.0 - step / args.steps)
        for _ in range(args.updates if replay.added >= args.warm_up else 0):
            optimizer.zero_grad()
            loss(net, target, replay.sample(rng, args.batch), args.discount).backward()
            nn.utils.clip_grad_norm_(net.parameters(), 10.0)
            optimizer.step()
            updates += 1
            if updates % args.target_period == 0:
                target.load_state_dict(net.state_dict())
        if step // args.num_envs % (args.steps // args.num_envs // 10 or 1) == 0 and returns:
            elapsed_s = time.perf_counter() - start
            print(f"step {step:>8}  return of the last 200 episodes {np.mean(returns[-200:]):6.2f}  {elapsed_s:5.0f} s", flush=True)
    return net


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
    net = train(args)
    rng = np.random.default_rng(0)
    names = lanecraft.Env(preset=args.preset).action_names
    hold = next(index for index, name in enumerate(names) if "IDLE" in name or "hold" in name)
    evaluate("random", lambda _, masks: np.where(masks, rng.random(masks.shape), -1.0).argmax(1), args)
    evaluate("hold", lambda _, masks: np.full(len(masks), hold), args)
    evaluate("learned", greedy(net), args)


if __name__ == "__main__":
    main()
