# `make help` lists the targets. Everything lives in .venv, made from python3 and pip alone.
PYTHON ?= python3
VENV := .venv
NOBLE := .venv-noble
# Ubuntu 24.04 has Python 3.12; its library versions have wheels for 3.10 to 3.12. A python may be
# on the path and yet not run (version managers), hence the try.
NOBLE_PYTHON ?= $(firstword $(foreach p,python3.12 python3 python3.11 python3.10,$(shell \
	$(p) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 13))' 2>/dev/null && echo $(p))))
# More arguments for pytest: make test PYTEST_ARGS="-k camera"
PYTEST_ARGS ?=
# A file of tests runs in one of three processes, since nodes and their tests wait for each other;
# to debug: make test PYTEST_ARGS="-n 0 --pdb -k camera"
TEST_ALL := -m "not slow" -n 3 --dist loadfile
# One thread a process: the tests' many small matrices gain nothing from more.
export OPENBLAS_NUM_THREADS := 1

# A sourced ROS workspace or another venv must not leak into this one.
ifneq ($(ROS_DISTRO)$(AMENT_PREFIX_PATH)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
unexport LD_LIBRARY_PATH
endif
unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH PYTHONPATH PYTHONHOME
unexport RMW_IMPLEMENTATION ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION VIRTUAL_ENV
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE

PEERS := requirements/bench.txt
INPUTS := setup.py setup.cfg pyproject.toml $(filter-out $(PEERS),$(wildcard requirements/*.txt))

.PHONY: help venv demo test test-slow test-explore test-faults bench-ros soak test-noble bench lint params docs pictures clean clean-venv
.DEFAULT_GOAL := help

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

venv: $(VENV)/.ready ## make .venv with the real rclpy and all commands in .venv/bin
demo: venv ## a simulated flight past the real nodes; error table and a report with pictures
	$(VENV)/bin/horizon_demo
test: venv ## all tests but the slow ones; lint, types and a colcon build are among them
	$(VENV)/bin/python -m pytest $(TEST_ALL) $(PYTEST_ARGS)
test-slow: venv ## the slow tests
	$(VENV)/bin/python -m pytest -m slow $(PYTEST_ARGS)
test-noble: $(NOBLE)/.ready ## the same tests with the library versions of Ubuntu 24.04
	$(NOBLE)/bin/python -m pytest $(TEST_ALL) $(PYTEST_ARGS)
test-explore: venv ## the property tests with examples drawn anew
	$(VENV)/bin/python -m pytest -m hypothesis --hypothesis-profile explore $(PYTEST_ARGS)
test-faults: venv ## every fault ten times over
	$(VENV)/bin/python -m pytest test/ros/scenarios/test_faults.py --count 10 $(PYTEST_ARGS)
bench: $(VENV)/.peers ## the benchmark tables, beside other people's registrations
	$(VENV)/bin/python benchmarks/run.py
bench-ros: venv ## the live node beside a bare subscriber: latency, losses, load, start-up
	$(VENV)/bin/python benchmarks/ros_latency.py
soak: venv ## a million pairs and clouds: memory and handles (half an hour)
	$(VENV)/bin/python benchmarks/soak.py
lint: venv ## ruff and mypy
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
params: venv ## write config/params.yaml and doc/parameters.md from the declared parameters
	$(VENV)/bin/python doc/write_parameters.py
docs: venv ## the pages of doc/ as HTML, build/docs/index.html
	$(VENV)/bin/sphinx-build -q -W --keep-going -b html doc build/docs
	@echo "build/docs/index.html"
pictures: venv ## draw the documentation's pictures anew
	$(VENV)/bin/python doc/make_pictures.py
clean: clean-venv ## remove what the other targets made
	rm -rf demo_output bench_output
clean-venv: ## remove environments, builds and caches; results stay
	rm -rf $(VENV) $(NOBLE) build install log *.egg-info
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find horizon_sensor_ros benchmarks test -name __pycache__ -type d -prune -exec rm -rf {} +

# make_venv,DIRECTORY,PYTHON,ARGUMENTS OF PIP
# The stamp is written last and removed first: a venv without one was interrupted and starts anew.
# The second form of creation is for Debian's python3 without python3-venv.
define make_venv
	@$(2) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
		|| { echo "$(2) does not run or is older than Python 3.10: set PYTHON=..."; exit 1; }
	@if [ -e $(1)/.ready ]; then rm $(1)/.ready; else rm -rf $(1); fi
	@[ -d $(1) ] || { echo "Making $(1)"; $(2) -m venv $(1) >/dev/null 2>&1; } \
		|| { $(2) -m venv --clear --without-pip $(1) \
			&& $(2) -m pip -q --python $(1)/bin/python install pip; }
	@echo "Installing the libraries into $(1) (about 700 MB; a minute or two)"
	@$(1)/bin/python -m pip install -q --disable-pip-version-check $(3)
	@PYTHONWARNINGS=ignore $(1)/bin/python -m pip install -q --disable-pip-version-check \
		--no-deps --no-build-isolation --use-pep517 --editable .
	@touch $(1)/.ready
endef

$(VENV)/.ready: $(INPUTS)
	$(call make_venv,$(VENV),$(PYTHON),-r requirements/dev.txt)

# One by one: a peer that has no wheel for this Python is left out, and the tables say so.
$(VENV)/.peers: $(VENV)/.ready $(PEERS)
	@echo "Installing the benchmark's peers into $(VENV) (about 600 MB)"
	@grep -v '^#' $(PEERS) | while read -r peer; do \
		$(VENV)/bin/python -m pip install -q --disable-pip-version-check "$$peer" \
			|| echo "$$peer cannot be installed; its rows are left out"; \
	done
	@touch $@

$(NOBLE)/.ready: $(INPUTS)
	@[ -n "$(NOBLE_PYTHON)" ] || { echo "test-noble needs a Python 3.10 to 3.12"; exit 1; }
	$(call make_venv,$(NOBLE),$(NOBLE_PYTHON),-r requirements/dev.txt -c requirements/noble.txt)
