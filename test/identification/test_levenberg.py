# SPDX-License-Identifier: Apache-2.0
"""Least squares within bounds: as good as SciPy's, in few simulations, on problems that fits bring with them."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import least_squares as scipys
from scipy.optimize import lsq_linear, minimize

from cfd_pneumatic.identification.fit.levenberg import Quadratic, least_squares

FREE = np.full(2, np.inf)


def minimum(*arguments, **options):
    """Return the point that is found, and the sum there."""
    point, cost = least_squares(*arguments, **options)
    return point, cost.total


class Counted:
    """Residuals and Jacobian, and what they were asked for."""

    def __init__(self, residuals, jacobian):
        self.residuals = residuals
        self.jacobian = jacobian
        self.points = []

    def __call__(self, point):
        self.points.append(point.copy())
        return Quadratic.from_rows(np.vstack([self.residuals(point), self.jacobian(point).T]))

    def totals(self):
        """Return the sum of squares at each point."""
        return np.array([np.sum(self.residuals(point) ** 2) for point in self.points])


def linear(matrix, target):
    return Counted(lambda point: matrix @ point - target, lambda point: matrix)


def rosenbrock():
    return Counted(
        lambda point: np.array([10.0 * (point[1] - point[0] ** 2), 1.0 - point[0]]),
        lambda point: np.array([[-20.0 * point[0], 10.0], [-1.0, 0.0]]),
    )


def decay(seed, unknowns=4):
    """Return residuals of a sum of two decays with noise, in logarithms as gains are, and its true point."""
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 5.0, 60)
    truth = np.array([0.5, 1.0, -0.5, -1.0]) + 0.3 * rng.standard_normal(unknowns)

    def parts(point):
        size, rate, other, slow = np.exp(point)
        return size * np.exp(-rate * times), other * np.exp(-slow * times)

    def residuals(point):
        fast, slow = parts(point)
        return fast + slow - target

    def jacobian(point):
        _, rate, _, other = np.exp(point)
        fast, slow = parts(point)
        return np.column_stack([fast, -rate * times * fast, slow, -other * times * slow])

    target = sum(parts(truth)) + 0.01 * rng.standard_normal(times.size)
    return Counted(residuals, jacobian), truth


@given(
    seed=st.integers(0, 2**31),
    unknowns=st.integers(1, 8),
    more=st.integers(0, 30),
    kind=st.sampled_from(['plain', 'skewed', 'without one', 'one twice']),
    where=st.sampled_from(['inside', 'at bounds', 'outside']),
)
def test_linear_problems_end_at_the_bounded_optimum(seed, unknowns, more, kind, where):
    """Skewed columns: where a step meets one bound, the others have to know of it."""
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((unknowns + more, unknowns))
    if kind == 'skewed':
        matrix = matrix @ (np.eye(unknowns) + 2.0 * rng.standard_normal((unknowns, unknowns)))
    elif kind == 'without one':
        matrix[:, rng.integers(unknowns)] = 0.0
    elif kind == 'one twice':
        matrix[:, 0] = matrix[:, -1]
    target = matrix @ rng.standard_normal(unknowns) * rng.choice([0.3, 1.0, 3.0]) + rng.standard_normal(len(matrix))
    lower, upper = -2.0 * rng.random(unknowns), 2.0 * rng.random(unknowns)
    start = {
        'inside': lower + (upper - lower) * rng.random(unknowns),
        'at bounds': np.where(rng.random(unknowns) < 0.5, lower, upper),
        'outside': 5.0 * rng.standard_normal(unknowns),
    }[where]
    problem = linear(matrix, target)
    point, total = minimum(problem, start, lower, upper, 1e-10, 500)
    best = lsq_linear(matrix, target, (lower, upper), tol=1e-14, max_iter=1000)
    assert total <= 2.0 * best.cost * (1.0 + 1e-5) + 1e-9
    assert total == pytest.approx(np.sum((matrix @ point - target) ** 2))
    assert all(np.all((lower <= one) & (one <= upper)) for one in problem.points)


@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('bounded', [False, True])
def test_nonlinear_problems_end_where_scipys_do(seed, bounded):
    problem, truth = decay(seed)
    lower, upper = np.full(4, -5.0), np.full(4, 5.0)
    if bounded:
        lower, upper = truth - np.array([0.1, 3.0, 3.0, 3.0]), truth + np.array([3.0, 3.0, 0.05, 3.0])
    start = np.clip(truth + 0.5 * np.random.default_rng(seed).standard_normal(4), lower + 1e-6, upper - 1e-6)
    _, total = minimum(problem, start, lower, upper, 1e-10, 200, longest=np.full(4, 2.0))
    best = scipys(
        problem.residuals, start, jac=problem.jacobian, bounds=(lower, upper), x_scale='jac', ftol=1e-12, xtol=1e-12
    )
    assert total <= 2.0 * best.cost * (1.0 + 1e-5)


def test_follows_a_bent_valley():
    problem = rosenbrock()
    point, total = minimum(problem, np.array([-1.2, 1.0]), -FREE, FREE, 1e-12, 100)
    np.testing.assert_allclose(point, 1.0, atol=1e-5)
    assert total < 1e-10


def test_a_bound_across_the_valley_is_where_it_ends():
    """With x at most 0.5 the least sum is (1 - 0.5)^2, at y = 0.25."""
    point, total = minimum(rosenbrock(), np.array([-1.2, 1.0]), -FREE, np.array([0.5, np.inf]), 1e-12, 100)
    np.testing.assert_allclose(point, [0.5, 0.25], atol=1e-6)
    assert total == pytest.approx(0.25)


@pytest.mark.parametrize('evaluations', [1, 2, 3, 7, 50])
@pytest.mark.parametrize('make', [rosenbrock, lambda: decay(0)[0]], ids=['valley', 'decay'])
def test_never_asks_more_often_than_allowed_and_never_gets_worse(make, evaluations):
    problem = make()
    start = np.array([-1.2, 1.0]) if make is rosenbrock else np.array([1.0, 3.0, 1.0, -3.0])
    bound = np.full(start.size, 10.0)
    point, total = minimum(problem, start, -bound, bound, 0.0, evaluations)
    assert len(problem.points) <= evaluations
    assert total == pytest.approx(np.min(problem.totals()), rel=1e-12), 'what is returned is the best that was seen'
    assert any(np.array_equal(point, one) for one in problem.points)


def test_the_search_ends_where_it_is_enough():
    thorough, content = rosenbrock(), rosenbrock()
    minimum(thorough, np.array([-1.2, 1.0]), -FREE, FREE, 0.0, 100)
    _, total = minimum(content, np.array([-1.2, 1.0]), -FREE, FREE, 0.0, 100, enough=1.0)
    assert total <= 1.0 < np.min(content.totals()[:-1])
    np.testing.assert_array_equal(content.points, thorough.points[: len(content.points)])


def test_far_above_the_noise_the_search_ends_sooner():
    """The residual of the decay is its noise: 60 samples of 0.01."""
    noise = 60 * 0.01**2
    start, bound = np.array([1.0, 3.0, 1.0, -3.0]), np.full(4, 10.0)
    near, _ = decay(0)
    _, total = minimum(near, start, -bound, bound, 1e-3, 50, noise=noise)
    assert total < 1.5 * noise, 'a large sum on the way does not end the search near the noise'
    far, _ = decay(0)
    _, total = minimum(far, start, -bound, bound, 1e-3, 50, noise=1e-3 * noise)
    assert len(far.points) < len(near.points)
    assert total >= np.min(near.totals())


@given(st.integers(0, 2**32 - 1))
def test_residuals_with_derivatives_below_them_are_the_same_quadratic(seed):
    rows = np.random.default_rng(seed).standard_normal((4, 50))
    one = Quadratic.from_rows(rows)
    other = Quadratic(float(rows[0] @ rows[0]), rows[1:] @ rows[0], rows[1:] @ rows[1:].T)
    for name in ('total', 'gradient', 'normal'):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12, atol=1e-12)


def test_more_evaluations_are_never_worse():
    totals = [
        minimum(rosenbrock(), np.array([-1.2, 1.0]), -FREE, FREE, 0.0, evaluations)[1] for evaluations in range(1, 40)
    ]
    assert np.all(np.diff(totals) <= 0.0)


@pytest.mark.parametrize('wrong', [np.nan, np.inf, 1e200])
@pytest.mark.filterwarnings('error')
def test_a_model_that_runs_away_is_stepped_back_from(wrong):
    """The square root of what is searched, where its start leads the first steps to below zero."""

    def residuals(point):
        return np.array([np.sqrt(point[0]) - 0.1, 0.0]) if point[0] > 0.0 else np.full(2, wrong)

    def jacobian(point):
        return np.array([[0.5 / np.sqrt(point[0])], [0.0]]) if point[0] > 0.0 else np.full((2, 1), np.nan)

    problem = Counted(residuals, jacobian)
    point, _ = minimum(problem, np.array([1.0]), np.array([-9.0]), np.array([9.0]), 1e-14, 100)
    assert any(one[0] <= 0.0 for one in problem.points), 'or nothing was tested'
    assert point[0] == pytest.approx(0.01, rel=1e-3)


def test_a_start_without_a_model_is_returned():
    problem = Counted(lambda point: np.full(3, np.nan), lambda point: np.full((3, 2), np.nan))
    point, total = minimum(problem, np.array([0.5, 7.0]), -np.ones(2), np.ones(2), 1e-8, 20)
    np.testing.assert_array_equal(point, [0.5, 1.0])
    assert total == np.inf
    assert len(problem.points) == 1


@pytest.mark.filterwarnings('error')
def test_where_nothing_depends_on_anything_it_stays():
    problem = linear(np.zeros((5, 2)), np.ones(5))
    point, total = minimum(problem, np.array([0.3, -0.2]), -np.ones(2), np.ones(2), 1e-8, 20)
    np.testing.assert_array_equal(point, [0.3, -0.2])
    assert total == 5.0
    assert len(problem.points) == 1


def test_held_by_its_bounds_it_stays():
    problem = linear(np.eye(2), np.array([3.0, -4.0]))
    start = np.array([1.0, -1.0])
    point, total = minimum(problem, start, -np.ones(2), np.ones(2), 1e-8, 20)
    np.testing.assert_array_equal(point, start)
    assert total == pytest.approx(4.0 + 9.0)


def of_sizes(seed, scales):
    """Return a linear problem whose unknowns change the residuals by so much, and the point where they are 0."""
    matrix = np.random.default_rng(seed).standard_normal((20, 3)) * scales
    truth = np.array([2.0, -1.0, 0.5])
    return linear(matrix, matrix @ truth), truth


@given(seed=st.integers(0, 2**32 - 1), sizes=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
@example(seed=0, sizes=[-3.0, 0.0, 3.0])
def test_unknowns_of_very_different_sizes(seed, sizes):
    """Marquardt's damping knows each one's scale: what is left is the rounding of the largest terms of a residual."""
    scales = 10.0 ** np.array(sizes)
    problem, truth = of_sizes(seed, scales)
    point, _ = minimum(problem, np.zeros(3), np.full(3, -9.0), np.full(3, 9.0), 0.0, 100)
    assert np.max(scales * np.abs(point - truth)) <= 20.0 * np.finfo(float).eps * np.max(scales)


@pytest.mark.parametrize('seed', [0, 2540])
def test_an_unknown_with_less_than_a_millionth_of_anothers_influence_costs_no_more_than_that(seed):
    """It is held back, here by six orders more than that, and the others make up for it as far as they can."""
    problem, truth = of_sizes(seed, np.array([1e-6, 1.0, 1e6]))
    point, total = minimum(problem, np.zeros(3), np.full(3, -9.0), np.full(3, 9.0), 0.0, 100)
    alone = problem.jacobian(point)[:, 0] * (point[0] - truth[0])
    rounding = np.finfo(float).eps * 1e6
    assert total <= np.sum(alone**2) + 20.0 * rounding**2


@pytest.mark.parametrize('start', [-3.0, -5.0, -8.0])
def test_a_step_that_goes_far_too_far_is_soon_short_enough(start):
    """Where a model hardly answers, the linearised one goes so far that the sum is beyond all bounds."""
    problem = Counted(lambda point: np.exp(point) - 1.0, lambda point: np.exp(point)[:, None])
    bounds = np.full(1, 50.0)
    point, _ = minimum(problem, np.array([start]), -bounds, bounds, 1e-12, 100)
    assert abs(point[0]) < 1e-9
    totals = problem.totals()
    risen = totals[1:] > np.minimum.accumulate(totals)[:-1]
    longest = max(map(len, ''.join('x' if one else ' ' for one in risen).split()))
    assert longest <= 3


@given(seed=st.integers(0, 99), spread=st.floats(0.5, 10.0))
def test_beside_what_is_known_beforehand_it_ends_where_both_are_likeliest(seed, spread):
    """Against a general minimiser of the logarithm of the likelihood, the residuals' variance profiled out."""
    rng = np.random.default_rng(seed)
    matrix, target = rng.standard_normal((200, 2)), 3.0 * rng.standard_normal(200)
    expected, precision = np.array([1.0, 0.0]), np.array([spread**-2.0, 0.0])  # of the second nothing is known

    def evaluate(point):
        rows = np.vstack([matrix @ point - target, matrix.T])
        return Quadratic.from_rows(rows).with_prior(point - expected, precision, target.size)

    found, _ = minimum(evaluate, np.zeros(2), np.full(2, -np.inf), np.full(2, np.inf), 1e-12, 100)
    likeliest = minimize(
        lambda at: target.size * np.log(np.sum((matrix @ at - target) ** 2)) + precision @ (at - expected) ** 2,
        np.zeros(2),
        method='Nelder-Mead',
        options={'xatol': 1e-9, 'fatol': 1e-12},
    )
    error = 3.0 / np.sqrt(target.size)
    assert found == pytest.approx(likeliest.x, abs=0.05 * error)
