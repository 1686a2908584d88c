# make demo   set up, build the FMUs, fly the paper's scenario, leave its figures in out/line5
# make test   set up, build the FMUs, then lint, types, import contracts and all tests
# make fmus   build the FMUs that changed into fmus/

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
COSIM := $(BIN)/uav-cosim

.PHONY: demo test fmus lint clean

demo: fmus
	$(COSIM) run master/systems/line5 -o out/line5
	$(COSIM) plot out/line5

fmus: $(VENV)/installed
	$(COSIM) build -o fmus

test: $(VENV)/tested fmus lint
	$(BIN)/python -m pytest -m 'not alone' -n auto --dist loadfile
	$(BIN)/python -m pytest -m alone

lint: $(VENV)/tested
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed (PYTHON=... make)")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

$(VENV)/tested: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,clients]'
	touch $@

clean:
	rm -rf out fmus/*.fmu
