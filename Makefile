# `make synth` and `make test` set everything up by themselves, in .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt
PYTEST_ARGS ?= -n auto

.PHONY: help synth test lint slow assure bench bench-torcs study mutate clean
.DEFAULT_GOAL := help

help:
	@echo "make synth   install pirlc in $(VENV) and synthesise examples/cartpole.pirl"
	@echo "make test    lint, then the tests"
	@echo "make lint    formatting, style, types, layers"
	@echo "make slow    the long checks"
	@echo "make assure  emitted C under compilers, analysers, sanitizers and on other machines"
	@echo "make bench   the benchmarks; bench-torcs: the experiments in TORCS (hours)"
	@echo "make study   the paper's tables, and pirlc beside other methods (hours)"
	@echo "make mutate  plants faults in templates, printers and lowering: do the tests notice?"
	@echo "make clean   remove $(VENV), runs and caches"

synth: $(VENV)/installed
	@$(BIN)/pirlc synth examples/cartpole.pirl -o runs/cartpole

test: lint
	@$(BIN)/python -m pytest -q -rs $(PYTEST_ARGS)

lint: $(VENV)/installed-dev
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check .
	@$(BIN)/mypy --strict pirlc
	@$(BIN)/lint-imports --no-logo

slow: $(VENV)/installed-dev
	@$(BIN)/python -m pytest -q -m slow

assure: $(VENV)/installed-dev
	@$(BIN)/python -m benchmarks.assure

bench: $(VENV)/installed-dev
	@$(BIN)/python -m benchmarks.scoring
	@$(BIN)/python -m benchmarks.step_instructions
	@$(BIN)/python -m benchmarks.optimizers
	@$(BIN)/python -m benchmarks.growth

bench-torcs: $(VENV)/installed-dev
	@$(BIN)/pirlc torcs install
	@for name in synthesise performance smoothness transfer environment robustness; do \
	    $(BIN)/python -m benchmarks.torcs.$$name || exit 1; done

study: $(VENV)/installed-dev
	@$(BIN)/pirlc torcs install
	@$(BIN)/python -m benchmarks.peers
	@$(BIN)/python -m benchmarks.study --suite classic torcs

mutate: $(VENV)/installed-dev
	@$(BIN)/python -m benchmarks.mutation

clean:
	@rm -rf $(VENV) build dist runs *.egg-info
	@rm -rf .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	    echo "pirlc needs Python 3.11 or later; name one: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "This Python cannot make virtual environments." >&2; \
	    echo "On Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@echo "creating $(VENV)"
	@$(PYTHON) -m venv --clear $(VENV)

$(VENV)/installed: pyproject.toml setup.py constraints.txt | $(BIN)/python
	@echo "installing pirlc and what it needs"
	@$(PIP) -e .
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	@echo "installing the development tools"
	@$(PIP) -e '.[dev]'
	@touch $@
