# Everything runs from a virtual environment that the first target makes.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# BLAS threads fight the workers for the cores; the matrices here are small.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1

.PHONY: demo test docs study bench fuzz fixtures schemas reference lint clean

demo: $(VENV)/ready
	$(BIN)/python -m drivetool.cli.demo fixtures/rig demo

test: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/python -m pytest -n 2

docs: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[docs]"
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --nitpicky --fresh-env docs build/docs
	$(BIN)/python docs/check_examples.py

study: $(VENV)/ready
	$(BIN)/python -m pytest -m study -s

bench: $(VENV)/ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[test,bench]"
	$(BIN)/python -m pytest -m bench -s

fuzz: $(VENV)/ready
	$(BIN)/python -m pytest -m fuzz

fixtures: $(VENV)/ready
	$(BIN)/python -m tests.make_fixtures fixtures

schemas: $(VENV)/ready
	$(BIN)/python -m drivetool.files.schema schemas

reference: $(VENV)/ready
	$(BIN)/python docs/generate_reference.py docs/reference

lint: $(VENV)/ready
	$(BIN)/ruff check .

$(VENV)/ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[test]"
	touch $@

clean:
	rm -rf $(VENV) demo build *.egg-info
