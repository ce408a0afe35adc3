# Everything that CI does, anybody can do: make check, make test, make demo.

PYTHON ?= $(firstword $(shell command -v python3.11 python3.12 python3.13 python3))
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# One numba and BLAS thread per process: the work is parallel by processes.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export NUMBA_NUM_THREADS := 1

.PHONY: demo test check bench golden setup

demo: setup  ## Run the whole job on the embedded scene; writes demo/report.html and demo/episode.mp4
	$(BIN)/readygo demo

test: setup  ## Run all tests
	$(BIN)/pytest

check: setup  ## Style, types, import rules, and a test for every module
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/large_files.py
	$(BIN)/python tests/mirror.py

bench: setup  ## Measure rendering, motion, planning and data on this machine
	$(BIN)/python -m readygo.benchmarks

golden: setup  ## Rewrite the golden files of the tests
	$(BIN)/pytest --update-golden

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "readygo needs Python 3.11 or newer; name it with make PYTHON=..."; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip -c constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[all,dev]"
	@touch $(STAMP)
