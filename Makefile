# Every target sets itself up from PyPI alone; no virtual environment has to be made or activated before.
#   make demo [INPUT=<frames folder or bag>] [ARGS="--color-topic /x"]   make test   make install
#   check bench fuzz soak oldest clean

PYTHON ?= python3
VENV   ?= .venv
INPUT  ?=
ARGS   ?=

SHELL  := /bin/bash
BIN    := $(abspath $(VENV))/bin
STAMP  := $(VENV)/.installed
PIP    := $(BIN)/python -m pip --disable-pip-version-check

# The ROS wheels exist for Linux on x86-64 only. Elsewhere everything but the node works.
PLATFORM := $(shell uname -s)-$(shell uname -m)
ifeq ($(PLATFORM),Linux-x86_64)
EXTRAS := all
else
EXTRAS := offline
endif

# The environment of every process that we start. A sourced /opt/ros must not mix with the wheels.
export AMENT_PREFIX_PATH := $(abspath $(VENV))
export FASTRTPS_DEFAULT_PROFILES_FILE ?= $(wildcard $(CURDIR)/config/fastdds.xml)
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
# One domain per checkout, 1..100, so that two of them side by side stay apart
export ROS_DOMAIN_ID ?= $(shell echo $$(( $$(printf '%s' '$(CURDIR)' | cksum | cut -d' ' -f1) % 100 + 1 )))
export ROS_LOG_DIR ?= $(CURDIR)/log/ros
# Kernels are one-threaded by design
export NUMBA_NUM_THREADS ?= 1
unexport PYTHONPATH PYTHONHOME LD_LIBRARY_PATH

.PHONY: install demo test check browser bench fuzz soak oldest clean

install: $(STAMP)

# Editable: the sources are the installed package. The files that pip copies (share, lib) are prerequisites.
$(STAMP): setup.py setup.cfg pyproject.toml package.xml constraints.txt $(wildcard config/* launch/* resource/* resource/lib/*)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and \
	  f"Python is {sys.version.split()[0]}; 3.10 or newer is needed (make PYTHON=python3.12)")'
	@[ $(EXTRAS) = all ] || echo "No ROS wheels exist for $(PLATFORM): installing everything but the node (extra: ros)."
	@[ -x $(BIN)/python ] || $(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "python3 -m venv failed; on Debian and Ubuntu: apt install python3-venv"; exit 1; }
	@echo "Installing into $(VENV) (a few minutes the first time)"
	@$(PIP) install --quiet --constraint constraints.txt pip setuptools wheel
	@PYTHONWARNINGS=ignore $(PIP) install --quiet --no-build-isolation --constraint constraints.txt --editable '.[$(EXTRAS)]'
	@touch $@

demo: $(STAMP)
	@$(BIN)/room-layout demo $(if $(INPUT),--input '$(INPUT)') $(ARGS)

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

test: check browser
	$(BIN)/python -m pytest $(PYTEST_ARGS)

# The dashboard's page is tested in a browser. Where there is none and we are root, Debian's is installed; else that test is
# skipped. Only the fetching has a deadline: an installation that is cut off would have to be repaired.
APT := env DEBIAN_FRONTEND=noninteractive apt-get -qq -y --no-install-recommends -o DPkg::Lock::Timeout=60
browser:
	@if command -v chromium google-chrome >/dev/null || [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then exit 0; fi; \
	log=$$(mktemp); trap 'rm -f "$$log"' EXIT; \
	echo "Installing chromium by apt-get, which the test of the dashboard's page needs (once, about 20 s)"; \
	{ timeout 60 $(APT) update; timeout 180 $(APT) --download-only install chromium && $(APT) install chromium; } \
	  </dev/null >"$$log" 2>&1 || { why=$$(tail -n 1 "$$log"); \
	  echo "chromium could not be installed, the test of the dashboard's page is skipped: $${why:-not fetched in 3 minutes}"; }

bench: $(STAMP)
	$(BIN)/python -m benchmarks

fuzz: $(STAMP)
	$(BIN)/python -m pytest -m fuzz $(PYTEST_ARGS)

soak: $(STAMP)
	$(BIN)/python -m pytest -m soak $(PYTEST_ARGS)

# The versions of Ubuntu 24.04: all without ROS and without Rerun, which needs NumPy 2. For one Python, 3.11: numba 0.58
# has no wheel for a newer one, and some of what the pins pull in none for an older one.
oldest: .venv-oldest/.installed
	AMENT_PREFIX_PATH= .venv-oldest/bin/python -m pytest -m "not dds" $(PYTEST_ARGS)

.venv-oldest/.installed: setup.py constraints-oldest.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11) and \
	  f"Python is {sys.version.split()[0]}; the pins of constraints-oldest.txt are for 3.11 (make oldest PYTHON=python3.11)")'
	@[ -x .venv-oldest/bin/python ] || $(PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/python -m pip install --quiet --constraint constraints-oldest.txt pip setuptools wheel
	PYTHONWARNINGS=ignore .venv-oldest/bin/python -m pip install --quiet --no-build-isolation --constraint constraints-oldest.txt \
	  --editable '.[test,playback,datasets,train]' matplotlib pillow plotly
	@touch $@

clean:
	rm -rf build install log out dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .venv-oldest
	find . -path './.venv*' -prune -o -name __pycache__ -type d -print0 | xargs -0 rm -rf
