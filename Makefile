# make run     sets up and runs the main job in the simulated cell
# make test    sets up and passes the tests
# make docs    builds docs/_build/html
# make mcap    adds what `a465 export --format mcap` needs
# make basler  adds what a Basler camera needs (pypylon, 85 MB)
VENV := .venv
# A Python with pip: the one of VENV has none, and may be the first that is found if VENV is active.
PYTHON ?= $(firstword $(wildcard $(addsuffix /python3,$(filter-out $(CURDIR)/$(VENV)/bin,$(subst :, ,$(PATH))))) python3)
BIN := $(VENV)/bin
TASK ?= scenes/task2.toml

# Exact versions for what is installed and for what builds the wheel.
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_BUILD_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
PIP := $(PYTHON) -m pip --python $(BIN)/python install --quiet

.PHONY: run test docs mcap basler lint clean

run: $(VENV)/installed
	$(BIN)/a465 run $(TASK)

test: $(VENV)/installed-test lint
	$(BIN)/pytest -n 2 --dist loadgroup

docs: $(VENV)/installed-docs
	$(BIN)/sphinx-build -W --keep-going --quiet docs docs/_build/html
	@echo "docs/_build/html/index.html"

mcap: $(VENV)/installed
	$(PIP) --editable '.[mcap]'

basler: $(VENV)/installed
	$(PIP) --editable '.[basler]'

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(VENV)/bin/python:
	$(PYTHON) -m venv --without-pip $(VENV)

$(VENV)/installed: $(VENV)/bin/python pyproject.toml constraints.txt
	@echo "installing a465 into $(VENV) (once)"
	$(PIP) --editable .
	@touch $@

$(VENV)/installed-test: $(VENV)/installed
	@echo "installing what the tests need into $(VENV) (once)"
	$(PIP) --editable '.[test]'
	@touch $@

$(VENV)/installed-docs: $(VENV)/installed
	@echo "installing what builds the documentation into $(VENV) (once)"
	$(PIP) --editable '.[docs]'
	@touch $@

clean:
	rm -rf $(VENV) runs docs/_build docs/api
