"""Policies that need no Python: rules, and networks that were trained by ``lanecraft train``.

>>> import lanecraft
>>> env = lanecraft.Env()
>>> observation, info = env.reset(seed=1)
>>> rule = lanecraft.policies.load("rule:best-lane")
>>> rule.act(env) in range(env.action_space.n)
True
"""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _tasks
from ._lanecraft import EnvCore, PolicyCore
from .errors import ActionError

__all__ = ["Policy", "load"]

#: Folders of runs that come with the package.
_SHIPPED = Path(__file__).parent / "models"


class Policy(PolicyCore):
    """A rule or a trained network; see :func:`load`.

    Attributes:
        name: what results are printed under, ``rule:…`` or the name of the run's folder.
        observation_shape: shape of an observation, or ``None`` for a rule.
        actions: number of actions that a network chooses among, without *continue* and *abort*; ``None`` for a rule.
    """

    def act(self, env: Any) -> int:
        """The action in the present tick of a :class:`lanecraft.Env` (or of a wrapper around one), as in an evaluation."""
        core = getattr(env, "unwrapped", env)
        if not isinstance(core, EnvCore):
            raise TypeError(f"a policy acts in a lanecraft.Env, not in {type(env).__name__}")
        return self._act(core)

    def predict(self, observation: ArrayLike, action_mask: ArrayLike | None = None) -> Any:
        """The vote of a network's heads, for one observation or for many.

        Args:
            observation: of shape ``observation_shape``, or with one axis more in front.
            action_mask: as in ``info["action_mask"]``, of shape (actions,) or (actions + 2,), with the same axis in front; where it
                allows *continue*, a lane change is under way and goes on. Without, all decisions are allowed.

        Returns:
            The action, or an array of shape (observations,).

        Raises:
            TypeError: the policy is a rule, which needs the environment.
            ActionError: shapes that do not fit, numbers that are not finite, or a mask that allows nothing.
        """
        rows, many = self._rows(observation)
        masks = _masks(action_mask, rows.shape[:many], self.actions or 0)
        chosen = self._predict(rows, masks)
        return chosen if many else int(chosen[0])

    def q_heads(self, observation: ArrayLike) -> NDArray[np.float32]:
        """How every head of a network values every action, in units of scaled reward: where the heads differ, the network is unsure.

        Args:
            observation: of shape ``observation_shape``, or with one axis more in front.

        Returns:
            Of shape (heads, actions), or (observations, heads, actions).

        Raises:
            TypeError: the policy is a rule.
            ActionError: shapes that do not fit, or numbers that are not finite.
        """
        rows, many = self._rows(observation)
        values = self._q_heads(rows)
        return values if many else values[0]

    def _rows(self, observation: ArrayLike) -> tuple[NDArray[np.float32], bool]:
        """Observations one a row, and whether there is an axis for many."""
        shape = self.observation_shape
        if shape is None:
            raise TypeError(f"{self.name} needs the environment: use `act`")
        with np.errstate(over="ignore"):  # what does not fit is refused with what is not finite
            observations = _tasks.checked_reals("observation", observation).astype(np.float32)
        many = observations.ndim == len(shape) + 1
        if observations.shape[many:] != tuple(shape):
            raise ActionError(f"observations have shape {observations.shape}, but must have {tuple(shape)}, or one axis more in front")
        return np.ascontiguousarray(observations.reshape(-1, int(np.prod(shape)))), many

    def __repr__(self) -> str:
        return f"Policy({self.name!r})"


def load(name: str | PathLike[str]) -> Policy:
    """The policy of this name.

    Args:
        name: ``"rule:keep-lane"``, ``"rule:random"``, ``"rule:idm-mobil"``, ``"rule:best-lane"``, the folder of a finished run, or
            ``"highway"``, a trained driver for the default preset that comes with the package.

    Raises:
        ConfigError: there is no such rule, or the folder holds no finished run.
    """
    path = fspath(name)
    shipped = {folder.name: folder for folder in _SHIPPED.iterdir()}
    if path in shipped and not Path(path).exists():
        path = str(shipped[path])
    return Policy(path)


def _masks(masks: ArrayLike | None, batch: tuple[int, ...], actions: int) -> NDArray[np.bool_]:
    rows = int(np.prod(batch))
    if masks is None:
        return np.ones((rows, actions), dtype=bool)
    array = np.asarray(masks)
    if array.dtype.kind not in "biu":
        raise TypeError(f"action_mask is of booleans or whole numbers, not of {array.dtype}")
    if array.shape not in [(*batch, actions), (*batch, actions + 2)]:
        raise ActionError(f"action_mask has shape {array.shape}, but must have {(*batch, actions)} or {(*batch, actions + 2)}")
    return np.ascontiguousarray(array.astype(bool).reshape(rows, -1))
