"""Pads that are mounted half a turn about their normal: w of their quaternions is near 0 all the time."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from rtstack.cells import default_cell_file
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from rtstack.playback.replay import replay
from rtstack.samples import SIDES
from rtstack.trials.specification import TrialSpecification
from tests.support.runs import attempt, demonstrate

PAD = "flange_to_face = 0.03\n"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A demonstration with such pads, and a trial of it."""
    folder = tmp_path_factory.mktemp("half_turned")
    file, recording, trial = folder / "cell.toml", folder / "ref.mcap", folder / "trial.mcap"
    text = default_cell_file().read_text()
    assert PAD in text
    file.write_text(text.replace(PAD, f"{PAD}orientation_wxyz = [0.0, 0.0, 0.0, 1.0]\n"))
    description = load_cell_description(file)
    assert demonstrate(recording, description, file=file).success
    specification = TrialSpecification(str(recording), displacement_mm=-30.0)
    assert attempt(specification, description, trial, file=file).success
    return recording, trial


def turns(path: Path, child: str) -> np.ndarray:
    """Return the quaternions of a frame of /tf, (n, 4)."""
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        said = [each.decoded_message.transforms for each in reader.iter_decoded_messages(topics=["/tf"])]
    found = [each.rotation for transforms in said for each in transforms if each.child_frame_id == child]
    return np.array([(q.w, q.x, q.y, q.z) for q in found])


def test_no_quaternion_over_time_changes_its_sign_and_no_recording_begins_with_another(logs) -> None:
    for side in SIDES:
        asked = [read_log(path).topic(f"/{side}/control")["pose_ref"][:, 3:] for path in logs]
        assert np.abs(asked[1][:, 0]).min() < 1e-3  # as they would by w alone
        assert asked[0][0] @ asked[1][0] > 0.0
        for q in (*asked, *(turns(path, f"{side}_pad") for path in logs)):
            assert np.einsum("ij,ij->i", q[1:], q[:-1]).min() > 0.99


def test_the_replay_of_such_a_trial_is_the_same_to_the_bit(logs) -> None:
    assert all(replay(path).same for path in logs)
