# On a machine with Python >= 3.11 and make, every target sets itself up. `make help` lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TRAIN ?= deploy/trains/full.yaml
UP ?=

.PHONY: help up test lint bench compose-test schema clean

help: ## this list
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

up: $(VENV)/.ready ## start the default train and show it (TRAIN=file, UP="--duration 60 --report out.json")
	$(BIN)/milepost up --train $(TRAIN) $(UP)

test: $(VENV)/.ready ## all tests but the container ones
	$(BIN)/python -m pytest -m "not compose"

lint: $(VENV)/.ready ## ruff and mypy --strict
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/milepost schema --check

bench: $(VENV)/.bench ## step costs, codec, offline speed, live latency and load, beside peers
	$(BIN)/python -m tests.bench

compose-test: $(VENV)/.ready ## bring compose.yaml up for real and look at it from outside
	$(BIN)/python -m pytest -m compose tests/compose

schema: $(VENV)/.ready ## export the JSON Schemas
	$(BIN)/milepost schema

clean: ## remove what make made
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis
