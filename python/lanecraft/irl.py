"""Maximum-entropy inverse reinforcement learning over finite sets of candidates (Eqs. 20–24), alone.

A driver chose one of several candidates, each described by F features. With the reward w'h the probability of a candidate is
exp(w'h) / Σ exp(w'h_j); :func:`fit` finds the weights w that make the choices most likely. Features that are avoided get negative weights.

Example:
    >>> import numpy as np
    >>> from lanecraft import irl
    >>> rng = np.random.default_rng(0)
    >>> features = rng.normal(size=(500, 8, 3))                          # events × candidates × features
    >>> chosen = np.argmax(features @ [1.0, -2.0, 0.5] + rng.gumbel(size=(500, 8)), axis=1)
    >>> irl.fit(irl.Choices.from_arrays(features, chosen)).weights.round(1).tolist()
    [0.9, -2.0, 0.5]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from ._arrays import Floats
from ._lanecraft import IrlCore
from .errors import ConfigError

__all__ = ["Choices", "Fit", "Judgment", "fit", "leave_one_group_out"]

MAX_FEATURES = 1000


@dataclass(frozen=True, eq=False)
class Choices:
    """E events with their candidates, one below the other, C of them in all. Made by :meth:`from_arrays`, :meth:`from_lists` or
    :meth:`from_frame`.

    Args:
        features: shape (C, F).
        counts: number of candidates of each event, shape (E,).
        chosen: index of the chosen candidate within each event, shape (E,).
        groups: what each event shares with others (a driver, a site), shape (E,); ``None`` if nothing is known.
        names: names of the features, F of them.
    """

    features: Floats
    counts: NDArray[np.int64]
    chosen: NDArray[np.int64]
    groups: NDArray[Any] | None
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        features = np.ascontiguousarray(_arrays.numbers("features", self.features))
        if features.ndim != 2 or not 1 <= features.shape[1] <= MAX_FEATURES:
            raise ConfigError(f"`features` has shape {features.shape}, but must have (candidates, 1 to {MAX_FEATURES} features)")
        counts = _arrays.indices("counts", self.counts, int(np.size(np.asarray(self.counts))))
        chosen = _arrays.indices("chosen", self.chosen, len(counts))
        if len(counts) == 0 or (counts < 1).any() or int(counts.sum()) != len(features):
            raise ConfigError(f"there must be events with candidates each, {len(features)} in all")
        if (chosen < 0).any() or (chosen >= counts).any():
            event = int(np.flatnonzero((chosen < 0) | (chosen >= counts))[0])
            raise ConfigError(f"event {event} chose candidate {chosen[event]}, but has {counts[event]}")
        groups = None if self.groups is None else np.asarray(self.groups)
        if groups is not None and groups.shape != counts.shape:
            raise ConfigError(f"`groups` has shape {groups.shape}, but must have {counts.shape}")
        names = tuple(str(name) for name in self.names)
        if len(names) != features.shape[1]:
            raise ConfigError(f"there are {len(names)} names for {features.shape[1]} features")
        for key, value in [("features", features), ("counts", counts), ("chosen", chosen), ("groups", groups), ("names", names)]:
            object.__setattr__(self, key, value)

    def __len__(self) -> int:
        return len(self.counts)

    @classmethod
    def from_arrays(
        cls, features: ArrayLike, chosen: ArrayLike, *, groups: ArrayLike | None = None, names: Sequence[str] | None = None
    ) -> Choices:
        """Events with the same number of candidates each.

        Args:
            features: shape (events, candidates, features).
            chosen: index of the chosen candidate of each event, shape (events,).
            groups: a label for each event, shape (events,).
            names: names of the features; ``"0"``, ``"1"``, … by default.
        """
        found = _arrays.numbers("features", features)
        if found.ndim != 3 or 0 in found.shape:
            raise ConfigError(f"`features` has shape {found.shape}, but must have (events, candidates, features)")
        events, candidates, width = found.shape
        counts = np.full(events, candidates, dtype=np.int64)
        return cls(found.reshape(-1, width), counts, _exactly(chosen, events), _labels(groups), _names(names, width))

    @classmethod
    def from_lists(
        cls,
        features: Sequence[ArrayLike],
        chosen: ArrayLike,
        *,
        groups: ArrayLike | None = None,
        names: Sequence[str] | None = None,
    ) -> Choices:
        """Events with different numbers of candidates.

        Args:
            features: for each event an array of shape (its candidates, features).
            chosen: as in :meth:`from_arrays`.
            groups: as in :meth:`from_arrays`.
            names: as in :meth:`from_arrays`.
        """
        if isinstance(features, (str, bytes, Mapping)) or not hasattr(features, "__len__") or not hasattr(features, "__iter__"):
            raise TypeError(f"`features` is a list of arrays, not {type(features).__name__}")
        found = [_arrays.numbers(f"features[{event}]", rows) for event, rows in enumerate(features)]
        if not found:
            raise ConfigError("there are no events")
        width = found[0].shape[-1] if found[0].ndim == 2 else 0
        for event, rows in enumerate(found):
            if rows.ndim != 2 or 0 in rows.shape or rows.shape[1] != width:
                raise ConfigError(f"`features[{event}]` has shape {rows.shape}, but must have (candidates, {width or 'features'})")
        counts = np.array([len(rows) for rows in found], dtype=np.int64)
        return cls(np.concatenate(found), counts, _exactly(chosen, len(found)), _labels(groups), _names(names, width))

    @classmethod
    def from_frame(
        cls, frame: Any, *, features: Sequence[str], event: str = "event", chosen: str = "chosen", group: str | None = None
    ) -> Choices:
        """A data frame with one row for each candidate; the rows of an event need not stand together.

        Args:
            frame: a ``pandas.DataFrame``.
            features: the columns that are features.
            event: the column that says to which event a candidate belongs.
            chosen: the column that is true (or 1) at the one candidate of each event that was chosen.
            group: the column of groups, the same at all candidates of an event.
        """
        import pandas  # pyright: ignore[reportMissingImports]

        if not isinstance(frame, pandas.DataFrame):
            raise TypeError(f"`frame` is a pandas.DataFrame, not {type(frame).__name__}")
        names = [features] if isinstance(features, str) else list(features)
        missing = [name for name in [*names, event, chosen, *([] if group is None else [group])] if name not in frame.columns]
        if missing:
            raise ConfigError(f"there is no column `{missing[0]}`; there are {', '.join(map(str, frame.columns))}")
        codes, labels = pandas.factorize(frame[event])
        if len(frame) == 0 or (codes < 0).any():
            raise ConfigError(f"column `{event}` is empty or has empty places")
        order = np.argsort(codes, kind="stable")
        counts = np.bincount(codes, minlength=len(labels))
        starts = np.cumsum(counts) - counts
        flags = _arrays.numbers(chosen, frame[chosen].to_numpy()[order]) == 1.0
        if not (np.add.reduceat(flags.astype(np.int64), starts) == 1).all():
            raise ConfigError(f"column `{chosen}` must be true at exactly one candidate of each event")
        groups = None
        if group is not None:
            rows = frame[group].to_numpy()[order]
            groups = rows[starts]
            if not (rows == np.repeat(groups, counts)).all():
                raise ConfigError(f"column `{group}` must be the same at all candidates of an event")
        values = _arrays.numbers("features", frame[names].to_numpy()[order])
        return cls(values, counts, np.flatnonzero(flags) - starts, groups, tuple(names))

    def subset(self, events: ArrayLike) -> Choices:
        """The events at which ``events``, shape (E,) of booleans, is true."""
        keep = np.asarray(events)
        if keep.dtype != np.bool_ or keep.shape != self.counts.shape:
            raise ConfigError(f"`events` must be booleans of shape {self.counts.shape}")
        rows = np.repeat(keep, self.counts)
        groups = None if self.groups is None else self.groups[keep]
        return Choices(self.features[rows], self.counts[keep], self.chosen[keep], groups, self.names)

    @property
    def starts(self) -> NDArray[np.int64]:
        """Index of each event's first candidate, shape (E,)."""
        return np.cumsum(self.counts) - self.counts


@dataclass(frozen=True, eq=False)
class Fit:
    """Weights that explain choices."""

    names: tuple[str, ...]
    """Names of the features."""
    weights: Floats
    """Weights of the features as they came, shape (F,); 0 for a feature that never varies."""
    normalized_weights: Floats
    """Weights of the normalized features, comparable with each other, shape (F,)."""
    means: Floats
    """Mean of each feature over all candidates, shape (F,)."""
    scales: Floats
    """What each feature was divided by, shape (F,); 0 for a feature that never varies."""
    log_likelihood_per_event: float
    """Mean log-likelihood of the choices, without the penalty."""
    uniform_log_likelihood_per_event: float
    """The same of choices at random."""
    gradient_norm: float
    """Norm of the objective's gradient in normalized weights for each event."""
    iterations: int
    """Iterations made."""
    converged: bool
    """Whether the weights maximize the objective."""

    def rewards(self, choices: Choices) -> Floats:
        """w'h of each candidate, shape (C,)."""
        if not isinstance(choices, Choices):
            raise TypeError(f"`choices` are lanecraft.irl.Choices, not {type(choices).__name__}")
        if choices.names != self.names:
            raise ConfigError(f"the features are {choices.names}, but the fit was made with {self.names}")
        return choices.features @ self.weights

    def log_probabilities(self, choices: Choices) -> Floats:
        """Log-probability of each candidate within its event, shape (C,)."""
        rewards = self.rewards(choices)
        return rewards - np.repeat(np.logaddexp.reduceat(rewards, choices.starts), choices.counts)

    def log_likelihoods(self, choices: Choices) -> Floats:
        """Log-probability of what was chosen at each event, shape (E,)."""
        return self.log_probabilities(choices)[choices.starts + choices.chosen]

    def best(self, choices: Choices) -> NDArray[np.int64]:
        """Index of the most probable candidate of each event, the first of equal ones, shape (E,)."""
        parts = np.split(self.rewards(choices), choices.starts[1:])
        return np.array([int(np.argmax(part)) for part in parts], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Judgment:
    """How well rewards predict drivers that were not in their training."""

    groups: NDArray[Any]
    """The groups, sorted, shape (G,)."""
    fits: tuple[Fit, ...]
    """For each group, the fit to all others."""
    log_likelihoods: Floats
    """Log-probability of each event's choice under the fit without its group, shape (E,)."""
    uniform_log_likelihoods: Floats
    """The same of choices at random, shape (E,)."""
    hits: NDArray[np.bool_]
    """Whether the most probable candidate was chosen, shape (E,)."""

    @property
    def log_likelihood_per_event(self) -> float:
        """Mean of :attr:`log_likelihoods`."""
        return float(self.log_likelihoods.mean())


def fit(choices: Choices, options: Mapping[str, Any] | None = None, *, preset: str = "default") -> Fit:
    """The weights under which the choices are most likely.

    Args:
        choices: the events.
        options: your own numbers laid over the preset's section ``irl``: ``ridge``, ``method`` (``"newton"``, ``"gradient-ascent"``),
            ``normalization`` (``"z-score"``, ``"mean"``), ``max_iterations``, ``gradient_tolerance``, ``learning_rate``, ``episodes``.
        preset: ``"default"`` or ``"paper"``.

    Raises:
        ConfigError: an option that does not exist or is out of range, features beyond ±1e100, or a fit that diverged.
    """
    if not isinstance(choices, Choices):
        raise TypeError(f"`choices` are lanecraft.irl.Choices, not {type(choices).__name__}")
    return _fit(IrlCore(_arrays.text("preset", preset), _arrays.settings(options, "options")), choices)


def leave_one_group_out(choices: Choices, options: Mapping[str, Any] | None = None, *, preset: str = "default") -> Judgment:
    """Judges fits on drivers they have not seen: each group in turn is left out of the fit and predicted by it.

    Args:
        choices: the events, with at least two groups.
        options: as for :func:`fit`.
        preset: ``"default"`` or ``"paper"``.
    """
    if not isinstance(choices, Choices):
        raise TypeError(f"`choices` are lanecraft.irl.Choices, not {type(choices).__name__}")
    core = IrlCore(_arrays.text("preset", preset), _arrays.settings(options, "options"))
    groups = np.unique(choices.groups) if choices.groups is not None else np.empty(0)
    if choices.groups is None or len(groups) < 2:
        raise ConfigError(f"to leave one group out there must be at least two, not {len(groups)}")
    fits = []
    likelihoods, hits = np.empty(len(choices)), np.empty(len(choices), dtype=np.bool_)
    for group in groups:
        tested = choices.groups == group
        fits.append(_fit(core, choices.subset(~tested)))
        unseen = choices.subset(tested)
        likelihoods[tested] = fits[-1].log_likelihoods(unseen)
        hits[tested] = fits[-1].best(unseen) == unseen.chosen
    return Judgment(groups, tuple(fits), likelihoods, -np.log(choices.counts), hits)


def _fit(core: IrlCore, choices: Choices) -> Fit:
    normalized, weights, (likelihood, uniform), gradient, iterations, converged = core.fit(
        choices.features, choices.counts, choices.chosen
    )
    raw, comparable = np.array(weights), np.array(normalized)
    scales = np.divide(comparable, raw, out=np.zeros_like(raw), where=raw != 0.0)
    means = choices.features.mean(axis=0)
    return Fit(choices.names, raw, comparable, means, scales, likelihood, uniform, gradient, iterations, converged)


def _exactly(chosen: ArrayLike, events: int) -> NDArray[np.int64]:
    if np.shape(np.asarray(chosen)) != (events,):
        raise ConfigError(f"`chosen` has shape {np.shape(np.asarray(chosen))}, but must have ({events},)")
    return _arrays.indices("chosen", chosen, events)


def _labels(groups: ArrayLike | None) -> NDArray[Any] | None:
    return None if groups is None else np.asarray(groups)


def _names(names: Sequence[str] | None, width: int) -> tuple[str, ...]:
    if isinstance(names, str):
        raise TypeError("`names` is a list of strings, not one string")
    return tuple(str(feature) for feature in range(width)) if names is None else tuple(names)
