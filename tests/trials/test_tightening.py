"""A trial may tighten a limit and never widen one, and nothing that comes over a socket can do either."""

import json
import re

import pytest

from hal.base.configuration import ConfigurationError
from rtstack.cli.app import main
from rtstack.live.protocol import ProtocolError, decode_request
from rtstack.log.reader import read_log
from rtstack.safety.limits import HARDWARE
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.tightening import limits_of_arms, load_tightening
from tests.support.runs import attempt


def _file(tmp_path, text: str):
    path = tmp_path / "safety.toml"
    path.write_text(text)
    return path


def test_a_trial_is_stopped_by_its_own_limit_and_says_so(runner, tmp_path):
    tightening = load_tightening(_file(tmp_path, "[safety]\nee_speed_max = 0.3\n"))
    specification = TrialSpecification(str(runner.reference), seed=1, safety=tightening)
    path = tmp_path / "tight.mcap"
    result = attempt(specification, runner.cell, path)
    assert re.match("safety stop: (left|right): the end effector is too fast", str(result.failure_reason))
    metadata = read_log(path).metadata
    assert json.loads(metadata["trial"]["specification"])["safety"] == {"ee_speed_max": 0.3}
    fault = metadata["fault"]
    assert fault["bound"] == "0.3"
    assert float(fault["value"]) > 0.3
    assert fault["side"] in ("left", "right")
    assert fault["joint"] == ""
    assert fault["reaction_ticks"] in ("0", "1")


def test_what_the_cell_has_tightened_stays(cell):
    key = next(key for key, value in cell.safety.items() if isinstance(value, float) and key.endswith("max"))
    own = cell.safety[key]
    assert getattr(limits_of_arms(cell)[0], key) == own
    assert getattr(limits_of_arms(cell, ((key, own / 2),))[0], key) == own / 2
    between = (own + getattr(HARDWARE, key)) / 2  # inside the hardware's, outside the cell's
    with pytest.raises(TrialError, match=f"safety.{key} = .*may only tighten"):
        limits_of_arms(cell, ((key, between),))[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[safety]\nee_speed_max = 99.0\n", "safety.ee_speed_max = 99.0: may only tighten"),
        (
            "[safety]\nee_speed_max = nan\n",
            "safety.toml:2: key safety.ee_speed_max: Input should be a finite number, found nan",
        ),
        ("[safety]\nspeed = 1.0\n", "safety.speed: no such limit"),
        ("[safety]\ndq_max = [1.0]\n", "must be a list of 7 numbers"),
        ("ee_speed_max = 1.0\n", "key "),
        ("[safety\n", "not valid TOML"),
    ],
)
def test_what_would_widen_is_one_line_and_nothing_is_written(runner, tmp_path, capsys, monkeypatch, text, said):
    path, log = _file(tmp_path, text), tmp_path / "a.mcap"
    asked = ["rtstack", "trial", f"--reference={runner.reference}", f"--safety={path}", f"--log={log}"]
    monkeypatch.setattr("sys.argv", asked)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert said in lines[0]
    assert not log.exists()


def test_a_file_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_tightening(tmp_path / "none.toml")


def test_no_request_has_a_field_for_limits():
    asked = {"kind": "trial", "reference": "a.mcap", "safety": {"ee_speed_max": 1.0}}
    with pytest.raises(ProtocolError, match="safety"):
        decode_request(json.dumps({"verb": "run", "operator": "mira", "specification": asked}).encode() + b"\n")
