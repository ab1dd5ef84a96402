"""One record asks for a run: it comes back from a log, and each door has its fields."""

import json
from dataclasses import fields
from typing import Annotated

import pytest
import typer
from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked
from typer.testing import CliRunner

from console.orders import DemonstrationOrder, MoveOrder, PlaybackOrder, TeleoperationOrder, TrialOrder
from console.queue.entry import SweepOrder
from console.queue.queue import load_entries
from rtstack.cli.options import asks_for
from rtstack.messages import MESSAGE
from rtstack.samples import LawInertia, Reaction
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import (
    DemonstrationSpecification,
    FreeRunSpecification,
    HandMotion,
    MoveSpecification,
    PlaybackSpecification,
    SweepSpecification,
    TeleoperationSpecification,
    TrialSpecification,
    like,
    specification_of,
)

LAW = LawInertia.LINKS
SPECIFICATIONS = (
    TrialSpecification("a.mcap", safety=(("ee_speed_max", 0.1),), reaction=Reaction.STOP, yaw_deg=5.0, law_inertia=LAW),
    DemonstrationSpecification("parcel", 2, speed_m_s=0.3, law_inertia=LAW),
    SweepSpecification("parcel", 4, 1),
    FreeRunSpecification("grab", "ante", 0),
    TeleoperationSpecification("anna", recorded=True, job=3),
    PlaybackSpecification("a.mcap", 0.5, digest="12"),
    MoveSpecification(HandMotion.OPEN, "parcel"),
)


def record(specification, **more):
    return {"kind": specification.kind, "specification": json.dumps(specification.as_dict())} | more


@pytest.mark.parametrize("specification", SPECIFICATIONS, ids=lambda each: type(each).__name__)
def test_a_log_gives_its_specification_back(specification):
    assert specification_of(record(specification)) == specification


def test_an_older_log_has_the_defaults_and_the_law_that_there_was():
    old = {"kind": "trial", "specification": '{"reference": "a.mcap", "displacement_mm": -30.0}'}
    found = specification_of(old)
    assert found == TrialSpecification("a.mcap", displacement_mm=-30.0, law_inertia=LawInertia.LINKS_AND_MOTORS)
    assert specification_of(old | {"law_inertia": "M"}) == like(TrialSpecification, found, law_inertia=LAW)


@pytest.mark.parametrize(
    ("trial", "said"),
    [
        ({"kind": "plan"}, "kind is plan"),
        ({}, "kind is unknown"),
        ({"kind": "trial", "specification": "{"}, "JSON"),
        ({"kind": "trial", "specification": '{"reference": "a", "seed": -1}'}, "seed: "),
        ({"kind": "trial", "specification": '{"reference": "a"}', "law_inertia": "m"}, "law_inertia: "),
    ],
)
def test_what_is_no_specification_is_one_line(trial, said):
    with pytest.raises(TrialError, match=said) as error:
        specification_of(trial)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("order", "body"),
    [
        (TrialOrder, {"reference": "1", "object": "parcel", "safety": [["ee_speed_max", 0.1]]}),
        (DemonstrationOrder, {"object": "parcel", "speed_m_s": 0.3}),
        (TeleoperationOrder, {"object": "parcel", "operator": "anna"}),
        (TeleoperationOrder, {"object": "parcel", "job": 3}),
        (MoveOrder, {"motion": "open", "object": "parcel"}),
        (PlaybackOrder, {"log": "1", "digest": "12"}),
        (TrialOrder, {"reference": "1"}),
    ],
)
def test_a_body_has_no_key_for_what_the_program_or_a_file_says(order, body):
    adapter = TypeAdapter(order)
    with pytest.raises(ValidationError):
        adapter.validate_python(body)
    kept = {key: body[key] for key in ("reference", "motion", "log") if key in body}
    assert adapter.validate_python(
        kept | {"object": "parcel"} if "object" in adapter.json_schema()["required"] else kept
    )


def test_every_field_of_a_trial_is_one_of_a_sweep_and_of_its_trials():
    sweep = SweepOrder(reference="1", objects=("parcel",), seeds="0:1", reaction=Reaction.STOP, law_inertia=LAW)
    varied = {"object", "controller", "displacement_mm", "displacement_x_mm", "yaw_deg", "seed"}
    assert {each.name for each in fields(TrialOrder)} - varied <= {each.name for each in fields(sweep)}
    assert [(trial.seed, trial.reaction, trial.law_inertia) for trial in sweep.trials()] == [
        (0, "stop", LAW),
        (1, "stop", LAW),
    ]


def test_a_queue_of_an_older_version_is_read(tmp_path):
    trial = {"reference": "1", "object": "parcel", "controller": "proposed", "displacement_mm": -30.0, "seed": 2}
    old = {"displacement_x_mm": 0.0, "yaw_deg": 0.0, "reaction": "continue"}
    entry = {
        "id": "0" * 16,
        "trial": trial | old,
        "followed": "a",
        "repetition": 1,
        "repetitions": 1,
        "state": "waiting",
    }
    gone = {"job": None, "began_s": None, "duration_s": None, "reason": None, "log": None, "ending": None}
    path = tmp_path / "queue.json"
    path.write_text(json.dumps([entry | gone]))
    (found,) = load_entries(path)
    assert found.trial == TrialOrder("1", object="parcel", displacement_mm=-30.0, seed=2)


@checked(frozen=True, slots=True, config=MESSAGE)
class Asked:
    """A record with a field that the command below does not name."""

    seed: int = 0
    note_of: str = ""


def test_a_command_has_an_option_for_each_field_of_its_record():
    program, taken = typer.Typer(), []

    @program.command()
    @asks_for(Asked)
    def command(
        seed: Annotated[int, typer.Option(help="Seed.")] = 0, asked: dict | None = None, json: bool = False
    ) -> None:
        taken.append((Asked(**asked or {}), json))

    assert CliRunner().invoke(program, ["--seed", "3", "--note-of", "x", "--json"]).exit_code == 0
    assert taken == [(Asked(3, "x"), True)]
