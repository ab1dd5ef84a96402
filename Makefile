# Two commands on a bare machine: `make run` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# files with a test against the clock: only to collect all others would take seconds
ALONE = $(sort $(shell grep -rl --include='test_*.py' 'mark\.alone' tests))
# without the plant: uncompiled, a trial takes minutes
SAFETY_TESTS := $(filter-out %_plant.py,$(wildcard tests/safety/test_*.py))

# tests start hundreds of processes, and each would compile all that it imports
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup run test long realtime check bench coverage mutate explore faults screenshots fuzz-api soak dead-man good-trials impact-oracles random-plans unseen-grabs recompute kill-campaign hil link-table cluster reproduce compare release docs docs-commands clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-12s %s\n", $$1, $$2}'

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make run PYTHON=/path/to/python3.11" >&2; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[all,dev,docs,meshes]'
	@touch $@

setup: $(STAMP)  ## install everything into .venv

run: setup  ## install, then start the whole stack with the simulated cell
	@exec $(BIN)/rtstack up

# those against the clock after the others, whatever came of these
test: setup  ## all tests, in a real Chromium too (Debian: apt-get install chromium)
	@status=0; $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --durations 8 -m 'not realtime and not long and not alone' || status=$$?; \
	    $(BIN)/python -m pytest --durations 8 -m 'alone and not realtime and not long' $(ALONE) || status=$$?; exit $$status

long: setup  ## the tests that take minutes: campaigns killed and cut off, a sample of the fault matrix, more widths of the pages
	$(BIN)/python -m pytest --durations 8 -m 'long and not realtime'

realtime: setup  ## the tests whose outcome depends on this machine keeping time
	$(BIN)/python -m pytest -m realtime

check: setup  ## lint, types, import rules
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/basedpyright && $(BIN)/lint-imports

bench: setup  ## the tick, measured beside its plain numpy version
	$(BIN)/rtstack bench tick

coverage: setup  ## the judge and the arming state machine: every branch run by their tests
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run --branch --source=rtstack/safety -m pytest -q -p no:cacheprovider $(SAFETY_TESTS)
	$(BIN)/coverage report --show-missing --fail-under=100

mutate: setup  ## change the judge in one place at a time: do its tests notice? (resumes, .mutants/)
	@$(BIN)/python -m tests.programs.mutate --minutes 120 --jobs 2

explore: setup  ## 10000 sequences of events: no motion without arming, no way out of a fault but recovery
	RTSTACK_SEQUENCES=10000 $(BIN)/python -m pytest --timeout=0 --hypothesis-show-statistics tests/safety/test_arming.py

faults: setup  ## each fault at each moment, kill -9 of each process: what happens, in a table (resumes, out/faults/)
	@status=0; $(BIN)/python -m tests.programs.fault_matrix || status=$$?; $(BIN)/python -m tests.programs.fault_kills && exit $$status

screenshots: setup  ## look at every page, and take the documentation's pictures anew (docs/screenshots)
	RTSTACK_SCREENSHOTS=1 $(BIN)/python -m pytest -m 'long or not long' tests/browser/test_look.py

fuzz-api: setup  ## ten minutes of made-up requests to a console of its own: no 5xx, every answer as described
	RTSTACK_FUZZ_SECONDS=200 $(BIN)/python -m pytest -s tests/console/test_api_schema.py

soak: setup  ## half an hour of the whole stack at work: memory, descriptors, missed deadlines
	@$(BIN)/python -m tests.programs.soak --minutes 30

dead-man: setup  ## key, tab, browser and console let go of moving arms: the first stopping torque within 350 ms? (BARE=1: no 3D scene)
	@$(BIN)/python -m tests.programs.dead_man $(if $(BARE),--bare)

recompute: setup  ## a campaign's numbers from its logs, without our code: make recompute OUT=DIR
	@$(BIN)/python -m tests.programs.recompute $(OUT)

kill-campaign: setup  ## campaigns killed with -9 and resumed, TRIALS=N or the whole plan: the same results? (resumes, out/)
	@$(BIN)/python -m tests.programs.kill_campaign out/killed $(if $(TRIALS),--trials $(TRIALS))

hil: setup  ## the numbered suite against arms: make hil CELL=LEFT,RIGHT HIL="--cell-file FILE --marks --motion" (report: out/hil/); else simulated
	$(BIN)/python -m pytest -p no:cacheprovider tests/hil $(if $(CELL),--cell $(CELL)) --hil-report out/hil/$$(date +%Y-%m-%dT%H-%M-%S).md $(HIL)

link-table: setup  ## what delay, jitter, loss, duplicates and reordering between PC and robot a trial stands (out/link/link.md)
	@$(BIN)/python -m tests.programs.link_table --out out/link

cluster: setup  ## three workers in three namespaces, one killed, one cut off: the same table? (TRIALS=40; out/cluster)
	@$(BIN)/python -m tests.programs.cluster out/cluster $(if $(TRIALS),--trials $(TRIALS))

impact-oracles: setup  ## the impact map against independent oracles, in 1000 random configurations
	@$(BIN)/python -m tests.programs.impact_oracles --configurations 1000

random-plans: setup  ## 100 random plans: do the accepted ones succeed, would the refused ones have? (resumes, .random-plans/)
	@$(BIN)/python -m tests.programs.random_plans

unseen-grabs: setup  ## 20 planned grabs at unseen speeds and heights, as planned and with a wrong velocity (resumes, .unseen-grabs/)
	@$(BIN)/python -m tests.programs.unseen_grabs

good-trials: setup  ## 140 grabs without an intervention, and one with each limit in reach (resumes, .good-trials/)
	@$(BIN)/python -m tests.programs.good_trials

reproduce: setup  ## every table and figure again, on one page; hours, resumes (QUICK=1: a sample in five minutes; DATA=DIR: measurements for reality; out/reproduce)
	@$(BIN)/python -m tests.programs.reproduce $(if $(QUICK),--quick) $(if $(DATA),--data $(DATA))

compare: setup  ## other authors' simulated robots and kinematics beside ours, in one table (some minutes on a quiet machine; out/compare.md)
	@$(BIN)/python -m tests.programs.compare

release: setup  ## wheel, sdist, hashes of all that they need, SBOM (out/release)
	@$(BIN)/python -m tests.programs.release

docs: setup  ## the documentation's site, warnings as errors, into out/site
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict && echo "look at it: $(BIN)/python -m http.server --bind 127.0.0.1 --directory out/site"

docs-commands: setup  ## run every command of the documentation, also those that take minutes
	RTSTACK_DOCS=all $(BIN)/python -m pytest --timeout=0 tests/docs/test_commands.py

clean:  ## remove what was installed and built
	rm -rf $(VENV) .venv-foreign build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
