# Every target makes its own virtual environment with pinned packages: a fresh machine needs only Python >= 3.11 and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PYTEST := $(BIN)/python -m pytest
DEMO_ARGS ?=
SOAK_SEED ?= 1
SOAK_SHARE ?= 1

.PHONY: demo test check soak soak-sample bench clean

$(VENV)/.installed: pyproject.toml constraints.txt
	@echo "Setting up $(VENV) (once; about a minute)"
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "circumnav_mav needs Python 3.11 or newer, this is " + sys.version.split()[0] + ". Try: make PYTHON=python3.11")'
	@$(PYTHON) -m venv $(VENV)
	@PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

$(VENV)/.peers: $(VENV)/.installed
	@echo "Adding the peers of the long suite to $(VENV) (once)"
	@PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,peers]'
	@touch $@

demo: $(VENV)/.installed  ## watch a multirotor find and circle a beacon
	@$(BIN)/circumnav demo $(DEMO_ARGS)

check: $(VENV)/.installed  ## format, lint, types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

# Pure and lockstep tests run beside each other, real-time ones afterwards and alone.
test: check  ## everything a change must pass, within eight minutes on two cores
	$(PYTEST) -n 2 -q -m "not realtime and not soak"
	$(PYTEST) -q -m "realtime and not soak"

soak: $(VENV)/.peers  ## the long suite: fuzz, randomised flights, 1,000-run rows, real peers
	SOAK_SEED=$(SOAK_SEED) SOAK_SHARE=$(SOAK_SHARE) $(PYTEST) -n 2 -q -m "soak and not realtime"
	SOAK_SEED=$(SOAK_SEED) SOAK_SHARE=$(SOAK_SHARE) $(PYTEST) -q -m "soak and realtime"

soak-sample: SOAK_SHARE = 0.05
soak-sample: soak  ## soak with one twentieth of its random runs, for CI

bench: $(VENV)/.installed  ## what the receive path, the tick and the loop cost, as ratios within one run
	$(BIN)/python -m tests.bench

clean:
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
