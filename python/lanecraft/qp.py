"""Quadratic programs of optimal control with one input and soft constraints: the solver behind the controllers, alone.

    minimize    Σ_k ½ (x_{k+1} − xr_{k+1})' Q_{k+1} (x_{k+1} − xr_{k+1}) + ½ R_k (u_k − ur_k)²
                + ½ (x_N − xr_N)' T (x_N − xr_N) + Σ slack costs
    subject to  x_{k+1} = A_k x_k + B_k u_k + c_k,   input_min ≤ u_k ≤ input_max,
                lower − s ≤ row_state x_k + row_input u_k ≤ upper + s,   s ≥ 0 at the cost l1 s + ½ l2 s²

over the horizon k = 0 … N−1, with Q diagonal. The numbers carry your own units. Every problem is feasible, and its optimum unique.

Example:
    >>> from lanecraft import qp
    >>> problem = qp.Problem.make(10, initial_state=[1.0], a=[[1.0]], b=[1.0], state_weight=[1.0], input_min=-0.3, input_max=0.3)
    >>> solution = qp.Solver().solve(problem)
    >>> solution.status, float(solution.inputs[0])
    ('solved', -0.3)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays
from ._arrays import Floats
from ._lanecraft import QpCore, qp_infinite_horizon_weight, qp_zero_order_hold
from .errors import ConfigError

__all__ = ["ActiveRow", "Problem", "Solution", "Solver", "infinite_horizon_weight", "zero_order_hold"]

MAX_HORIZON = 256
MAX_STATES = 8
MAX_ROWS = 8

_UNBOUNDED = {"input_min", "input_max", "row_lower", "row_upper"}


@dataclass(frozen=True, eq=False)
class Problem:
    """A whole program: N stages, n states, m soft rows a stage. :meth:`make` fills in defaults and spreads what is the same at each stage.

    Args:
        initial_state: x_0, shape (n,).
        a: A_k, shape (N, n, n).
        b: B_k, shape (N, n).
        c: c_k, shape (N, n).
        state_weight: diagonals of Q_{k+1}, shape (N, n), at least 0.
        state_reference: references of x_{k+1}, shape (N, n).
        input_weight: R_k, shape (N,), above 0.
        input_reference: references of u_k, shape (N,).
        input_min: hard lower bound of every input; −inf for none.
        input_max: hard upper bound of every input; inf for none.
        terminal_weight: T, shape (n, n), symmetric, without negative eigenvalues.
        row_state: coefficients of x_k in the rows, shape (N, m, n).
        row_input: coefficients of u_k in the rows, shape (N, m).
        row_lower: lower bounds of the rows, shape (N, m); −inf for none.
        row_upper: upper bounds of the rows, shape (N, m); inf for none.
        row_l1_weight: linear costs of the slacks, shape (N, m), at least 0. A bound is met exactly as long as its multiplier stays below.
        row_l2_weight: quadratic costs of the slacks, shape (N, m), above 0.
    """

    initial_state: Floats
    a: Floats
    b: Floats
    c: Floats
    state_weight: Floats
    state_reference: Floats
    input_weight: Floats
    input_reference: Floats
    input_min: float
    input_max: float
    terminal_weight: Floats
    row_state: Floats
    row_input: Floats
    row_lower: Floats
    row_upper: Floats
    row_l1_weight: Floats
    row_l2_weight: Floats

    @classmethod
    def make(
        cls,
        horizon: int,
        *,
        initial_state: ArrayLike,
        a: ArrayLike,
        b: ArrayLike,
        state_weight: ArrayLike,
        c: ArrayLike = 0.0,
        state_reference: ArrayLike = 0.0,
        input_weight: ArrayLike = 1.0,
        input_reference: ArrayLike = 0.0,
        input_min: float = -np.inf,
        input_max: float = np.inf,
        terminal_weight: ArrayLike = 0.0,
        row_state: ArrayLike | None = None,
        row_input: ArrayLike = 0.0,
        row_lower: ArrayLike = -np.inf,
        row_upper: ArrayLike = np.inf,
        row_l1_weight: ArrayLike = 1.0,
        row_l2_weight: ArrayLike = 1.0,
    ) -> Problem:
        """A problem of ``horizon`` stages (1 to 256); whatever lacks the axis of the stages is the same at all of them.

        Args:
            horizon: N.
            initial_state: x_0; its length is n, 1 to 8.
            row_state: coefficients of x_k, shape (m, n) or (N, m, n), m up to 8; no rows by default.
            others: as in the class; numbers, or arrays that broadcast to the shapes given there.

        Raises:
            ConfigError: a shape that does not fit, NaN, or an infinity where none is allowed.
        """
        steps = _arrays.whole("horizon", horizon, 1, MAX_HORIZON)
        start = _arrays.numbers("initial_state", initial_state)
        if start.ndim != 1 or not 1 <= len(start) <= MAX_STATES:
            raise ConfigError(f"`initial_state` has shape {start.shape}, but must have (n,) with n in 1..={MAX_STATES}")
        n = len(start)
        rows = np.zeros((0, n)) if row_state is None else _arrays.numbers("row_state", row_state)
        if rows.ndim not in (2, 3) or rows.shape[-2] > MAX_ROWS:
            raise ConfigError(f"`row_state` has shape {rows.shape}, but must have (m, n) or (N, m, n) with m in 0..={MAX_ROWS}")
        m = rows.shape[-2]

        given: dict[str, ArrayLike] = {
            "initial_state": start,
            "a": a,
            "b": b,
            "c": c,
            "state_weight": state_weight,
            "state_reference": state_reference,
            "input_weight": input_weight,
            "input_reference": input_reference,
            "terminal_weight": terminal_weight,
            "row_state": rows,
            "row_input": row_input,
            "row_lower": row_lower,
            "row_upper": row_upper,
            "row_l1_weight": row_l1_weight,
            "row_l2_weight": row_l2_weight,
        }
        shapes = _shapes(steps, n, m)
        arrays = {name: _arrays.shaped(name, values, shapes[name], finite=name not in _UNBOUNDED) for name, values in given.items()}
        return cls(**arrays, input_min=input_min, input_max=input_max)

    def __post_init__(self) -> None:
        for name, values in vars(self).items():
            object.__setattr__(self, name, _arrays.numbers(name, values, finite=name not in _UNBOUNDED))
        if self.b.ndim != 2 or self.row_input.ndim != 2:
            raise ConfigError(f"`b` and `row_input` have shapes {self.b.shape} and {self.row_input.shape}, but must have (N, n) and (N, m)")
        for name, shape in _shapes(*self.size).items():
            if getattr(self, name).shape != shape:
                raise ConfigError(f"`{name}` has shape {getattr(self, name).shape}, but must have {shape}")
        for name in ("input_min", "input_max"):
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def size(self) -> tuple[int, int, int]:
        """Horizon N, states n, rows m."""
        return self.b.shape[0], self.b.shape[1], self.row_input.shape[1]

    def states(self, inputs: ArrayLike) -> Floats:
        """x_0 … x_N under these inputs, shape (N + 1, n)."""
        horizon, n, _ = self.size
        u = _arrays.shaped("inputs", inputs, (horizon,))
        states = np.empty((horizon + 1, n))
        states[0] = self.initial_state
        for k in range(horizon):
            states[k + 1] = self.a[k] @ states[k] + self.b[k] * u[k] + self.c[k]
        return states

    def cost(self, inputs: ArrayLike) -> float:
        """The objective under these inputs, slack costs included."""
        u = _arrays.shaped("inputs", inputs, self.size[:1])
        x = self.states(u)
        error = x[1:] - self.state_reference
        values = np.einsum("kmn,kn->km", self.row_state, x[:-1]) + self.row_input * u[:, None]
        slack = np.maximum(0.0, np.maximum(values - self.row_upper, self.row_lower - values))
        return float(
            0.5 * np.sum(self.state_weight * error**2)
            + 0.5 * np.sum(self.input_weight * (u - self.input_reference) ** 2)
            + 0.5 * error[-1] @ self.terminal_weight @ error[-1]
            + np.sum(self.row_l1_weight * slack + 0.5 * self.row_l2_weight * slack**2)
        )


def _shapes(horizon: int, n: int, m: int) -> dict[str, tuple[int, ...]]:
    return {
        "initial_state": (n,),
        "a": (horizon, n, n),
        "b": (horizon, n),
        "c": (horizon, n),
        "state_weight": (horizon, n),
        "state_reference": (horizon, n),
        "input_weight": (horizon,),
        "input_reference": (horizon,),
        "input_min": (),
        "input_max": (),
        "terminal_weight": (n, n),
        "row_state": (horizon, m, n),
        "row_input": (horizon, m),
        "row_lower": (horizon, m),
        "row_upper": (horizon, m),
        "row_l1_weight": (horizon, m),
        "row_l2_weight": (horizon, m),
    }


class ActiveRow(NamedTuple):
    """A constraint that holds the optimum back."""

    stage: int
    """Its stage k."""
    row: int | None
    """Index of the soft row; ``None`` for the bounds of the input."""
    upper: bool
    """Whether it is the upper bound."""
    multiplier: float
    """At least 0: how fast the cost falls as the bound is widened."""
    slack: float
    """By how much the bound is exceeded."""


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solve found."""

    status: str
    """``"solved"``, ``"iteration-limit"`` (also where numbers left the range of float64) or ``"step-limit"``."""
    inputs: Floats
    """u_0 … u_{N−1}: finite and within the input bounds, whatever the status."""
    states: Floats
    """x_0 … x_N under the inputs, shape (N + 1, n)."""
    iterations: int
    """Steps along the dual."""
    slack_max: float
    """Largest violation of a soft row."""
    kkt_residual: float
    """Largest violation of a constraint beyond its slack, relative; the other optimality conditions hold by construction."""
    active: tuple[ActiveRow, ...]
    """The active constraints in the order in which they entered."""
    input_duals: Floats
    """Multipliers of the input bounds, shape (N,): positive at the upper bound, negative at the lower one."""
    row_duals: Floats
    """Multipliers of the rows, shape (N, m), with the same signs."""
    feedback: Floats
    """Slope of u_0 in x_0 while the active set stays as it is, shape (n,)."""

    @property
    def solved(self) -> bool:
        """Whether the optimum was reached."""
        return self.status == "solved"


class Solver:
    """Solves one problem after another, each beginning where the last one ended.

    All memory for a size (horizon, states, rows) is allocated when the first problem of that size comes; a problem of another size starts
    anew. One solver serves one thread at a time; others may run meanwhile.
    """

    def __init__(self) -> None:
        self._core: QpCore | None = None
        self._size: tuple[int, int, int] | None = None

    def solve(self, problem: Problem, *, warm: bool = True, shift: int = 0, step_limit: int | None = None) -> Solution:
        """Solves ``problem``.

        Args:
            problem: what to solve.
            warm: begin with the constraints that were active at the end of the last solve. The optimum is unique: this changes the time
                and the last digits, not the answer.
            shift: by how many stages those constraints have come nearer since then: 1 if a receding horizon moves by a stage a solve.
            step_limit: end after this many steps of the solver, optimal or not; the same everywhere, as no clock is involved.

        Raises:
            ConfigError: a number out of range; the solver then is as after :meth:`reset`.
        """
        if not isinstance(problem, Problem):
            raise TypeError(f"`problem` is a lanecraft.qp.Problem, not {type(problem).__name__}")
        if not isinstance(warm, (bool, np.bool_)):
            raise TypeError(f"`warm` is true or false, not {type(warm).__name__}")
        stages = _arrays.whole("shift", shift, 0, MAX_HORIZON)
        steps = None if step_limit is None else _arrays.whole("step_limit", step_limit, 0, 2**63 - 1)
        core = self._sized(problem.size)
        inputs, states, status, (iterations, slack_max, residual), active, feedback = core.solve(
            problem, stages if warm else None, steps
        )
        rows = tuple(ActiveRow(*row) for row in active)
        horizon, _, m = problem.size
        input_duals, row_duals = np.zeros(horizon), np.zeros((horizon, m))
        for row in rows:
            signed = row.multiplier if row.upper else -row.multiplier
            if row.row is None:
                input_duals[row.stage] = signed
            else:
                row_duals[row.stage, row.row] = signed
        return Solution(status, inputs, states, iterations, slack_max, residual, rows, input_duals, row_duals, feedback)

    def reset(self) -> None:
        """Forgets all earlier solves."""
        if self._core is not None:
            self._core.reset()

    def _sized(self, size: tuple[int, int, int]) -> QpCore:
        if self._core is None or self._size != size:
            self._core, self._size = QpCore(*size), size
        return self._core


def zero_order_hold(a: ArrayLike, b: ArrayLike, dt_s: float) -> tuple[Floats, Floats]:
    """Discrete (Φ, Γ) with x(t + dt) = Φ x(t) + Γ u, for x' = A x + B u under a constant input.

    Args:
        a: A, shape (n, n), 1/s; n up to 8.
        b: B, shape (n,) or (n, m), m up to 8.
        dt_s: the step, s, 0 to 1e6.

    Returns:
        Φ of shape (n, n) and Γ of the shape of ``b``.
    """
    matrix, column = _square("a", a), _arrays.numbers("b", b)
    n = len(matrix)
    if column.ndim not in (1, 2) or column.shape[0] != n or not 1 <= (column.size // n) <= MAX_STATES:
        raise ConfigError(f"`b` has shape {column.shape}, but must have ({n},) or ({n}, m) with m in 1..={MAX_STATES}")
    transition, gain = qp_zero_order_hold(matrix, column.reshape(n, -1), _arrays.number("dt_s", dt_s, 0.0, 1e6))
    if not (np.isfinite(transition).all() and np.isfinite(gain).all()):
        raise ConfigError("the step of this system is beyond the range of float64; take a smaller `dt_s`")
    return transition, gain.reshape(column.shape)


def infinite_horizon_weight(a: ArrayLike, b: ArrayLike, state_weight: ArrayLike, input_weight: float) -> Floats:
    """The terminal weight with which a problem costs what it would cost on an infinite horizon, as long as no constraint is active there.

    It is P − Q, where P solves the discrete algebraic Riccati equation.

    Args:
        a: A, shape (n, n), n up to 8.
        b: B, shape (n,).
        state_weight: diagonal of Q, shape (n,), at least 0.
        input_weight: R, above 0.

    Raises:
        ConfigError: there is none, since a state that costs neither decays nor can be moved by the input.
    """
    matrix = _square("a", a)
    n = len(matrix)
    column, weights = _arrays.shaped("b", b, (n,)), _arrays.bounded("state_weight", state_weight, (n,), 0.0, 1e300)
    found = qp_infinite_horizon_weight(matrix, column, weights, _arrays.number("input_weight", input_weight, 1e-300, 1e300))
    if found is None:
        raise ConfigError("there is no such weight: a state that costs neither decays nor can be moved by the input")
    return found


def _square(name: str, values: Any) -> Floats:
    found = _arrays.numbers(name, values)
    if found.ndim != 2 or found.shape[0] != found.shape[1] or not 1 <= len(found) <= MAX_STATES:
        raise ConfigError(f"`{name}` has shape {found.shape}, but must have (n, n) with n in 1..={MAX_STATES}")
    return found
