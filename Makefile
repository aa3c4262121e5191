# Two commands do everything: `make demo` runs the main job, `make test` runs the tests. Each command
# creates the environment in .venv first if it is not there, or if what it should hold has changed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
OPENCV_4 := 4.14.0.94
# Each file's tests share what they make; the files begin in the order of tests/conftest.py.
PARALLEL := -n auto --dist loadfile --no-loadscope-reorder
# What was compiled is kept: the first that imports a module compiles it for all others.
unexport PYTHONDONTWRITEBYTECODE
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

.DEFAULT_GOAL := help
.PHONY: help install demo test coverage lint format docs results release clean

help: ## Show what can be made
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-9s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: $(STAMP) ## Create .venv and install cablecast into it

demo: $(STAMP) ## Some casts, a fit, a model, then casts at three targets with cable_1, into runs/demo-cable_1
	@# Status 3 says that a target was missed by all tries.
	$(BIN)/cablecast aim --target 1.05 10 --target 0.95 -8 --target 1.1 16.7 --tries 3 \
	  --out runs/demo-cable_1 || [ $$? -eq 3 ]

test: $(STAMP) ## Run the tests
	$(BIN)/python -m pytest $(PARALLEL)

coverage: $(STAMP) ## Run the tests and report the lines that none of them runs
	$(BIN)/python -m pytest $(PARALLEL) --cov --cov-report=term --cov-report=html:build/coverage

lint: $(STAMP) ## Check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

format: $(STAMP) ## Rewrite the code in the house style
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

docs: $(STAMP) ## Build the pages and the API reference into site/
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

results: $(STAMP) ## Write tables and figures of README and docs anew from benchmarks/results
	$(BIN)/python -m benchmarks pages

release: $(STAMP) ## Build the distributions into build/dist and check them
	$(BIN)/python tools/check_release.py

clean: ## Remove the environment and what was built; runs/ stays
	rm -rf $(VENV) build site

# The stamp is written last, so an interrupted installation is taken up again.
$(STAMP): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { \
	  echo "cablecast needs Python 3.11 or newer: $(PYTHON) was not found." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "cablecast needs Python 3.11 or newer: $(PYTHON) is $$($(PYTHON) -V)." >&2; \
	  echo "Name another one: make PYTHON=python3.11 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) cannot create virtual environments: ensurepip is missing." >&2; \
	  echo "On Debian and Ubuntu: sudo apt install python3-venv, then run make again." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PIP_INSTALL) -c constraints.txt --editable '.[all,dev,docs]'
	@# The tests of tags and boards run with the other major version of OpenCV, too.
	$(PIP_INSTALL) --no-deps --upgrade --target $(VENV)/opencv-4 \
	  opencv-python-headless==$(OPENCV_4)
	@touch $(STAMP)
