# SPDX-License-Identifier: BSD-3-Clause
# Everything runs in .venv, which `setup` makes; every other target makes it first where it is missing or out of date.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test test-long test-slow lint docs bench bench-commits table results sample clean

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
# One thread a process: the matrices are small, and `test` already runs two processes.
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
OUT ?= out
MEASURE ?= demo,go1,speed
BEFORE ?= 8fd7be3

help: ## this list
	@grep -E '^[a-z-]+:.*## ' $(firstword $(MAKEFILE_LIST)) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 12

setup: $(INSTALLED) ## make .venv with the versions of constraints.txt and the coclo-vio command

$(INSTALLED): pyproject.toml constraints.txt
	@set -e; \
	if [ ! -x $(BIN)/python ]; then \
	  for candidate in $(PYTHON) python3.11 python3 python3.12 python3.13; do \
	    if $$candidate -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then found=$$candidate; break; fi; \
	  done; \
	  if [ -z "$$found" ]; then \
	    echo "coclo-vio needs Python 3.11 or later and found none: install python3.11, or name yours with make setup PYTHON=/path/to/python" >&2; \
	    exit 1; \
	  fi; \
	  $$found -m venv $(VENV); \
	fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

demo: setup ## every estimator on the bundled recording: a table, figures and a report in demo_out/
	$(ONE_THREAD) $(BIN)/coclo-vio demo

# worksteal keeps most files in one process, so that their fixtures are made once.
test: setup ## the default tests, in two processes
	$(ONE_THREAD) $(BIN)/pytest -n 2 --dist worksteal

test-long: setup ## the tests that take more than three seconds, which CI runs too
	$(ONE_THREAD) $(BIN)/pytest -n 2 --dist worksteal -m 'long and not slow'

test-slow: setup ## the tests that take more than half a minute
	$(ONE_THREAD) $(BIN)/pytest -m slow

lint: setup ## style, types, import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: setup ## the documentation site in site/; a warning fails the build
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

bench: setup ## cost of every stage against a calibration loop, as JSON in out/bench.json, and the change since the record
	@mkdir -p $(OUT)
	$(ONE_THREAD) $(BIN)/python -m coclo_vio.experiments.bench -o $(OUT)/bench.json

bench-commits: setup ## how many times as fast as another commit (BEFORE=8fd7be3), in out/commit_speed.json
	@mkdir -p $(OUT)
	$(ONE_THREAD) $(BIN)/python -m coclo_vio.experiments.bench --before $(BEFORE) -o $(OUT)/commit_speed.json

table: setup ## the paper's Table I over ten seeds, in out/table (OUT=... elsewhere); a stopped run is resumed
	$(ONE_THREAD) $(BIN)/coclo-vio table --seeds 10 -o $(OUT)/table

results: setup ## measure demo, Go1 and speed anew, and write all results into README and docs
	$(ONE_THREAD) $(BIN)/python -m coclo_vio.experiments.results --measure '$(MEASURE)'

sample: setup ## remake the bundled sample from its seed (needs OpenGL without a screen)
	$(ONE_THREAD) $(BIN)/python -m coclo_vio.experiments.sample_maker coclo_vio/datasets/sample_data/daisy_stairs.mcap

clean: ## remove .venv, caches and results
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache out demo_out site
	find coclo_vio tests examples -name __pycache__ -type d -prune -exec rm -rf {} +
