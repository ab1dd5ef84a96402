"""What a notebook uses: each run is one call, with a controller, an object or a policy that no package offers."""

import copy
import json
import pickle
from dataclasses import replace
from functools import partial
from importlib.metadata import version

import numpy as np
import pytest

import rtstack
from hal.base.configuration import ConfigurationError
from rtstack.control.modes import Strategy
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log
from rtstack.model.cell_description import ObjectDescription
from rtstack.teleoperation.policy import Chunk
from rtstack.trials.controllers import OwnFactory, controller_factory
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification, specification_of
from rtstack.trials.trial import prepare_trial
from tests.support.runs import of_the_run

NAME = f"{__name__}.no_interim"


def no_interim(request, impact_later_s=0.0):
    """The paper's baseline of the same name, where the impact is meant when it is."""
    return request.pair(replace(request, nominal_impact_s=request.nominal_impact_s + impact_later_s).modes(MODES))


MODES = Strategy.NO_INTERIM


def test_the_package_has_its_version_and_names():
    assert rtstack.__version__ == version("rtstack")
    assert {"run_trial", "run_trials", "plot", "__version__"} <= set(dir(rtstack))
    assert rtstack.run_trial.__self__ == rtstack.Simulation()
    with pytest.raises(AttributeError, match="no attribute 'run_trail'"):
        _ = rtstack.run_trail


def test_a_function_runs_as_the_same_controller_that_a_package_offers(demonstration, tmp_path):
    log = tmp_path / "own.mcap"
    own = rtstack.run_trial(demonstration.path, no_interim, displacement_mm=-20.0, seed=3, log=log)
    named = rtstack.run_trial(demonstration.path, "no_interim", displacement_mm=-20.0, seed=3)
    assert own.success
    assert own.controller == NAME
    assert type(own.controller) is str
    assert of_the_run(own, "controller") == of_the_run(named, "controller")
    trial = read_log(log).metadata["trial"]
    assert json.loads(trial["versions"])[NAME] == "not from a package"
    with pytest.raises(TrialError, match=f"unknown controller '{NAME}'.*a Python object's: pass the object$"):
        specification_of(trial)


def test_what_is_imported_from_a_package_has_its_version(cell, demonstration):
    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell, controller=np.linalg.norm)
    assert prepared.specification.controller == "numpy.linalg.norm"
    from rtstack.trials.controllers import CONTROLLERS, package_of_choice

    assert package_of_choice(CONTROLLERS, prepared.specification.controller) == ("numpy", np.__version__)


class Late:
    """Fires once, in a given tick."""

    def __init__(self, arm):
        self.ticks = 0

    def update(self, arm):
        """Count the ticks."""
        self.ticks += 1
        return self.ticks == 1401


def test_a_detector_is_an_object_too(demonstration):
    result = rtstack.run_trial(demonstration.path, detector=Late)
    assert result.detected_impact_time_s == pytest.approx(1.4, abs=2e-3)
    assert f"{__name__}.Late" in read_log(result.log).metadata["trial"]["specification"]


def test_a_partial_function_has_its_arguments_in_the_name():
    own = OwnFactory(partial(no_interim, impact_later_s=0.05))
    assert own == f"{NAME}(impact_later_s=0.05)"
    for same in (
        copy.deepcopy(own),
        pickle.loads(pickle.dumps(own)),
        TrialSpecification("a", controller=own).controller,
    ):
        assert same == own
        assert controller_factory(same).keywords == {"impact_later_s": 0.05}
    slashed = TrialSpecification("a", controller=OwnFactory(partial(no_interim, "/a b")))
    assert slashed.log_stem == f"trial-{NAME}_a_b_-rice_box"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"displacement_mm": "20"}, "displacement_mm: Input should be a valid number, not '20'"),
        ({"seed": -1}, "seed: Input should be greater than or equal to 0, not -1"),
        ({"displacment_mm": 3.0}, "displacment_mm: Unexpected keyword argument, not 3.0"),
        ({"controller": "propsed"}, "controller: Value error, unknown controller 'propsed': choose one of .*"),
        ({"object": "jar"}, "unknown object 'jar': .*"),
    ],
)
def test_wrong_arguments_are_one_line(demonstration, given, said):
    for run in (rtstack.run_trial, partial(rtstack.run_trials, n=2)):
        with pytest.raises(TrialError, match=f"^{said}$") as error:
            run(demonstration.path, **given)
        assert "\n" not in str(error.value)


def test_arms_that_are_not_simulated_and_a_log_that_exists_are_refused(demonstration, install):
    source = "from rtstack.cells import CellKind\nbench = CellKind(open)"
    install("bench", source, "rtstack.cells", bench="bench")
    with pytest.raises(TrialError, match="the cell bench:left has real arms: rtstack trial"):
        rtstack.Simulation("bench:left").run_trial(demonstration.path)
    with pytest.raises(LogError, match=r"ref\.mcap exists already"):
        rtstack.demonstrate(demonstration.path)


def test_an_object_is_simulated_and_in_the_log():
    jar = ObjectDescription(mass=1.2, size=(0.2, 0.28, 0.22), pad_friction=0.7, plant={"mass": 1.3})
    lab = rtstack.Simulation(objects={"jar": jar})
    taught = lab.demonstrate(object="jar")
    assert taught.success
    assert taught.max_lift_mm > 100.0
    log = read_log(taught.log)
    assert "[objects.jar.plant]\nmass = 1.3" in log.attachment("cell.toml").decode()
    assert any("mass 1.3 kg (the controller: 1.2 kg)" in event.text for event in log.events)
    assert lab.run_trial(taught, displacement_mm=10.0).object == "jar"
    with pytest.raises(TrialError, match="unknown object 'jar'"):
        rtstack.run_trial(taught)


class Rise:
    """Both pads rise for half a second."""

    def act(self, observation):
        """Go up from where the arms are to be."""
        if observation.t_s > 0.5:
            return Chunk(finished=True)
        poses = observation.pose_ref[None].copy()
        poses[..., 2] += 0.005
        return Chunk(step_s=0.05, poses=poses)

    def close(self):
        """Nothing is held."""


def test_a_policy_leads_the_arms():
    result = rtstack.run_policy(Rise(), displacement_mm=20.0)
    assert result.success
    assert result.operator == "Rise"
    arm = read_log(result.log).topic("/left/arm")
    assert arm["O_T_EE"][-1].reshape(4, 4)[2, 3] - arm["O_T_EE"][0].reshape(4, 4)[2, 3] > 0.01
    with pytest.raises(TrialError, match="rate_hz: expected 10 to 50, not 0"):
        rtstack.run_policy(Rise(), rate_hz=0)


def test_a_figure_shows_itself(demonstration):
    figure = rtstack.plot(demonstration.result, demonstration.path, show=["pad_force"], impact=True)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert [axis.get_ylabel() for axis in figure.axes] == ["pad force, N"]
    first, last = figure.axes[0].get_xlim()
    assert last - first == pytest.approx(0.5)
    with pytest.raises(LogError, match="no log to draw"):
        rtstack.plot(replace(demonstration.result, log=None))
    with pytest.raises(LogError, match="pad_froce"):
        rtstack.plot(demonstration.path, show=["pad_froce"])


def test_a_controller_that_cannot_be_made_is_one_line(demonstration):
    def broken(request):
        raise KeyError("gain")

    with pytest.raises(TrialError, match=r"the controller cannot be made: KeyError: 'gain' \(.*test_notebook.py:\d+\)"):
        rtstack.run_trial(demonstration.path, broken)
    with pytest.raises(
        TrialError, match=r"broken, rice_box, \+0 mm, seed 1: TrialError: the controller cannot be made"
    ):
        rtstack.run_trials(demonstration.path, 2, broken, workers=1)


@pytest.mark.long
def test_a_table_has_rows_means_and_shows_itself(demonstration, tmp_path):
    folder = tmp_path / "logs"
    several = ["proposed", partial(no_interim, impact_later_s=0.0)]
    table = rtstack.run_trials(
        demonstration.path, 2, several, displacements=[-20, 0], workers=1, log_folder=folder, yaw_deg=1.0
    )
    keys = [(row.controller, row.displacement_mm, row.seed, row.yaw_deg) for row in table]
    names = ("proposed", f"{NAME}(impact_later_s=0.0)")
    assert keys == [(name, mm, seed, 1.0) for name in names for mm in (-20.0, 0.0) for seed in (1, 2)]
    assert [row.log for row in table] == [str(path) for path in sorted(folder.glob("*.mcap"))]
    assert table.mean("max_lift_mm").mean == pytest.approx(np.mean(table.column("max_lift_mm")))
    assert table.mean("impact_verdict_time_s").n == 8 - table.column("impact_verdict_time_s").count(None)
    head, *lines = repr(table).splitlines()
    assert " ".join(head.split()) == "controller object displacement n success mean force norm peak force norm lift, mm"
    assert [line.split()[:4] for line in lines] == [[n, "rice_box", mm, "mm"] for n in names for mm in ("-20", "+0")]
    assert repr(table)[:-1].count("100 % [34, 100]") == 4
    assert table._repr_html_().count("<tr>") == 5
    with pytest.raises(TrialError, match="unknown column 'lift'"):
        table.mean("lift")
    with pytest.raises(LogError, match="exists already"):
        rtstack.run_trials(demonstration.path, 2, several, displacements=[-20, 0], log_folder=folder)


def test_a_table_without_trials_or_with_one_twice_is_refused(demonstration):
    for given in ({"seeds": [1, 1]}, {"n": 0}, {"controller": ["proposed", "proposed"]}):
        with pytest.raises(TrialError, match="trials: give one at least"):
            rtstack.run_trials(demonstration.path, **given)


def test_pandas_is_optional(demonstration):
    table = rtstack.TrialTable((rtstack.run_trial(demonstration.path, displacement_mm=5.0),))
    try:
        import pandas  # noqa: F401
    except ModuleNotFoundError:
        with pytest.raises(ConfigurationError, match="needs pandas: pip install pandas"):
            table.to_pandas()
    else:
        assert table.to_pandas().loc[0, "displacement_mm"] == 5.0
