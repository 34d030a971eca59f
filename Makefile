# make run     sets up and runs the main job in the simulated cell
# make test    sets up and passes the linters and the fast tests
# make test-all    the same, and the slow tests
# make docs    builds docs/_build/html
# make mcap    adds what `a465 export --format mcap` needs
# make contact adds what `a465 run --cell mujoco` needs (MuJoCo, 42 MB)
# make basler  adds what a Basler camera needs (pypylon, 85 MB)
VENV := .venv
# A Python with pip: the one of VENV has none, and may be the first that is found if VENV is active.
PYTHON ?= $(firstword $(wildcard $(addsuffix /python3,$(filter-out $(CURDIR)/$(VENV)/bin,$(subst :, ,$(PATH))))) python3)
TASK ?= scenes/realistic/task2.toml

# The path to this folder, or VENV, may hold spaces: quoted in recipes, escaped where they name targets.
BIN := "$(VENV)"/bin
SPACE := $(subst ,, )
AT := $(subst $(SPACE),\$(SPACE),$(VENV))

# Exact versions for what is installed and for what builds the wheel. Relative: pip splits these at spaces.
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
PIP := "$(PYTHON)" -m pip --python $(BIN)/python install --quiet

# One process more than a small computer has processors: tests of ports and clocks wait. What Python compiles is kept in VENV,
# whatever the environment says: each test process, and each command that tests start, would compile everything again.
# BLAS gets one thread: matrices are small, and the threads of all test processes would spin beside each other.
# Groups of tests begin in the order of collection, which is that of files with the long tests first.
PYTEST = env -u PYTHONDONTWRITEBYTECODE OPENBLAS_NUM_THREADS=1 PYTHONPYCACHEPREFIX="$$(cd "$(VENV)" && pwd)"/pycache $(BIN)/pytest
IN_GROUPS := --dist loadgroup --no-loadscope-reorder

# $(call require_version,PYTHON): the oldest that pyproject.toml allows, told before pip looks for libraries in vain.
require_version = @"$(1)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	{ echo "a465 needs Python 3.11 or later, and $(1) is $$("$(1)" --version 2>&1); give another: make PYTHON=python3.11$(2)"; \
	exit 2; }

.PHONY: run test test-all docs mcap contact basler lint clean

run: $(AT)/installed
	$(BIN)/a465 run $(TASK)

test: $(AT)/installed-test lint
	$(PYTEST) -n 3 $(IN_GROUPS) -m "not slow"

# Slow tests wait longer than they compute, for ports, clocks, browsers and commands: six of them keep two processors busy.
test-all: test
	$(PYTEST) -n 6 $(IN_GROUPS) -m slow

docs: $(AT)/installed-docs
	$(BIN)/sphinx-build -W --keep-going --quiet docs docs/_build/html
	@echo "docs/_build/html/index.html"

mcap: $(AT)/installed
	$(PIP) --editable '.[mcap]'

contact: $(AT)/installed
	$(PIP) --editable '.[contact]'

basler: $(AT)/installed
	$(PIP) --editable '.[basler]'

lint: $(AT)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(AT)/bin/python:
	$(call require_version,$(PYTHON))
	"$(PYTHON)" -m venv --without-pip "$(VENV)"

$(AT)/installed: $(AT)/bin/python pyproject.toml constraints.txt
	$(call require_version,$(VENV)/bin/python,; and remove $(VENV))
	@echo "installing a465 into $(VENV) (once)"
	$(PIP) --editable .
	@touch "$@"

# a465 too, as one pip takes less time than two. All processors compile the libraries; pip would use one. What does not compile is
# left, as pip leaves it.
$(AT)/installed-test: $(AT)/bin/python pyproject.toml constraints.txt
	$(call require_version,$(VENV)/bin/python,; and remove $(VENV))
	@echo "installing a465 and what the tests need into $(VENV) (once)"
	$(PIP) --no-compile --editable '.[test]'
	@$(BIN)/python -m compileall -qq -j 0 "$(VENV)"/lib || true
	@$(PYTEST) --collect-only --quiet >/dev/null || true
	@touch "$(VENV)"/installed "$@"

$(AT)/installed-docs: $(AT)/installed
	@echo "installing what builds the documentation into $(VENV) (once)"
	$(PIP) --editable '.[docs]'
	@touch "$@"

clean:
	rm -rf "$(VENV)" runs docs/_build docs/api
