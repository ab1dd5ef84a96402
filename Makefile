# Two commands on a bare machine: `make run` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help setup run test realtime check bench clean

help:  ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-8s %s\n", $$1, $$2}'

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make run PYTHON=/path/to/python3.11" >&2; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,meshes]'
	@touch $@

setup: $(STAMP)  ## install everything into .venv

run: setup  ## install, then start the whole stack with the simulated cell
	@exec $(BIN)/rtstack up

test: setup  ## all tests, in a real Chromium too (Debian: apt-get install chromium)
	$(BIN)/python -m pytest

realtime: setup  ## the tests whose outcome depends on this machine keeping time
	$(BIN)/python -m pytest -m realtime

check: setup  ## lint, types, import rules
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/basedpyright && $(BIN)/lint-imports

bench: setup  ## the tick, measured beside its plain numpy version
	$(BIN)/rtstack bench tick

clean:  ## remove what was installed and built
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
