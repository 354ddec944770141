"""Rewards learned from choices."""

import doctest

import numpy as np
import pytest

from lanecraft import ConfigError, irl

TRUTH = np.array([1.0, -2.0, 0.5])


def made_up(events: int = 1500, candidates: int = 8, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(events, candidates, 3)) * [1.0, 0.5, 2.0] + [0.0, 10.0, -3.0]
    return features, np.argmax(features @ TRUTH + rng.gumbel(size=(events, candidates)), axis=1)


def test_known_weights_are_recovered():
    features, chosen = made_up()
    found = irl.fit(irl.Choices.from_arrays(features, chosen))
    cosine = found.weights @ TRUTH / np.linalg.norm(found.weights) / np.linalg.norm(TRUTH)
    assert found.converged and cosine > 0.99
    assert found.log_likelihood_per_event > found.uniform_log_likelihood_per_event + 0.5
    np.testing.assert_allclose(found.means, features.mean(axis=(0, 1)))
    np.testing.assert_allclose(found.scales, features.std(axis=(0, 1)), rtol=1e-9)


def test_the_gradient_vanishes_without_a_penalty():
    features, chosen = made_up(200)
    choices = irl.Choices.from_arrays(features, chosen)
    found = irl.fit(choices, {"ridge": 0.0})
    probabilities = np.exp(found.log_probabilities(choices)).reshape(200, 8)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1.0)
    expected = np.einsum("ec,ecf->f", probabilities, features)
    np.testing.assert_allclose(features[np.arange(200), chosen].sum(axis=0), expected, atol=1e-2)
    assert found.log_likelihoods(choices).mean() == pytest.approx(found.log_likelihood_per_event, abs=1e-12)


def test_arrays_lists_and_frames_are_the_same():
    pandas = pytest.importorskip("pandas")
    features, chosen = made_up(60)
    whole = irl.fit(irl.Choices.from_arrays(features, chosen, names=["x", "y", "z"]))
    assert (irl.fit(irl.Choices.from_lists(list(features), chosen)).weights == whole.weights).all()
    frame = pandas.DataFrame(features.reshape(-1, 3), columns=["x", "y", "z"])
    frame["event"] = np.repeat(np.arange(60), 8)
    frame["chosen"] = (np.arange(8) == chosen[:, None]).reshape(-1)
    frame["driver"] = np.repeat(np.arange(60) % 3, 8)
    mixed = frame.sample(frac=1.0, random_state=1)
    choices = irl.Choices.from_frame(mixed, features=["x", "y", "z"], group="driver")
    np.testing.assert_allclose(irl.fit(choices).weights, whole.weights, atol=1e-7)
    assert len(irl.leave_one_group_out(choices).groups) == 3
    for change in ({"event": "evnt"}, {"chosen": "driver"}, {"group": "chosen"}, {"features": ["x", "w"]}):
        with pytest.raises(ConfigError):
            irl.Choices.from_frame(frame, **{"features": ["x"], **change})
    with pytest.raises(TypeError):
        irl.Choices.from_frame({"x": [1.0]}, features=["x"])


def test_events_may_have_different_numbers_of_candidates():
    features, chosen = made_up()
    counts = 3 + np.arange(len(features)) % 6
    ragged = [rows[:count] for rows, count in zip(features, counts, strict=True)]
    kept = chosen < counts
    choices = irl.Choices.from_lists([rows for rows, keep in zip(ragged, kept, strict=True) if keep], chosen[kept])
    found = irl.fit(choices)
    # What was chosen among more is chosen among the rest with the same odds.
    assert found.weights @ TRUTH / np.linalg.norm(found.weights) / np.linalg.norm(TRUTH) > 0.99
    assert found.best(choices).shape == (len(choices),)
    assert (found.best(choices) == choices.chosen).mean() > 0.4


def test_groups_are_judged_by_the_others():
    features, chosen = made_up(120)
    groups = np.array(["anna", "bert", "carl"])[np.arange(120) % 3]
    choices = irl.Choices.from_arrays(features, chosen, groups=groups)
    judged = irl.leave_one_group_out(choices)
    assert list(judged.groups) == ["anna", "bert", "carl"]
    for group, fitted in zip(judged.groups, judged.fits, strict=True):
        alone = irl.fit(choices.subset(groups != group))
        assert (fitted.weights == alone.weights).all()
        tested = groups == group
        np.testing.assert_array_equal(judged.log_likelihoods[tested], alone.log_likelihoods(choices.subset(tested)))
    assert judged.log_likelihood_per_event > judged.uniform_log_likelihoods.mean() + 0.5
    assert judged.log_likelihood_per_event < irl.fit(choices).log_likelihood_per_event
    with pytest.raises(ConfigError, match="at least two"):
        irl.leave_one_group_out(irl.Choices.from_arrays(features, chosen))


def test_options_are_those_of_the_configuration():
    features, chosen = made_up(80)
    choices = irl.Choices.from_arrays(features, chosen)
    assert np.linalg.norm(irl.fit(choices, {"ridge": 100.0}).weights) < np.linalg.norm(irl.fit(choices).weights)
    assert irl.fit(choices, {"method": "gradient-ascent", "episodes": 7}).iterations == 7
    assert not irl.fit(choices, {"max_iterations": 1, "gradient_tolerance": 1e-12}).converged
    for options in ({"ridge": -1.0}, {"ridge": np.nan}, {"rigde": 0.1}, {"method": "newtons"}, {"episodes": 10**30}):
        with pytest.raises(ConfigError):
            irl.fit(choices, options)
    with pytest.raises(TypeError):
        irl.fit(choices, [1])


def test_a_feature_that_never_varies_weighs_nothing():
    features, chosen = made_up(50)
    features[:, :, 1] = 7.0
    found = irl.fit(irl.Choices.from_arrays(features, chosen))
    assert found.weights[1] == found.scales[1] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
def test_bad_features_are_refused(bad):
    features, chosen = made_up(5)
    features[3, 2, 1] = bad
    with pytest.raises(ConfigError):
        irl.fit(irl.Choices.from_arrays(features, chosen))


@pytest.mark.parametrize("bad", [None, "abc", [], 3, [[1.0]], 10**400, [1, "a"], [None], 1j])
def test_bad_arrays_are_refused(bad):
    features, chosen = made_up(5)
    for make in (irl.Choices.from_arrays, irl.Choices.from_lists):
        with pytest.raises((ConfigError, TypeError)):
            make(bad, chosen)
        with pytest.raises((ConfigError, TypeError)):
            make(features, bad)
    with pytest.raises((ConfigError, TypeError)):
        irl.fit(bad)


def test_bad_choices_are_refused():
    features, chosen = made_up(5)
    with pytest.raises(ConfigError, match="1000"):
        irl.fit(irl.Choices.from_arrays(np.zeros((1, 1, 100_000)), [0]))
    for wrong in (chosen[:4], chosen + 8, chosen - 9, chosen.astype(float), np.full(5, 2**64 - 1, dtype=np.uint64)):
        with pytest.raises((ConfigError, TypeError)):
            irl.Choices.from_arrays(features, wrong)
    with pytest.raises(ConfigError, match="groups"):
        irl.Choices.from_arrays(features, chosen, groups=["a"])
    with pytest.raises(ConfigError, match="names"):
        irl.Choices.from_arrays(features, chosen, names=["a"])
    with pytest.raises(ConfigError):
        irl.Choices.from_lists([features[0], features[1][:, :2]], [0, 0])
    found = irl.fit(irl.Choices.from_arrays(features, chosen))
    with pytest.raises(ConfigError, match="names|features"):
        found.rewards(irl.Choices.from_arrays(features, chosen, names=["a", "b", "c"]))


def test_arrays_of_any_kind_are_read():
    features, chosen = made_up(20)
    plain = irl.fit(irl.Choices.from_arrays(features, chosen)).weights
    odd = np.asfortranarray(features[::-1])[::-1]
    odd.flags.writeable = False
    assert (irl.fit(irl.Choices.from_arrays(odd, chosen.astype(np.int8))).weights == plain).all()


def test_the_examples_are_true():
    assert doctest.testmod(irl, optionflags=doctest.ELLIPSIS).failed == 0
