# SPDX-License-Identifier: Apache-2.0
# What a first-time user and a developer run. All of it happens in virtual environments in this folder, with ROS 2 Jazzy
# from PyPI; with a system's ROS 2 use colcon (see README).
#
#   make PYTHON=python3.12 ...   another Python for .venv (after make clean)
#   make EXTRAS=test test        without ROS 2 and Dask: what needs them is left out, and said so
#   CI=true make setup           exactly what requirements/ci.txt has locked, all of it, whatever EXTRAS says

PYTHON ?= python3
PYTHON310 ?= python3.10
EXTRAS ?= jazzy,plant,test
VENV ?= .venv
HUMBLE ?= .venv-humble
PY := $(VENV)/bin/python
LOCK := requirements/ci.txt
LOCKED := jazzy,plant,test,lint,colcon,docs
PACKAGING := setup.py setup.cfg pyproject.toml package.xml resource $(wildcard config launch config/* launch/*)

ifeq ($(CI),true)
PACKAGING += $(LOCK)
endif

# colcon's --symlink-install copies with setuptools 80; below 70.1 setuptools needs the package wheel.
SETUPTOOLS := 'setuptools>=70.1,<80'

# Tests of the core, and those that hold documents and layers to the code.
QUICK := $(addprefix test/, device model test_layers.py test_package.py test_documents.py charts \
	commands/test_help.py recording/test_mapping.py recording/test_roles.py recording/test_writer.py \
	identification/test_levenberg.py identification/test_loop.py identification/test_motion.py)

# A sourced ROS 2 would mix its rclpy and its libraries with those of .venv.
ifdef AMENT_PREFIX_PATH
unexport PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION RMW_IMPLEMENTATION
endif
# Set by the start-up hook of ROS 2's wheels where one of their programs runs make; it would disable ours.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: help setup test test-long check properties fuzz crash soak mistakes measured-runs coverage demo benchmark speed-document benchmark-effects benchmark-laws benchmark-foreign benchmark-hold monitor-figures planning-document layouts interface-document effects-document tutorial-picture path-picture example-pages notebook site kernel prose lint format lock licences sbom colcon test-humble clean
.DELETE_ON_ERROR:

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 26

setup: $(VENV)/.ready  ## make .venv with all that is needed

test: $(VENV)/.ready  ## run the tests; ARGS='-k name' goes to pytest
	@$(PY) -c 'import rclpy' || test '$(findstring jazzy,$(EXTRAS))' = ''
	$(PY) -m pytest $(ARGS)

test-long: $(VENV)/.ready  ## run the tests that are left out as they take long
	$(PY) -m pytest -m 'long or slow' $(ARGS)

check: lint  ## style, types and the tests that a change usually needs: 2 minutes
	$(PY) -m pytest --numprocesses 2 --dist loadfile $(QUICK) $(ARGS)

properties: $(VENV)/.ready  ## run the property tests on random examples, twice as many
	$(PY) -m pytest -m hypothesis --hypothesis-profile=random $(ARGS)

fuzz: $(VENV)/.ready $(VENV)/.with-fuzz  ## change valid inputs at random, and see what readers and nodes make of them; 2 minutes
	$(PY) -m studies.trials.fuzz $(ARGS)

measured-runs: $(VENV)/.ready  ## identify each measured run, write docs/measurements/measured_runs.md; a quarter of an hour
	$(PY) -m studies.documents.measured_runs

coverage: $(VENV)/.ready  ## how often intervals hold the truth, write docs/measurements/coverage.md; half an hour
	$(PY) -m studies.documents.coverage $(ARGS)

crash: $(VENV)/.ready  ## kill programs at each call that changes a name, and fill their disk; needs strace; 20 minutes
	$(PY) -m studies.trials.crashes $(ARGS)

soak: $(VENV)/.ready  ## run all nodes at 1 kHz with whatever may happen to them; ARGS='--hours 2'
	$(PY) -m studies.trials.soak $(ARGS)

mistakes: $(VENV)/.ready  ## make each mistake that users make, write docs/measurements/mistakes.md; 15 minutes
	$(PY) -m studies.trials.mistakes $(ARGS)

demo: $(VENV)/.ready  ## run the device and its simulator, record them, identify the recording
	@$(PY) -m studies.demo $(ARGS)

benchmark: $(VENV)/.ready $(VENV)/.with-benchmark  ## time simulation, fit, reading and sim_node against their peers
	@mkdir -p build
	$(PY) -m pytest benchmark --benchmark-json=build/benchmark.json $(ARGS)

speed-document: $(VENV)/.with-benchmark  ## write docs/measurements/speed.md of what make benchmark has measured
	$(PY) -m studies.documents.speed $(ARGS)

benchmark-laws: $(VENV)/.ready  ## draw laws that no library has; ARGS='--seeds 1' for a quarter of an hour
	$(PY) -m studies.panel.laws $(ARGS)

benchmark-effects: $(VENV)/.ready $(VENV)/.with-benchmark  ## how often the right effect is named: hours; ARGS=--quick 10 minutes
	$(PY) -m studies.panel.benchmark_effects $(ARGS)

benchmark-foreign: $(VENV)/.ready  ## identify devices with other equations, write docs/measurements/foreign.md; 20 minutes
	$(PY) -m studies.foreign.benchmark_foreign --output docs/measurements/foreign.md $(ARGS)

benchmark-hold: $(VENV)/.ready  ## predict and hold the force on 40 devices, write docs/hold.md; more than an hour
	$(PY) -m studies.hold.benchmark_hold $(ARGS)

monitor-figures: $(VENV)/.ready $(VENV)/.with-benchmark  ## false alarms of the watch over a device: an hour
	$(PY) -m studies.documents.monitor_figures $(ARGS)

planning-document: $(VENV)/.ready $(VENV)/.with-benchmark  ## write docs/measurements/planning.md: plans beside what the rig then gives, 2 minutes
	$(PY) -m studies.documents.planning

interface-document: $(VENV)/.ready  ## write docs/reference/interface.md, docs/reference/mapping.md, and the pages of --help
	$(PY) -m studies.documents.interface

effects-document: $(VENV)/.ready  ## write docs/reference/effects.md: every effect, and how it shows on the rig; 1 minute
	$(PY) -m studies.documents.effects

tutorial-picture: $(VENV)/.ready  ## take the picture of a report in docs/tutorials/first_report.md, with Chromium
	$(PY) -m studies.documents.tutorial

path-picture: $(VENV)/.ready  ## write docs/force_on_path.svg, the picture in README.md; 1 minute
	$(PY) -m studies.documents.path_picture

example-pages: $(VENV)/.ready  ## write a page of each kind, with screenshots, to build/example_pages; 5 minutes
	$(PY) -m studies.documents.example_pages build/example_pages

notebook: $(VENV)/.ready  ## write docs/tutorials/python.ipynb of docs/tutorials/python.md, executed
	$(PY) -m studies.documents.notebook

site: $(VENV)/.ready $(VENV)/.with-docs  ## build the documentation site in build/site, for use without network; 1 minute
	$(PY) -m studies.documents.site

layouts: $(VENV)/.ready  ## write the layouts for PlotJuggler and Foxglove in config/; after a change of topics
	$(PY) -m studies.documents.layouts

kernel: $(VENV)/.with-lint  ## put the effects together into one kernel; after a change to any of them
	$(PY) -m cfd_pneumatic.generator
	$(PY) -m ruff format --quiet cfd_pneumatic/model/composed.py

prose: $(VENV)/.ready  ## check names, texts and pages against the style guide, and print how readable each page is
	$(PY) -m studies.tools.prose

lint: $(VENV)/.with-lint  ## check style, types, names, texts and pages
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m ament_flake8.main --config setup.cfg .
	$(PY) -m studies.tools.prose

format: $(VENV)/.with-lint  ## put the code into the common style
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

lock: $(VENV)/.ready  ## write requirements/ci.txt, what CI installs, by version and hash; with Python 3.11
	$(PY) -m studies.tools.lock $(SETUPTOOLS) --editable '.[$(LOCKED)]' >$(LOCK).new && mv $(LOCK).new $(LOCK)

licences: $(VENV)/.with-lint $(VENV)/.with-colcon  ## write docs/reference/licences.md, of the packages that are locked
	$(PY) -m studies.tools.licences

sbom: $(VENV)/.with-sbom  ## write build/sbom.json, a bill of materials of .venv (CycloneDX)
	@mkdir -p build
	$(VENV)/bin/cyclonedx-py environment --output-file build/sbom.json $(VENV)

colcon: $(VENV)/.with-colcon  ## build and test as a ROS 2 workspace does
	@sh scripts/colcon.sh $(abspath $(VENV)) $(ARGS)

test-humble: $(HUMBLE)/.ready  ## run what needs no ROS with Humble's versions
	$(HUMBLE)/bin/python -m pytest $(ARGS)

clean:  ## remove the environments and caches
	rm -rf $(VENV) $(HUMBLE) build *.egg-info .benchmarks .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find cfd_pneumatic test benchmark launch studies -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true

# Stop with one line where the Python that the variable (1) names can't make an environment; (2) is 'wheels' where
# ROS 2 is to come from PyPI.
missing = $(shell sh scripts/missing.sh $(1) '$($(1))' $(2))
require = $(if $(missing),$(error $(missing)))

# Install into the environment (1) what (2) says; without isolation, so that a repetition needs no network.
install = $(1)/bin/python -m pip install -qq --disable-pip-version-check --no-build-isolation $(2) || \
	{ echo 'pip could not install the packages (see above): is PyPI within reach? Then run make again.' >&2; exit 1; }

$(VENV)/.installed: $(PACKAGING)
	@$(call require,PYTHON,$(if $(findstring jazzy,$(EXTRAS)),wheels) $(if $(filter true,$(CI)),locked))
	@echo 'Setting up $(VENV): about a minute and 800 MB, once'
	@$(VENV)/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
ifeq ($(CI),true)
	@grep '^setuptools==' $(LOCK) >$(VENV)/setuptools.txt
	@$(call install,$(VENV),--require-hashes --requirement $(VENV)/setuptools.txt)
	@# all that is needed is in the lock; asked for dependencies, pip would look for newer ones than are locked
	@$(call install,$(VENV),--no-deps --require-hashes --requirement $(LOCK))
	@$(call install,$(VENV),--no-index --editable '.[$(LOCKED)]')
else
	@$(call install,$(VENV),$(SETUPTOOLS))
	@$(call install,$(VENV),--editable '.[$(EXTRAS)]')
endif
	@touch $@

$(VENV)/.ready: $(VENV)/.installed
	@$(VENV)/bin/compile_kernels
	@touch $@

# Developers' tools, each when it is first wanted.
$(VENV)/.with-%: $(VENV)/.installed
	@$(call install,$(VENV),--editable '.[$*]')
	@touch $@

$(HUMBLE)/.ready: $(PACKAGING) requirements/humble.txt
	@$(call require,PYTHON310)
	@$(HUMBLE)/bin/python -m pip --version >/dev/null 2>&1 || $(PYTHON310) -m venv --clear $(HUMBLE)
	@$(call install,$(HUMBLE),$(SETUPTOOLS) --requirement requirements/humble.txt)
	@$(call install,$(HUMBLE),--no-deps --editable .)
	@touch $@
