# make demo   rebuild a vase live on a virtual turntable; results in occ_recon_demo/
# make test   lint, types and the tests whose parts are quick, a worker more than cores
# make test-slow  the tests that take seconds each, which `make test` leaves out
# make test-all   lint, types and both
# make setup  all that the tests need, and no test
# make docs   config/rig.yaml and docs/REFERENCE.md from the declarations
# make bench  all benchmarks in their quick forms (tens of minutes), docs/BENCHMARKS.md
# All set themselves up in .venv. Another Python: make PYTHON=python3.12 test

PYTHON ?= python3
SUPPORTED := 3.10 3.11 3.12 3.13

# The one place that looks at $(PYTHON): its version, or the words for what is wrong.
VERSION := $(shell $(PYTHON) -c 'import ensurepip, sys, venv; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
FOUND := $(or $(VERSION),missing or without its venv module)

# Type checks need NumPy's own types, and the last NumPy for Python 3.10 has only coarse ones.
COARSE_TYPES := $(if $(filter 3.10,$(VERSION)),NumPy for Python 3.10 types its results too coarsely)
TYPES = $(if $(COARSE_TYPES),echo "mypy: left out. $(COARSE_TYPES)",$(RUN) -m mypy $(if $(CI),--cache-dir=/dev/null))

VENV := .venv
RUN := $(VENV)/bin/python
TESTS = $(RUN) -m pytest -n $$(($$(nproc) + 1)) --dist loadfile --no-loadscope-reorder

# The environment that make was called from may belong to another venv of ROS wheels, or to a
# sourced ROS installation: their libraries, modules and middleware are not ours.
ifdef _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport LD_LIBRARY_PATH
endif
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE AMENT_PREFIX_PATH PYTHONHOME PYTHONPATH RMW_IMPLEMENTATION
# Each of many programs would compile our modules anew.
unexport PYTHONDONTWRITEBYTECODE
# ROS logs below HOME, which a bare machine may not set.
export ROS_LOG_DIR ?= $(CURDIR)/$(VENV)/log
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

.DELETE_ON_ERROR:
.PHONY: demo setup test test-slow test-all docs bench clean python

demo: $(VENV)/cli-$(VERSION)
	$(VENV)/bin/occ-recon demo

setup: $(VENV)/test-$(VERSION)

# A worker more than cores, and the types beside: many tests wait for programs to find each other.
# What mypy would keep for the next time, a clean checkout never sees again.
# What is imported is compiled once before, and not by each of the workers.
test-all: MARKS := -m ""
test test-all: $(VENV)/test-$(VERSION)
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	@$(TYPES) & types=$$!; \
	[ -e $(VENV)/compiled ] || $(RUN) -m pytest --collect-only -qq > $(VENV)/compiled; \
	$(TESTS) $(MARKS); tests=$$?; \
	wait $$types || { echo "mypy has failed: see above"; exit 1; }; exit $$tests

test-slow: $(VENV)/test-$(VERSION)
	$(TESTS) -m slow

docs: $(VENV)/test-$(VERSION)
	$(RUN) -m occ_recon_ros.nodes.rig_yaml > config/rig.yaml
	$(RUN) docs/reference.py > docs/REFERENCE.md
	$(RUN) docs/window.py > docs/window.svg

bench: $(VENV)/bench-$(VERSION)
	$(RUN) benchmarks/all.py

clean:
	rm -rf $(VENV) build dist install log *.egg-info

# Of 6,000 files most are never imported: what is gets compiled then. Stamps carry the Python version, so that another PYTHON starts a new venv, and depend on
# setup.py, so that a change of the requirements is installed.
$(VENV)/cli-$(VERSION) $(VENV)/test-$(VERSION) $(VENV)/bench-$(VERSION): $(VENV)/%-$(VERSION): $(VENV)/python-$(VERSION) setup.py
	@echo "Installing the package and what '$*' needs into $(VENV) (minutes the first time)"
	$(RUN) -m pip install -qq --disable-pip-version-check --no-compile --editable ".[$*]"
	@touch $@

$(VENV)/python-$(VERSION): | python
	$(PYTHON) -m venv --clear $(VENV)
	@touch $@

python:
	@$(if $(filter $(SUPPORTED),$(VERSION)),:,echo "make: CPython 3.10 to 3.13 with venv is needed, but $(PYTHON) is $(FOUND); name another: make PYTHON=python3.12 $(or $(MAKECMDGOALS),demo)" >&2; exit 1)
