# Needs make and Python 3.11 to 3.13; everything else is installed into .venv. `make PYTHON=/path/to/python` chooses one.

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
CANDIDATES := $(or $(PYTHON),python3.13 python3.12 python3.11 python3)
JOBS ?= 2

# Small matrices: more BLAS threads only wait for each other on a busy machine.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test check coverage lint type bench cases docs dist clean
.DELETE_ON_ERROR:

demo: $(VENV)/.report
	$(BIN)/asyneio demo -o results/demo

test: lint type
	$(BIN)/python -m pytest -n $(JOBS) $(PYTEST)

# Under two minutes: what to run before each commit.
check: lint type
	$(BIN)/python -m pytest -n $(JOBS) -m "not slow and not data and not browser" $(PYTEST)

# Python's view of compiled kernels: with compilation off, and without the tests that need compiled speed.
coverage: $(VENV)/.test
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n $(JOBS) -m "not slow and not data and not browser" \
	    --timeout 1200 --cov --cov-report term:skip-covered --cov-report xml $(PYTEST)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

type: $(VENV)/.test
	$(BIN)/mypy

bench: $(VENV)/.test
	$(BIN)/python benchmarks/run.py

cases: $(VENV)/.test
	$(BIN)/python benchmarks/cases.py $(CASES)

docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@! grep -rnoE --include='*.html' '<(script|img|link|iframe)[^>]+(src|href)="(https?:)?//[^"]*"' site \
	    || { echo "These pages need the network; see mkdocs.yml." >&2; exit 1; }
	@echo "Open site/index.html"

dist: $(VENV)/.dist
	rm -rf dist
	$(BIN)/python -m build --installer pip . >/dev/null
	$(BIN)/twine check --strict dist/*

clean:
	rm -rf $(VENV) site build dist results .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# Stamps: the second call finds them newer than pyproject.toml and goes straight to work.
$(VENV)/.report: $(VENV)/.created pyproject.toml
	@echo "Installing asyneio and matplotlib into $(VENV) (once, some minutes on a slow network) ..."
	$(PIP) install --editable '.[report]'
	@touch $@

$(VENV)/.test: $(VENV)/.created pyproject.toml
	@echo "Installing asyneio and the test tools into $(VENV) (once, some minutes on a slow network) ..."
	$(PIP) install --editable '.[test]'
	@touch $@ $(VENV)/.report

$(VENV)/.docs: $(VENV)/.created pyproject.toml
	@echo "Installing the documentation tools into $(VENV) (once) ..."
	$(PIP) install --editable '.[docs]'
	@touch $@

$(VENV)/.dist: $(VENV)/.created pyproject.toml
	@echo "Installing the packaging tools into $(VENV) (once) ..."
	$(PIP) install --editable '.[dist]'
	@touch $@

# Debian and Ubuntu split venv off Python: then virtualenv serves, or the missing package is fetched where we may.
$(VENV)/.created:
	@set -eu; \
	python=; \
	for candidate in $(CANDIDATES); do \
	    if "$$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; then \
	        python=$$candidate; break; \
	    fi; \
	done; \
	if [ -z "$$python" ]; then \
	    echo "No Python 3.11 to 3.13 among: $(CANDIDATES) (python3 is $$(python3 --version 2>&1 | head -n 1))." >&2; \
	    echo "Install one (Debian 12 or newer, Ubuntu 24.04 or newer: apt-get install python3 python3-venv)," >&2; \
	    echo "or name it: make PYTHON=/path/to/python3.12" >&2; \
	    exit 1; \
	fi; \
	create() { rm -rf $(VENV); "$$@" $(VENV) >/dev/null 2>&1 && $(BIN)/python -m pip --version >/dev/null 2>&1; }; \
	fetch() { \
	    package=$$("$$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	    [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null || return 1; \
	    echo "This Python lacks venv; installing $$package ..."; \
	    export DEBIAN_FRONTEND=noninteractive; \
	    apt-get install -y -qq "$$package" >/dev/null 2>&1 \
	        || { apt-get update -qq && apt-get install -y -qq "$$package"; } >/dev/null 2>&1; \
	}; \
	echo "Creating $(VENV) with $$("$$python" --version) ..."; \
	create "$$python" -m venv \
	    || create "$$python" -m virtualenv \
	    || create virtualenv --python "$$python" \
	    || { fetch && create "$$python" -m venv; } \
	    || { rm -rf $(VENV); \
	         echo "Could not create a virtual environment: $$python has no working venv module." >&2; \
	         echo "Cure on Debian and Ubuntu: sudo apt-get install python3-venv; then run make again." >&2; \
	         exit 1; }; \
	touch $@
