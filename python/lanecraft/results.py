"""Paired evaluation: every policy drives the same scenarios, and every figure comes with its interval."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from importlib import import_module
from os import PathLike
from typing import Any, NamedTuple

from . import _arrays, _lanecraft, _tasks
from ._lanecraft import PolicyCore, ResultsCore
from .errors import ConfigError
from .policies import load

__all__ = ["Comparison", "Results", "evaluate"]

#: Decides from an observation and what is known beside it.
OwnPolicy = Callable[[Any, dict[str, Any]], Any]
#: A policy, what :func:`lanecraft.policies.load` makes one of, or your own.
AnyPolicy = PolicyCore | str | PathLike[str] | OwnPolicy


class Comparison(NamedTuple):
    """How a policy's reward per tick compares with another's, scenario by scenario."""

    policy: str
    other: str
    #: Its lead, and the 95 % interval of it.
    mean: float
    low: float
    high: float
    #: The same in words.
    text: str

    @property
    def beats(self) -> bool:
        """Whether the whole interval lies above zero."""
        return self.low > 0.0


class Results:
    """What an evaluation found; printed, it is the table of ``lanecraft evaluate``."""

    def __init__(self, core: ResultsCore) -> None:
        self._core = core

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """The figures of each policy, as ``lanecraft evaluate --json`` prints them, to the bit: every metric is a dictionary of ``mean``,
        ``low`` and ``high``, the 95 % interval. ``docs/metrics.md`` explains them."""
        return [json.loads(row) for row in self._core.rows()]

    @cached_property
    def episodes(self) -> list[dict[str, Any]]:
        """The figures of each episode, policy by policy, with its ``scenario_seed``."""
        episodes = [json.loads(episode) for episode in self._core.episodes()]
        return [episode | {"guard_causes": json.loads(episode["guard_causes"])} for episode in episodes]

    def compare(self) -> list[Comparison]:
        """The first policy against each of the others, by the paired differences of their rewards per tick."""
        return [Comparison(policy, other, *lead, text) for policy, other, lead, text in self._core.comparisons()]

    def to_pandas(self, *, episodes: bool = False) -> Any:
        """A data frame with a row for each policy, where a metric has the columns ``x``, ``x_low`` and ``x_high``, or for each episode.

        Raises:
            ImportError: pandas is not installed; it comes with ``pip install lanecraft[frames]``.
        """
        try:
            pandas = import_module("pandas")
        except ImportError as error:
            raise ImportError("to_pandas needs pandas: pip install 'lanecraft[frames]'") from error
        if episodes:
            return pandas.DataFrame(self.episodes)
        return pandas.DataFrame([_flat(row) for row in self.rows])

    def __repr__(self) -> str:
        return "\n".join([self._core.table(), *(comparison.text for comparison in self.compare())])


def _flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if not isinstance(value, dict):
            flat[prefix + name] = value
        elif value.keys() == {"mean", "low", "high"}:
            flat |= {prefix + name: value["mean"], f"{prefix}{name}_low": value["low"], f"{prefix}{name}_high": value["high"]}
        else:
            flat |= _flat(value, f"{prefix}{name}.")
    return flat


def evaluate(
    policies: AnyPolicy | Iterable[AnyPolicy] | Mapping[str, AnyPolicy],
    *,
    preset: str = "default",
    config: Mapping[str, Any] | None = None,
    scenario: str | PathLike[str] | None = None,
    episodes: int | None = None,
    seed: int | None = None,
    masked_actions: str = "replace",
    threads: int = 0,
) -> Results:
    """Drives each policy through the same test scenarios, which no training sees.

    Rules and trained networks run outside of Python's lock on all threads. Your own policy is called in the calling thread, one scenario
    after the other, wherever a decision is due (lane changes under way go on by themselves), with the observation and an info of
    ``action_mask``, ``scenario_seed``, ``tick`` (0 begins an episode), ``time_s``, ``speed_mps``, ``d_m``, ``lane`` and ``driven_m``.
    What it raises comes out of here as it is.

    Args:
        policies: one or more of: a name or folder for :func:`lanecraft.policies.load`, a policy that it made, or any callable
            ``(observation, info) -> action``. A mapping gives names to callables; else their ``__name__`` is taken, or their type's.
        preset, config, scenario: as for :class:`lanecraft.Env`. Trained policies drive in the environment of their run with ``config``
            and ``scenario`` laid over it; the others then drive in that of the first run.
        episodes: number of scenarios, at least 2; 200 without. Their length is ``config={"evaluation.episode_s": ...}``.
        seed: which series of test scenarios; 0 without.
        masked_actions: what becomes of your policy's action that is forbidden, as for :class:`lanecraft.Env`.
        threads: how many threads drive; 0 is one for each processor. The results are the same for any number.

    Raises:
        ConfigError: a name, key or value that does not exist or is out of range, or runs whose scenarios differ.
        ActionError: an action that does not exist, or is forbidden with ``masked_actions="raise"``.

    >>> import lanecraft
    >>> results = lanecraft.evaluate(["rule:best-lane", "rule:keep-lane"], episodes=2, config={"evaluation.episode_s": 5})
    >>> [row["policy"] for row in results.rows]
    ['rule:best-lane', 'rule:keep-lane']
    """
    overlay, scenario = _tasks.checked_scene(config, scenario)
    for key, value in [("evaluation.episodes", episodes), ("evaluation.seed", seed)]:
        if value is not None:
            overlay[key] = _arrays.whole(key, value, 0, 2**63 - 1)
    threads = _arrays.whole("threads", threads, 0, 1024)
    named = _named(policies)
    if not named:
        raise ConfigError("there is no policy to evaluate")
    return Results(_lanecraft.evaluate(named, (preset, overlay, scenario), masked_actions, threads))


def _named(policies: Any) -> list[tuple[str, Any]]:
    if isinstance(policies, Mapping):
        return [(name, _policy(policy)) for name, policy in policies.items()]
    if isinstance(policies, str | PathLike | PolicyCore) or callable(policies):
        policies = [policies]
    return [(getattr(policy, "__name__", type(policy).__name__), _policy(policy)) for policy in policies]


def _policy(policy: Any) -> Any:
    if isinstance(policy, str | PathLike):
        return load(policy)
    if isinstance(policy, PolicyCore) or callable(policy):
        return policy
    raise TypeError(f"a policy is a name, a path, a loaded policy or callable, not {type(policy).__name__}")
