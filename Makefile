# make demo   set up, build the FMUs of the paper's scenario, fly it, leave its figures in out/line5
# make test   set up, build the FMUs, then lint, types, import contracts and all tests
# make fmus   build the FMUs that changed into fmus/
# make docs   the documentation as a site into site/: open site/index.html
# make wheel  a wheel for this platform into dist/, with systems and FMUs
# make sdist  all sources into dist/, from which the others work

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
COSIM := $(BIN)/uav-cosim
# Modules are compiled when they are first imported; most never are.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# uv installs the packages of the tests in a sixth of pip's time. It does not read pip's settings (a mirror, a proxy's
# certificate): where it fails, its message is shown and pip goes on.
UV := $(BIN)/uv pip install --quiet --python $(BIN)/python

# Hundreds of processes import the same sources.
unexport PYTHONDONTWRITEBYTECODE

# Tests wait for processes and clocks: with one worker more than cores, all cores are busy.
# Asked of the Python at hand: make expands the lines of a rule before .venv is there.
WORKERS = $(shell $(PYTHON) -c 'import os; print((os.cpu_count() or 1) + 1)')

# Tests that wait for other programs and hardly compute; their files are named, so that no others are collected.
# Real ArduCopters compute much: with them, these tests are run behind the others instead of beside them.
ALONE = -m alone $(shell grep -rl --include='test_*.py' 'mark\.alone' tests) $(if $(ARDUPILOT_SITL),,-n 3 --dist load)

.PHONY: demo test fmus loop lint compiled-tests side-by-side alone docs wheel sdist clean

demo: $(VENV)/installed
	$(COSIM) build line5 -o fmus
	$(COSIM) run master/systems/line5 -o out/line5
	$(COSIM) plot out/line5

fmus: $(VENV)/installed
	$(COSIM) build -o fmus

# FMUs are built while the packages of tests are installed.
test:
	$(MAKE) -j 4 loop fmus lint compiled-tests
	$(MAKE) -j $(if $(ARDUPILOT_SITL),1,2) side-by-side alone

# Kernels of the loop share most of their functions, so one process compiles all of them. First, so that the build of
# FMUs, which needs `run`, too, waits for it and does not compile it.
loop: $(VENV)/installed
	$(BIN)/python -c 'from cosim_master.stepping.warming import compile_loop; compile_loop()'

# They give way to those that talk with other programs while the clock runs.
side-by-side:
	nice $(BIN)/python -m pytest -m 'not alone' -n $(WORKERS) --dist loadfile --no-loadscope-reorder

# Their report comes at their end, not between the lines of the others.
alone:
	$(BIN)/python -m pytest $(ALONE) > $(VENV)/alone 2>&1; code=$$?; cat $(VENV)/alone; exit $$code

# Once, and not by each worker.
compiled-tests: $(VENV)/tested
	$(BIN)/python -m pytest --collect-only -q > $(VENV)/collected || (cat $(VENV)/collected; exit 1)

lint: $(VENV)/tested
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed (PYTHON=... make)")'
	$(PYTHON) -m venv $(VENV)

# Not every platform has one: then pip installs all packages.
$(VENV)/uv-tried: $(VENV)/bin/python
	-$(PIP) --only-binary :all: uv
	touch $@

$(VENV)/installed: $(VENV)/uv-tried pyproject.toml
	$(UV) -e '.[build,plot]' || $(PIP) -e '.[build,plot]'
	touch $@

# Without this project, which is in use meanwhile.
$(VENV)/tested: $(VENV)/installed
	$(BIN)/python -c 'import tomllib; print(*sum(tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"].values(), []), sep="\n")' > $(VENV)/requirements
	$(UV) -r $(VENV)/requirements || $(PIP) -r $(VENV)/requirements
	touch $@

docs: $(VENV)/tested
	$(BIN)/python -m sphinx -q -W --keep-going -c docs/site -d build/docs . site

wheel: $(VENV)/installed
	rm -rf build
	$(BIN)/python -m cosim_master.system.shipped build/shipped
	$(BIN)/python -m cosim_master.stepping.warming build/compiled
	$(BIN)/python -m cosim_master.fmi.isolation.building build/compiled
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps -w dist .
	rm -rf build

sdist: $(VENV)/tested
	mkdir -p dist
	$(BIN)/python -c 'from setuptools import build_meta; build_meta.build_sdist("dist")' > /dev/null

clean:
	rm -rf out build dist site fmus/*.fmu
