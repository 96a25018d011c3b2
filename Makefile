# Every target sets up what it needs in .venv by itself. PYTHON=... chooses the interpreter (3.11 or later).
SHELL := /bin/sh
PYTHON ?=
BIN := .venv/bin
READY := .venv/.ready
READY_BENCH := .venv/.ready-bench
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

.DEFAULT_GOAL := help
.PHONY: help demo test check test-all bench results clean

help:
	@echo "make demo        locate the space station from its own photos; results in out/iss_photos"
	@echo "make test        run the tests (below 5 minutes on two cores)"
	@echo "make check       formatting, lint, types, specs, layers"
	@echo "make test-all    the tests, with the slow ones"
	@echo "make results     run the tests and write the measured results into the SPEC.md files"
	@echo "make bench       side by side with Basilisk (installs bsk)"
	@echo "make clean       remove .venv and build output"
	@echo "PYTHON=python3.12 make ...   chooses the Python (3.11 or later) that .venv is made with"

demo: $(READY)
	$(BIN)/python -m sim.scenarios.iss_photos --shift-study

test: $(READY)
	$(PYTEST) -m "not slow"

test-all: $(READY)
	$(PYTEST)

results: $(READY)
	$(PYTEST) --write-results

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/fsw check --specs
	$(BIN)/python -m pytest -q tests/test_repository.py

bench: $(READY_BENCH)
	$(BIN)/python -m benchmarks

clean:
	rm -rf .venv build dist out

$(READY): pyproject.toml
	@set -e; \
	for python in "$(PYTHON)" python3 python3.14 python3.13 python3.12 python3.11 python; do \
	  [ -n "$$python" ] && "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && break; \
	  [ -n "$(PYTHON)" ] && { echo "PYTHON=$(PYTHON) is no Python 3.11 or later" >&2; exit 1; }; \
	  python=; \
	done; \
	[ -n "$$python" ] || { echo "No Python 3.11 or later found; install one, or name it: make PYTHON=/path/to/python3" >&2; exit 1; }; \
	echo "Setting up .venv with $$("$$python" --version) (once; a few minutes on a slow connection)"; \
	"$$python" -m venv .venv || { echo "Cannot make .venv; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }; \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'; \
	touch $@

$(READY_BENCH): $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	@touch $@
