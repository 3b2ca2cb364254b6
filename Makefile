# Nothing but Python (3.11 or 3.12) and make is needed; everything else goes into .venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
DEMO := demo
REPORT := report.html

.PHONY: setup demo test test-slow docs check bench fuzz report reference reference-presets reference-robot format clean

setup: $(VENV)/.ok  ## Create .venv with the versions tested together.

$(VENV)/.ok: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 13))" || \
		{ echo "lfobench needs Python 3.11 or 3.12: make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	touch $@

DEMO_TASKS := safe-manipulation-few-trajectories,puck-striking-20-expert

demo: setup  ## Five methods, three seeds, two robot tasks in a simulator: table and picture in three minutes.
	$(BIN)/lfobench run --methods dilo,smodice,oril,bco,bc --suite airhockey --tasks '$(DEMO_TASKS)' \
		--protocol demo --seeds 0-2 --out $(DEMO)
	$(BIN)/lfobench table --out $(DEMO)
	$(BIN)/lfobench plot airhockey --out $(DEMO) --tasks safe-manipulation-few-trajectories --to $(DEMO)/paths.png --width page

test: check  ## Lint, types and the fast tests.
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow"

test-slow: setup  ## The other tests: whole runs, killed runs, benchmarks, the documentation.
	$(BIN)/python -m pytest -n 2 --dist worksteal -m slow

docs: setup  ## The documentation, links checked, into site/.
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict

check: setup  ## Lint and types.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: setup  ## Speed: against the authors' loops, the machine's floor and the targets.
	$(BIN)/python -m benchmarks

fuzz: setup  ## Ten thousand damaged data files: none may crash a reader, or pass in another shape.
	$(BIN)/python tests/data/readers/fuzzing.py 10000

report: setup  ## The reference records as one page: verdict, table with its four knobs, curves, provenance.
	$(BIN)/lfobench report --out results/reference/locomotion-quick --to $(REPORT)

# Hours and days beside other work; the same command goes on where it stopped.
IN_BACKGROUND := nice -n 15 $(BIN)/lfobench
QUICK := --protocol quick --workers 1
TABLE1 := $(QUICK) --seeds 0-2 --out results/reference/table1-quick
PRESETS := $(QUICK) --seeds 0-2 --suite locomotion \
	--tasks 'hopper-random-expert,halfcheetah-medium-expert,walker2d-random-few-expert' --out results/reference/presets-quick
ROBOT := $(QUICK) --steps 3000 --suite airhockey --out results/reference/airhockey-half

reference: setup  ## Table 1 at quick, three seeds.
	$(IN_BACKGROUND) run $(TABLE1) --methods dilo,smodice,oril,bco,bc --suite locomotion \
		--tasks '*-random-expert,*-medium-expert'
	$(IN_BACKGROUND) run $(TABLE1) --methods dilo,smodice,oril,bco --suite table1
	$(IN_BACKGROUND) run $(TABLE1) --methods bc,bc-expert --suite table1

reference-presets: setup  ## The presets' differences one by one, on three tasks.
	$(IN_BACKGROUND) run $(PRESETS) --methods dilo,smodice,bc
	$(IN_BACKGROUND) run $(PRESETS) --methods dilo,smodice,bc --preset paper
	$(IN_BACKGROUND) run $(PRESETS) --methods dilo --set dilo.tau=3
	$(IN_BACKGROUND) run $(PRESETS) --methods dilo --set dilo.conservatism=none
	$(IN_BACKGROUND) run $(PRESETS) --methods dilo --set dilo.policy=gaussian

reference-robot: setup  ## The robot tasks, tuned from the paper's grid, seven seeds; and the share of successes, three.
	$(IN_BACKGROUND) tune $(ROBOT) --methods dilo,smodice,bco
	$(IN_BACKGROUND) run $(ROBOT) --methods dilo,smodice,oril,bco,bc --seeds 0-6 --tuned
	$(IN_BACKGROUND) run $(QUICK) --suite airhockey-share --methods dilo,smodice,oril,bco,bc --seeds 0-2 \
		--out results/reference/airhockey-share

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) $(DEMO) $(REPORT) site
