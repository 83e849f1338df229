# make demo      base install into .venv, then the demo take through the whole pipeline
# make test      adds the train and dev extras, then the quick tests and the linters
# make test-all  the same with the slow tests
# make lint      style, imports between the layers, types
# make docs      the documentation as a site in site/, with every link and public name checked
.DEFAULT_GOAL := help
.PHONY: help demo test test-all quick-tests all-tests lint docs clean
SHELL := /bin/bash

VENV := .venv
BIN := $(VENV)/bin
# -c on every install: the versions that the tests ran with. pip's own configuration says where from.
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --quiet -c constraints.txt
# Two processes, each with whole files of tests: what a file's tests share is made once. One thread for each, since
# threads of torch that wait for a processor cost the other process its own. In order: files of many short tests are no
# longer than those of a few trainings, which would come last and leave one process idle.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder
# Bytecode is kept, whatever the shell says: the tests start many processes, which otherwise compile all modules again.
export PYTHONDONTWRITEBYTECODE :=
export NUMBA_NUM_THREADS ?= $(shell nproc 2>/dev/null || echo 2)

help:
	@sed -n 's/^# make/make/p' Makefile

demo: $(VENV)/.installed-base
	$(BIN)/muybridge demo

# The linters beside the tests: types take a minute and a half of one processor, and tests leave some time of both.
test: $(VENV)/.installed-dev
	$(MAKE) --no-print-directory -j2 quick-tests lint

test-all: $(VENV)/.installed-dev
	$(MAKE) --no-print-directory -j2 all-tests lint

quick-tests: $(VENV)/.installed-dev
	$(PYTEST) -m "not slow"

all-tests: $(VENV)/.installed-dev
	$(PYTEST)

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "The documentation is in site/; open site/index.html through a web server (python -m http.server -d site)"

$(BIN)/python:
	@scripts/ci/make_venv.sh $(VENV)

# The stamps lie inside the environment, so that deleting it starts over.
$(VENV)/.installed-base: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing muybridge into $(VENV) (a minute or two)"
	$(INSTALL) -e .
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed-base
	@echo "Installing the train and dev extras into $(VENV) (a few minutes)"
	$(INSTALL) -e ".[train,dev]"
	@scripts/ci/ensure_egl.sh $(BIN)/python
	@touch $@

$(VENV)/.installed-docs: $(VENV)/.installed-base
	@echo "Installing the docs extra into $(VENV)"
	$(INSTALL) -e ".[docs]"
	@touch $@

clean:
	rm -rf $(VENV) build dist site *.egg-info
