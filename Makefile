# On a machine with Python >= 3.11 and make, every target sets itself up. `make help` lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TRAIN ?= full
UP ?=
FUZZ ?=
# what takes longest comes first, so that no core waits for it at the end
FIRST := tests/property tests/consistency tests/replay tests/scenario
# one process a core; a file's tests share what it sets up once
PARALLEL := -n logical --dist loadfile --no-loadscope-reorder
TESTS := $(FIRST) $(filter-out $(FIRST),$(patsubst %/,%,$(wildcard tests/*/)))

.PHONY: help up test test-all test-fast lint audit bench chaos compose-test fuzz docs docs-serve pictures schema clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# requirements.lock pins everything as constraints; the projects say what they need
$(VENV)/.ready: pyproject.toml schemas/pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "milepost: Python 3.11 or newer is needed")'
	@echo "setting up $(VENV); the first time takes about a minute"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ./schemas -e '.[dev]'
	touch $@

$(VENV)/.bench: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ./schemas -e '.[dev,bench]'
	touch $@

$(VENV)/.audit: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ./schemas -e '.[dev,audit]'
	touch $@

$(VENV)/.fuzz: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ./schemas -e '.[dev,fuzz]' \
		|| echo "no atheris for this Python: inputs are altered by chance, not guided by coverage"
	touch $@

$(VENV)/.docs: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ./schemas -e '.[dev,docs]'
	touch $@

up: $(VENV)/.ready ## start the default train and show it (TRAIN=name or file, UP="--duration 60 --report out.json")
	$(BIN)/milepost up --train $(TRAIN) $(UP)

# live trains are tested alone: their deadlines must not compete with other tests for the cores
test: $(VENV)/.ready ## run the tests that take less than ten minutes together
	$(BIN)/python -m pytest $(PARALLEL) -m "not system and not compose and not long" $(TESTS)
	$(BIN)/python -m pytest -m "system and not compose and not long"

test-all: $(VENV)/.ready ## run all tests except those that need a container engine, as CI does
	$(BIN)/python -m pytest $(PARALLEL) -m "not system and not compose" $(TESTS)
	$(BIN)/python -m pytest -m "system and not compose"

test-fast: $(VENV)/.ready ## run the quick tests of units, contracts, properties and golden runs
	$(BIN)/python -m pytest -n logical --dist worksteal --hypothesis-profile=fast -m "not slow" \
		tests/unit tests/contract tests/docs tests/property tests/replay

lint: $(VENV)/.ready ## run ruff and mypy --strict, compare the exported schemas
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/milepost schema --check

audit: $(VENV)/.audit ## look for known weaknesses in the pinned versions (needs PyPI) and for dangerous code
	$(BIN)/bandit --quiet --recursive --severity-level medium services schemas
	$(BIN)/pip-audit --disable-pip --no-deps --requirement requirements.lock

bench: $(VENV)/.bench ## measure step costs, codec, offline speed, live latency and load, beside peers
	$(BIN)/python -m tests.bench

chaos: $(VENV)/.ready ## break a running train in every way of the chaos matrix, and measure (TRAIN=name or file)
	$(BIN)/milepost chaos --train $(TRAIN)

compose-test: $(VENV)/.ready ## test compose.yaml and the Dask cluster with a container engine
	$(BIN)/python -m pytest -m compose tests/compose

fuzz: $(VENV)/.fuzz ## feed every decoder with hostile bytes, a million in all (FUZZ="--inputs N --target T")
	$(BIN)/python -m tests.fuzz $(FUZZ)

schema: $(VENV)/.ready ## write the JSON Schemas, AsyncAPI and the references of docs/
	$(BIN)/milepost schema

docs: $(VENV)/.docs ## build the documentation site in site/, every warning an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

docs-serve: $(VENV)/.docs ## show the documentation on http://127.0.0.1:8000 while it is edited
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve

pictures: $(VENV)/.ready ## draw the pictures of the README and of docs/ again
	$(BIN)/python docs/pictures.py

clean: ## remove what make made
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis site
