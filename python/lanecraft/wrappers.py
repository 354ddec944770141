"""Wrappers for :class:`lanecraft.Env`."""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium import spaces


class DecisionPoints(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Steps until there is something to decide: a lane change, which lasts several ticks, becomes one step.

    Rewards are summed, each tick discounted by ``discount`` against the one before; ``info["ticks"]`` says how many there were. The
    actions are those of the environment without *continue* and *abort*.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], discount: float = 1.0) -> None:
        if not 0.0 <= discount <= 1.0:
            raise ValueError(f"a discount is in 0..=1, not {discount}")
        super().__init__(env)
        if not isinstance(env.action_space, spaces.Discrete):
            raise TypeError("only the seat that decides has decision points")
        self.discount = discount
        self._continue = int(env.action_space.n) - 2
        self.action_space = spaces.Discrete(self._continue)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        total, weight, ticks = float(reward), self.discount, 1
        while not (terminated or truncated or info["decision_due"]):
            observation, reward, terminated, truncated, info = self.env.step(self._continue)
            total += weight * float(reward)
            weight *= self.discount
            ticks += 1
        return observation, total, terminated, truncated, self._own(info) | {"ticks": ticks}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, self._own(info) | {"ticks": 0}

    def action_masks(self) -> Any:
        """Which decisions are allowed now, as booleans."""
        return self.env.get_wrapper_attr("action_masks")()[: self._continue]

    def _own(self, info: dict[str, Any]) -> dict[str, Any]:
        return info | {"action_mask": info["action_mask"][: self._continue]}
