# Everything runs from a virtual environment that the first target makes.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# BLAS threads fight the workers for the cores; the matrices here are small.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1

.PHONY: demo test test-slow test-long check docs lint types packages test-floor study ablation bench machinery fuzz golden fixtures \
	kernel schemas reference clean

demo: $(VENV)/ready
	$(BIN)/python -m drivetool.cli.demo fixtures/rig demo

# Every change: at most five minutes on two cores, the compilation of the kernel included.
test: $(VENV)/ready
	$(BIN)/python -m pytest -n 2

# Other hidden effects, recorded machines, coverage of intervals, every size of the kernel; last the share of statements and
# branches of each room that this tier ran, in %. At most thirty minutes.
test-slow: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -m 'slow and not (long or study)' --cov --cov-report=
	@for room in logs drive identify check tune files site cli; do \
		echo "covered: $$room $$($(BIN)/coverage report --format=total --include="drivetool/$$room/*")"; done
	@echo "covered: all $$($(BIN)/coverage report --format=total)"

# Before a change of the search or the fit is taken over: further records, and such as had once gone wrong.
test-long: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -m long

# At most 8 minutes.
check: lint types packages docs

lint: $(VENV)/ready
	$(BIN)/ruff check .

types: $(VENV)/checkers
	$(BIN)/mypy

packages: $(VENV)/checkers
	$(BIN)/python .ci/installed.py

docs: $(VENV)/checkers
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --nitpicky --fresh-env docs build/docs
	$(BIN)/python docs/check_examples.py

# With the lowest versions that pyproject.toml allows.
test-floor:
	python3.11 -m venv build/floor
	python3.11 .ci/floors.py >build/floor/constraints
	build/floor/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint build/floor/constraints --editable ".[test]"
	build/floor/bin/python -m pytest -n 2

# The rules of a verdict, each left out in turn, on the rows that the studies have stored: minutes, no fit.
ablation: $(VENV)/ready
	$(BIN)/python -m tests.study.ablation build/*.jsonl

study: $(VENV)/ready
	$(BIN)/python -m pytest -m study -s

bench: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[test,bench]"
	$(BIN)/python -m pytest -m bench -s

# What each piece of the kernel costs at the first use, and buys per sample: half an hour on a quiet machine.
machinery: $(VENV)/ready
	$(BIN)/python -m tests.bench.machinery

fuzz: $(VENV)/ready
	$(BIN)/python -m pytest -m fuzz

# What a user gets from the working tree against BASE, on the same inputs: about 20 minutes on two free cores, BASE
# once more; at most an hour.
golden:
	$(PYTHON) -m tests.golden $(BASE)

fixtures: $(VENV)/ready
	$(BIN)/python -m tests.make_fixtures fixtures
	$(BIN)/python -m tests.summaries fixtures/site/summary.parquet

# The kernel's text for the checkout, after a change of its code: two minutes of processor time.
kernel: $(VENV)/ready
	PYTHONHASHSEED=0 $(BIN)/python -m drivetool.drive.compile.build --lower

schemas: $(VENV)/ready
	$(BIN)/python -m drivetool.files.shapes.schema schemas

reference: $(VENV)/ready
	$(BIN)/python docs/generate_reference.py docs/reference

$(VENV)/ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[test]"
	touch $@

$(VENV)/checkers: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[check,docs]"
	touch $@

clean:
	rm -rf $(VENV) demo build .coverage* *.egg-info
