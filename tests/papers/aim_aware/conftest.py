"""The study as it is committed."""

from pathlib import Path

import pytest

from rtstack.papers.aim_aware.study import Study, StudyRun, load_run

STUDY_FILE = Path(__file__).resolve().parents[3] / "deploy/campaigns/aim-aware-planar.toml"


@pytest.fixture(scope="session")
def study_run() -> StudyRun:
    return load_run(STUDY_FILE, quick=True)


@pytest.fixture(scope="session")
def study(study_run) -> Study:
    return study_run.study


@pytest.fixture
def study_text() -> str:
    return STUDY_FILE.read_text(encoding="utf-8")
