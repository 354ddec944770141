"""The quadratic programs, against the optimality conditions solved densely."""

import doctest

import numpy as np
import pytest

from lanecraft import ConfigError, qp


def random_problem(seed: int, **more) -> qp.Problem:
    rng = np.random.default_rng(seed)
    horizon, n = 12, 3
    a = np.eye(n) + 0.1 * rng.normal(size=(horizon, n, n))
    return qp.Problem.make(
        horizon,
        initial_state=rng.normal(size=n),
        a=a,
        b=rng.normal(size=(horizon, n)),
        c=0.1 * rng.normal(size=(horizon, n)),
        state_weight=rng.uniform(0.1, 2.0, size=(horizon, n)),
        state_reference=rng.normal(size=(horizon, n)),
        input_weight=rng.uniform(0.5, 2.0, size=horizon),
        input_reference=rng.normal(size=horizon),
        terminal_weight=np.diag(rng.uniform(0.0, 5.0, size=n)),
        **more,
    )


def condensed(problem: qp.Problem) -> tuple[np.ndarray, np.ndarray]:
    """H and g of the cost ½ u'Hu + g'u + constant without rows, from the trajectories of unit inputs."""
    horizon, n, _ = problem.size
    free = problem.states(np.zeros(horizon))[1:]
    slopes = np.stack([problem.states(unit)[1:] - free for unit in np.eye(horizon)])
    weights = np.stack([np.diag(w) for w in problem.state_weight])
    weights[-1] += problem.terminal_weight
    hessian = np.einsum("iks,kst,jkt->ij", slopes, weights, slopes) + np.diag(problem.input_weight)
    gradient = np.einsum("iks,kst,kt->i", slopes, weights, free - problem.state_reference)
    return hessian, gradient - problem.input_weight * problem.input_reference


@pytest.mark.parametrize("seed", range(5))
def test_without_bounds_it_is_the_solution_of_the_normal_equations(seed):
    problem = random_problem(seed)
    hessian, gradient = condensed(problem)
    solution = qp.Solver().solve(problem)
    assert solution.solved and solution.active == ()
    np.testing.assert_allclose(solution.inputs, np.linalg.solve(hessian, -gradient), atol=1e-9)
    np.testing.assert_allclose(solution.states, problem.states(solution.inputs), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_with_bounds_and_rows_the_optimality_conditions_hold(seed):
    rng = np.random.default_rng(100 + seed)
    rows = {"row_state": rng.normal(size=(12, 2, 3)), "row_input": rng.normal(size=(12, 2)), "row_lower": -0.4, "row_upper": 0.4}
    problem = random_problem(seed, input_min=-0.5, input_max=0.7, row_l1_weight=0.3, row_l2_weight=2.0, **rows)
    solution = qp.Solver().solve(problem)
    assert solution.solved and len(solution.active) > 3
    hessian, gradient = condensed(problem)
    horizon = problem.size[0]
    free = problem.states(np.zeros(horizon))[:-1]
    slopes = np.stack([problem.states(unit)[:-1] - free for unit in np.eye(horizon)])
    row_slopes = np.einsum("kms,jks->jkm", problem.row_state, slopes)
    row_slopes[np.arange(horizon), np.arange(horizon)] += problem.row_input
    stationary = hessian @ solution.inputs + gradient + np.einsum("jkm,km->j", row_slopes, solution.row_duals) + solution.input_duals
    np.testing.assert_allclose(stationary, 0.0, atol=1e-7)
    assert (solution.inputs >= -0.5).all() and (solution.inputs <= 0.7).all()
    for row in solution.active:
        assert row.multiplier >= 0.0
        expected = 0.0 if row.row is None else max(0.0, row.multiplier - 0.3) / 2.0
        assert row.slack == pytest.approx(expected, abs=1e-9)
    # No way of doing otherwise costs less.
    for _ in range(50):
        other = np.clip(solution.inputs + 1e-3 * rng.normal(size=horizon), -0.5, 0.7)
        assert problem.cost(other) >= problem.cost(solution.inputs) - 1e-12


def test_a_warm_start_takes_fewer_steps_to_the_same_optimum():
    cold, warm = qp.Solver(), qp.Solver()
    problem = random_problem(1, input_min=-0.2, input_max=0.2)
    first = warm.solve(problem)
    again, anew = warm.solve(problem), cold.solve(problem, warm=False)
    assert again.iterations <= 1 < anew.iterations == first.iterations
    np.testing.assert_allclose(again.inputs, anew.inputs, atol=1e-10)
    warm.reset()
    assert warm.solve(problem).iterations == first.iterations


def test_feedback_is_the_slope_of_the_first_input():
    start = np.array([0.3, -0.2, 0.5])
    solver = qp.Solver()

    def first_input(state):
        made = random_problem(3, input_min=-0.6, input_max=0.6)
        return solver.solve(qp.Problem(**{**vars(made), "initial_state": state}))

    at = first_input(start)
    for i, unit in enumerate(1e-6 * np.eye(3)):
        moved = first_input(start + unit)
        assert (moved.inputs[0] - at.inputs[0]) / 1e-6 == pytest.approx(at.feedback[i], abs=1e-5)


def test_every_size_is_solved_alike():
    rng = np.random.default_rng(0)
    for n in range(1, 9):
        for m in range(9):
            a = np.eye(n) * 0.9
            rows = rng.normal(size=(m, n))
            common = {"initial_state": np.ones(n), "a": a, "b": np.ones(n), "state_weight": np.ones(n)}
            made = qp.Problem.make(5, **common, row_state=rows, row_upper=np.inf)
            solution = qp.Solver().solve(made)
            hessian, gradient = condensed(made)
            np.testing.assert_allclose(solution.inputs, np.linalg.solve(hessian, -gradient), atol=1e-10)


def test_a_step_limit_ends_the_solve_within_the_bounds():
    problem = random_problem(2, input_min=-0.1, input_max=0.1)
    solution = qp.Solver().solve(problem, step_limit=0)
    assert solution.status == "step-limit" and not solution.solved
    assert (np.abs(solution.inputs) <= 0.1).all()


def test_zero_order_hold_and_infinite_horizon():
    transition, gain = qp.zero_order_hold([[0.0, 1.0], [0.0, 0.0]], [0.0, 1.0], 0.5)
    np.testing.assert_allclose(transition, [[1.0, 0.5], [0.0, 1.0]], atol=1e-14)
    np.testing.assert_allclose(gain, [0.125, 0.5], atol=1e-14)
    weights = np.array([1.0, 0.1])
    terminal = qp.infinite_horizon_weight(transition, gain, weights, 2.0)
    p, q = terminal + np.diag(weights), np.diag(weights)
    pressed = transition.T @ p @ gain
    np.testing.assert_allclose(p, q + transition.T @ p @ transition - np.outer(pressed, pressed) / (2.0 + gain @ p @ gain), atol=1e-9)
    with pytest.raises(ConfigError, match="no such weight"):
        qp.infinite_horizon_weight([[2.0]], [0.0], [1.0], 1.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, None, "1", 10**400, [], [1.0, 2.0, 3.0, 4.0, 5.0], 1j, object()])
@pytest.mark.parametrize("key", ["initial_state", "a", "b", "c", "state_weight", "input_weight", "terminal_weight", "row_state", "row_l2_weight"])
def test_bad_numbers_are_refused(key, bad):
    values = {"initial_state": [1.0, 0.0], "a": np.eye(2), "b": [0.0, 1.0], "state_weight": 1.0, "row_state": np.ones((1, 2)), key: bad}
    if key == "row_state" and bad is None:
        pytest.skip("no rows")
    with pytest.raises((ConfigError, TypeError)):
        qp.Solver().solve(qp.Problem.make(4, **values))


def test_bad_sizes_and_ranges_are_refused():
    good = {"initial_state": [1.0], "a": [[1.0]], "b": [1.0], "state_weight": [1.0]}
    for horizon in (0, -1, 257, 10**30):
        with pytest.raises(ConfigError):
            qp.Problem.make(horizon, **good)
    with pytest.raises(TypeError):
        qp.Problem.make(4.5, **good)
    solver = qp.Solver()
    for change in ({"input_weight": 0.0}, {"state_weight": -1.0}, {"input_min": 1.0, "input_max": 0.0}, {"terminal_weight": -1.0}):
        with pytest.raises(ConfigError):
            solver.solve(qp.Problem.make(4, **{**good, **change}))
    made = qp.Problem.make(4, **good)
    for wrong in (np.ones((4, 2, 2)), 1.0, []):
        for key in ("a", "b", "row_input", "input_min"):
            with pytest.raises(ConfigError, match="shape"):
                qp.Problem(**{**vars(made), key: wrong if key != "input_min" else [0.0]})
    with pytest.raises(TypeError):
        qp.Problem(**{**vars(made), "a": None})
    with pytest.raises(TypeError):
        solver.solve(None)
    assert solver.solve(made).solved


def test_arrays_of_any_kind_are_read():
    a = np.asfortranarray(np.stack([np.eye(2)] * 8))[::2]
    a.flags.writeable = False
    weights = np.ones((4, 4), dtype=np.float32)[:, ::-2]
    made = qp.Problem.make(4, initial_state=np.array([1, 0]), a=a, b=[0, 1], state_weight=weights)
    assert qp.Solver().solve(made).solved


def test_numbers_beyond_all_scales_end_without_a_claim():
    for size in (1e100, 1e200, 1e300):
        made = qp.Problem.make(4, initial_state=[size, -size], a=size * np.ones((2, 2)), b=[size, 1.0], state_weight=size, input_max=1.0)
        solution = qp.Solver().solve(made)
        assert not solution.solved and np.isfinite(solution.inputs).all() and (solution.inputs <= 1.0).all()


def test_the_examples_are_true():
    assert doctest.testmod(qp, optionflags=doctest.ELLIPSIS).failed == 0
