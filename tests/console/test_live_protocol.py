"""The mailbox and the lines between console and robot process."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtstack.live.protocol import (
    MAX_LINE_BYTES,
    Answer,
    ControlRequest,
    Job,
    JobKind,
    JobState,
    ProtocolError,
    RunRequest,
    Status,
    StatusRequest,
    TakeRequest,
    decode_answer,
    decode_request,
    encode,
)
from rtstack.loop.mailbox import Mailbox, MailboxError, remove_mailbox
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.safety.arming import Phase
from rtstack.samples import LawInertia
from rtstack.trials.specification import (
    DemonstrationSpecification,
    GuideSpecification,
    HandMotion,
    MoveSpecification,
    PlaybackSpecification,
    TeleoperationSpecification,
    TrialSpecification,
)

REQUESTS = [
    StatusRequest(),
    RunRequest(DemonstrationSpecification("parcel", 2, 3, law_inertia=LawInertia.LINKS_AND_MOTORS), "Zoë K.", "x = 1"),
    RunRequest(TrialSpecification("a.mcap", Controller.NO_INTERIM, "parcel", -12.5, 4), "anna"),
    RunRequest(TrialSpecification("a.mcap", law_inertia=LawInertia.LINKS), "anna"),
    RunRequest(TeleoperationSpecification("", "parcel", recorded=True), "anna"),
    RunRequest(PlaybackSpecification("a.mcap", 0.5), "anna"),
    RunRequest(MoveSpecification(HandMotion.OPEN), "anna"),
    RunRequest(GuideSpecification(), "anna"),
    TakeRequest("anna", over_from="<b>ben</b>"),
    ControlRequest("anna", "release"),
    ControlRequest("anna", "beat"),
    ControlRequest("anna", "arm"),
    ControlRequest("anna", "disarm"),
    ControlRequest("anna", "stop"),
    ControlRequest("anna", "recover"),
]


@pytest.mark.parametrize("request_", REQUESTS, ids=lambda request: request.verb)
def test_a_request_comes_back_as_it_was(request_):
    line = encode(request_)
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    assert decode_request(line) == request_


def test_an_answer_comes_back_as_it_was():
    job = Job(3, JobKind.TRIAL, JobState.FAILED, "t", 0.25, 12.5, 'two\n"lines"', False, "a.mcap")
    status = Status(
        "grab", "direct", "/cells/grab.toml", "/logs", True, ("parcel",), "parcel", job, None, Phase.FAULT,
        "left arm in reflex", "anna", 12.5, True, "fifo",
    )  # fmt: skip
    for answer in (Answer(status=status), Answer(error="no")):
        assert decode_answer(encode(answer)) == answer


def _run(specification, operator=b'"operator": "a", '):
    return b'{"verb": "run", %s"specification": {%s}}' % (operator, specification)


@pytest.mark.parametrize(
    ("line", "key"),
    [
        (b"{}", "verb"),
        (b'{"verb": "dance"}', "verb"),
        (_run(b'"kind": "trial"'), "reference"),
        (_run(b'"kind": "trial", "reference": "a", "displacement_mm": 1e9'), "displacement_mm"),
        (_run(b'"kind": "trial", "reference": "a", "displacement_mm": NaN'), "displacement_mm"),
        (_run(b'"kind": "trial", "reference": "a", "controller": "best"'), "controller"),
        (_run(b'"kind": "trial", "reference": "a", "law_inertia": "m"'), "law_inertia"),
        (b'{"verb": "stop", "operator": "a", "now": true}', "now"),
        (_run(b'"kind": "identification", "joint": 1'), "kind"),
        (_run(b'"kind": "trial", "reference": "a", "safety": [["ee_speed_max", 0.1]]'), "safety"),
        (_run(b'"kind": "demonstration", "seed": -1'), "seed"),
        (_run(b'"kind": "demonstration", "seed": true'), "seed"),
        (_run(b'"kind": "demonstration", "seed": "5"'), "seed"),
        (_run(b'"kind": "trial", "reference": "a", "displacement_mm": false'), "displacement_mm"),
        (_run(b'"kind": "teleoperation", "operator": "a", "object": "a", "recorded": 1'), "recorded"),
        (_run(b'"kind": "demonstration", "object": "a b"'), "object"),
        (_run(b'"kind": "demonstration"', b""), "operator"),
        (b'{"verb": "stop"}', "operator"),
        (b'{"verb": "take", "operator": ""}', "operator"),
        (b'{"verb": "take", "operator": " anna"}', "operator"),
        (b'{"verb": "take", "operator": "an\\nna"}', "operator"),
        (b'{"verb": "take", "operator": "an\\u202ena"}', "operator"),
        (b'{"verb": "take", "operator": "%s"}' % (b"a" * 41), "operator"),
    ],
)
def test_a_bad_request_is_one_line_that_names_the_key(line, key):
    with pytest.raises(ProtocolError, match=key) as refusal:
        decode_request(line)
    assert "\n" not in str(refusal.value)


@given(st.binary(max_size=200))
def test_any_other_line_is_refused_and_never_more(line):
    assert len(line) < MAX_LINE_BYTES
    with pytest.raises(ProtocolError):
        decode_request(line)


@pytest.fixture
def mailbox():
    name = "rtstack-test-mailbox"
    remove_mailbox(name)
    box = Mailbox.create(name)
    yield name, box
    box.close()


def test_a_stop_crosses_the_mailbox_and_stays_until_it_is_cleared(mailbox):
    name, owner = mailbox
    other = Mailbox.attach(name)
    assert not owner.stop_requested
    other.request_stop()
    other.request_stop()
    assert owner.stop_requested
    other.close()
    assert owner.stop_requested
    owner.clear_stop()
    assert not owner.stop_requested


def test_only_the_owner_removes_the_name(mailbox):
    name, owner = mailbox
    Mailbox.attach(name).close()
    Mailbox.attach(name).close()
    with pytest.raises(MailboxError, match="exists"):
        Mailbox.create(name)
    owner.close()
    owner.close()
    with pytest.raises(MailboxError, match="No such file"):
        Mailbox.attach(name)


@pytest.mark.parametrize("name", ["", "../x", "a/b", "ä", "a b"])
def test_a_path_is_no_name(name):
    for verb in (Mailbox.create, Mailbox.attach, remove_mailbox):
        with pytest.raises(MailboxError, match="a name has"):
            verb(name)
