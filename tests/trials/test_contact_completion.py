"""A displaced box, grabbed with the contact-completion detector: two impacts, and the interim mode outlasts both."""

import numpy as np
import pytest

from rtstack.control.parameters import CompletionParameters, ControlParameters
from rtstack.log.reader import read_log
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.measures import contact_completed, measure
from rtstack.samples import Mode
from rtstack.trials.review import log_columns
from tests.support.sampling import sampled

BOTH = (Controller.PROPOSED, Controller.CONTACT_COMPLETION)


@pytest.fixture(scope="module", params=sampled((-30.0, 30.0), lambda shift: shift > 0.0))
def pair(request, runner, cell, tmp_path_factory):
    """The same trial with both controllers: log, columns, result and measures of each."""
    found = {}
    for controller in BOTH:
        path = tmp_path_factory.mktemp("pair") / f"{controller}.mcap"
        result = runner.run(controller, request.param, seed=2, log=path)
        assert result.success, result.failure_reason
        log = read_log(path)
        columns = log_columns(log)
        measures = measure(
            columns, cell, result.object, request.param, result.nominal_impact_time_s, result.detected_impact_time_s
        )
        found[controller] = (log, columns, result, measures)
    return found


def test_the_interim_mode_outlasts_the_second_impact(pair):
    _, _, result, measures = pair[Controller.CONTACT_COMPLETION]
    post_s = result.detected_impact_time_s + 1e-3 * measures.interim_ms
    assert measures.second_contact_s - measures.first_contact_s > 0.05
    assert post_s > measures.contact_completed_s > measures.second_contact_s
    _, _, result, measures = pair[Controller.PROPOSED]
    assert measures.interim_ms == pytest.approx(1e3 * ControlParameters().interim_s)
    assert result.detected_impact_time_s + 0.1 < measures.contact_completed_s  # it did not wait


def test_the_wrench_is_continuous_where_the_interim_mode_ends_as_the_proposed_ones_is_not(pair):
    """Against the largest ordinary change in the 200 ms before the impact."""
    steps = {}
    for controller, (_, columns, _, _) in pair.items():
        change = np.linalg.norm(np.diff(columns.control["wrench_desired"], axis=1), axis=(0, 2))
        modes = columns.control[0]["mode"]
        impact, post = int(np.argmax(modes == Mode.INTERIM)), int(np.argmax(modes == Mode.POST_IMPACT))
        steps[controller] = change[post - 6 : post + 5].max() / change[impact - 200 : impact - 10].max()
    assert steps[Controller.CONTACT_COMPLETION] <= 2.0
    assert steps[Controller.PROPOSED] > 4.0


def test_completion_is_an_event_of_the_log_and_gamma_waits_for_it(pair):
    log, columns, result, _ = pair[Controller.CONTACT_COMPLETION]
    parameters = ControlParameters()
    (event,) = (event for event in log.events if event.name == "contact")
    t_s = (columns.arm[0]["t_ns"] - columns.arm[0]["t_ns"][0]) * 1e-9
    completed_s = (event.t_ns - columns.arm[0]["t_ns"][0]) * 1e-9
    assert event.text == f"complete at {completed_s:.3f} s"
    gamma = columns.control["gamma"]
    cap_s = result.detected_impact_time_s + parameters.completion_gamma * parameters.interim_s
    waiting = (t_s > cap_s + 5e-4) & (t_s < completed_s + 5e-4)
    assert waiting.sum() > 20
    assert np.all(gamma[:, waiting] == parameters.completion_gamma)
    after = int(np.searchsorted(t_s, completed_s + 5e-4))
    np.testing.assert_allclose(np.diff(gamma[0][after - 1 : after + 29]), 0.01, atol=1e-9)
    assert not [event for event in pair[Controller.PROPOSED][0].events if event.name == "contact"]


def test_the_detector_finds_in_the_log_what_it_found_in_the_trial(pair, cell):
    """To two ticks: the log's velocities are differences of positions."""
    log, columns, result, measures = pair[Controller.CONTACT_COMPLETION]
    (event,) = (event for event in log.events if event.name == "contact")
    assert measures.contact_completed_s == pytest.approx((event.t_ns - columns.arm[0]["t_ns"][0]) * 1e-9, abs=2.1e-3)
    detected = round(1e3 * result.detected_impact_time_s)
    assert contact_completed(columns, cell, detected, 0.05, CompletionParameters()) is None
