# Everything that CI does, anybody can do: make check, make test, make demo.

PYTHON ?= $(firstword $(shell command -v python3.11 python3.12 python3.13 python3))
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
# Many tests wait for processes that they started: three at a time keep two cores busy.
TEST_WORKERS ?= 3
# What is installed: readygo without extras, what the commands need, or what developers need as well.
BASE := $(VENV)/.base
RUNTIME := $(VENV)/.runtime
DEV := $(VENV)/.dev
# One numba and BLAS thread per process: the work is parallel by processes.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export NUMBA_NUM_THREADS := 1
# Byte code is kept, whatever the environment says: the tests start many processes, each of which would compile all modules.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test check mutants bench golden docs setup kernels

demo: $(RUNTIME)  ## Run the whole job on the embedded scene; writes demo/report.html and demo/episode.webm
	$(BIN)/readygo demo

test: $(DEV) kernels  ## Run all tests, the longest files first; kernels are compiled before; the slowest 20 are named
	$(BIN)/pytest -n $(TEST_WORKERS) --dist loadfile --no-loadscope-reorder --durations=20 --durations-min=1

check: $(DEV)  ## Style, types, import rules, plain words, and a test for every module
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/large_files.py
	$(BIN)/python tests/mirror.py
	$(BIN)/python tests/plain_words.py

mutants: $(DEV)  ## Change the lines that the branch changed, one at a time, and name the changes that no test notices
	$(BIN)/python -m tests.mutants --baseline tests/mutants/baseline.json

bench: $(RUNTIME)  ## Measure rendering, motion, planning and data on this machine
	$(BIN)/python -m readygo.benchmarks

golden: $(DEV)  ## Rewrite the golden files of the tests
	$(BIN)/pytest --update-golden

docs: $(DEV)  ## Write site/index.html: guides, commands, messages and the reference of the public names; links are checked
	$(INSTALL) -e ".[docs]"
	$(BIN)/mkdocs build --quiet
	$(BIN)/pdoc readygo --docformat google --output-directory site/reference
	$(BIN)/python tests/site_links.py site

setup: $(DEV)

# Kernels are compiled while the large packages of the extras are fetched, readygo itself being there; what fails, the
# first command does.
$(RUNTIME): $(BASE)
	@$(BIN)/readygo warm 2>$(VENV)/warm.log & $(INSTALL) "readygo[train]"; status=$$?; wait; exit $$status
	@touch $(RUNTIME)

$(DEV): $(BASE)
	$(INSTALL) "readygo[all,dev]"
	@touch $(RUNTIME) $(DEV)

# Needs no extra: `make -j 2` compiles while it installs them.
kernels: $(BASE)
	$(BIN)/readygo warm --states

$(BASE): pyproject.toml constraints.txt | $(VENV)
	$(INSTALL) -e .
	@touch $(BASE)

$(VENV):
	@test -n "$(PYTHON)" || { echo "readygo needs Python 3.11 or newer; name it with make PYTHON=..."; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) --upgrade pip
