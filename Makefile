# Two commands on a bare machine: `make run` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# what is installed: what a run needs; that and what tests, documentation and measurements need
RUN := $(VENV)/.installed-for-runs
ALL := $(VENV)/.installed
comma := ,
# files with a test against the clock: only to collect all others would take seconds
ALONE = $(sort $(shell grep -rl --include='test_*.py' 'mark\.alone' tests))

# tests start hundreds of processes, and each would compile all that it imports
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup run test long check docs hil reproduce release program

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-12s %s\n", $$1, $$2}'

# uv takes a fourth of pip's time; it reads none of pip's settings, and pip does it where uv cannot
define install
@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make $(MAKECMDGOALS) PYTHON=/path/to/python3.11" >&2; exit 2; }
@test -x $(BIN)/python || { echo "making $(VENV)"; $(PYTHON) -m venv $(VENV); }
@echo "installing $(1) into $(VENV): downloads of about $(2)"
@mirror=$$($(BIN)/python -m pip config get global.index-url 2>/dev/null); \
    { $(BIN)/python -m pip install --quiet --disable-pip-version-check uv \
    && $(BIN)/uv pip install --python $(BIN)/python --compile-bytecode $${mirror:+--default-index "$$mirror"} -c constraints.txt -e '.[$(3)]'; } \
    || $(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[$(3)]'
@touch $@
endef

$(RUN): pyproject.toml constraints.txt
	$(call install,what runs need,290 MB,all)

$(ALL): pyproject.toml constraints.txt
	$(call install,what runs and tests need,960 MB,all$(comma)dev$(comma)docs$(comma)meshes)
	@touch $(RUN)

setup: $(ALL)  ## install everything into .venv, also what tests and documentation need

run: $(RUN)  ## install what runs need, then start the whole stack with the simulated cell
	@exec $(BIN)/rtstack up

# those against the clock after the others, whatever came of these
test: $(ALL)  ## all tests, in a real Chromium too (Debian: apt-get install chromium)
	@status=0; $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --durations 8 -m 'not realtime and not long and not alone' || status=$$?; \
	    $(BIN)/python -m pytest --durations 8 -m 'alone and not realtime and not long' $(ALONE) || status=$$?; exit $$status

long: $(ALL)  ## slow tests that rarely fail, or that another test covers: before a release
	$(BIN)/python -m pytest --durations 8 -m 'long and not realtime'

# types take a core for a minute, the others another one meanwhile
check: $(ALL)  ## lint, types, import rules
	@{ $(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/lint-imports; } & others=$$!; \
	    NODE_OPTIONS=--max-semi-space-size=128 $(BIN)/basedpyright; types=$$?; wait $$others && exit $$types

docs: $(ALL)  ## the documentation's site, warnings as errors, into out/site
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict && echo "look at it: $(BIN)/python -m http.server --bind 127.0.0.1 --directory out/site"

hil: $(ALL)  ## the numbered suite against arms: make hil CELL=LEFT,RIGHT HIL="--cell-file FILE --marks --reflexes --motion" (report: out/hil/); else simulated
	$(BIN)/python -m pytest -p no:cacheprovider tests/hil $(if $(CELL),--cell $(CELL)) --hil-report out/hil/$$(date +%Y-%m-%dT%H-%M-%S).md $(HIL)

reproduce: $(ALL)  ## every table and figure again, on one page; 40 minutes on two cores, resumes (QUICK=1: a sample in five minutes; DATA=DIR: measurements for reality; out/reproduce)
	@$(BIN)/python -m tests.programs reproduce $(if $(QUICK),--quick) $(if $(DATA),--data $(DATA))

release: $(ALL)  ## wheel, sdist, hashes of all that they need, SBOM (out/release)
	@$(BIN)/python -m tests.programs release

program: $(ALL)  ## measurements, campaigns, fuzzing: make program NAME=soak ARGS="--minutes 5"; without NAME the list
	@$(BIN)/python -m tests.programs $(NAME) $(ARGS)
