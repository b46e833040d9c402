# Everything a developer types. `make demo` and `make test` need Python 3.11+, git and make, and nothing else.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check install --quiet

# The main job: voltages planned by the inverse arm, fed forward into the built-in CMU arm.
DEMO   := simulate cmu-dd --schedule examples/cmu-dd-feedforward.csv --start 0,0.35,0,0.6,0,0.4 --duration 2 \
          -o build/demo/cmu-dd.nc --plot build/demo/cmu-dd.png

# More words for pytest and the benchmark:  make test ARGS="-k pendulum", make bench ARGS=--save
ARGS   :=

.DEFAULT_GOAL := help
.PHONY: help demo test test-all check frozen fuzz bench docs reference pictures lock lowest newest release clean
.DELETE_ON_ERROR:

help:  ## print this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(VENV)/.core  ## set up the core and move the built-in CMU arm
	@mkdir -p build/demo
	$(BIN)/armwright $(DEMO)
	@echo
	@echo "result   $(CURDIR)/build/demo/cmu-dd.nc"
	@echo "picture  $(CURDIR)/build/demo/cmu-dd.png"

test: $(VENV)/.test  ## set up what the tests need and run them, but for what `make test-all` adds
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not study" $(ARGS)

test-all: $(VENV)/.all  ## run what `make test` leaves out: statistics, all arms with all laws, chaos
	$(BIN)/python -m pytest -n auto --dist loadfile -m study $(ARGS)

check: $(VENV)/.all  ## style, types, and which room imports which
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/python -m pytest -q tests/architecture

frozen: $(VENV)/.all  ## compare kernels, reference runs and numbers with what is frozen (ARGS=--write: freeze anew)
	PYTHONPATH=tests $(BIN)/python -m frozen $(ARGS)

fuzz: $(VENV)/.all  ## feed everything damaged input for MINUTES=10, count outcomes, keep failures
	cd tests && ../$(BIN)/python -m fuzz --minutes $(or $(MINUTES),10) $(ARGS)

bench: $(VENV)/.all  ## time the kernels beside their peers
	$(BIN)/python benchmarks/run.py $(ARGS)

docs: $(VENV)/.all  ## build the site into build/docs (LINKS=1: with links to NumPy, SciPy, xarray, Python; needs the network)
	LINKS=$(LINKS) $(BIN)/python -m sphinx -W --keep-going -b html docs build/docs

reference: $(VENV)/.all  ## write the generated parts of docs anew, from docstrings, commands, keys of files and benchmarks
	$(BIN)/python docs/ext/armwright_pages.py

pictures: $(VENV)/.all  ## make the pictures of the README and the docs anew
	PYTHONPATH=tests $(BIN)/python -m pictures.gallery

lock: $(BIN)/uv  ## bring requirements.lock up to pyproject.toml (UPGRADE=1: to the newest versions)
	$(BIN)/uv pip compile pyproject.toml --universal --python-version 3.11 --all-extras --group dev \
	    --generate-hashes --no-emit-index-url --custom-compile-command "make lock" --quiet \
	    $(if $(UPGRADE),--upgrade) --output-file requirements.lock

lowest: $(BIN)/uv  ## try the wheel alone with the lowest versions pyproject.toml allows (ARGS="--python 3.13 --quick")
	$(BIN)/python tools/trial.py lowest $(ARGS)

newest: $(BIN)/uv  ## the same with the newest versions
	$(BIN)/python tools/trial.py newest $(ARGS)

release: $(BIN)/uv  ## build into dist, check, try the wheel in a bare environment, and list what to tag (ARGS=--quick)
	$(BIN)/python tools/release.py $(ARGS)

clean:  ## remove what was built; the environment stays
	rm -rf build dist .pytest_cache .ruff_cache .hypothesis
	find src tests tools -name __pycache__ -type d -prune -exec rm -rf {} +

# --- the environment: a stamp for the core, one for the tests, one for everything ---------------------------------------

$(VENV)/.core: requirements.lock pyproject.toml tools/requirements.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and f"Armwright needs Python 3.11 or newer; $(PYTHON) is {sys.version.split()[0]}. Try: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python tools/requirements.py core > $(VENV)/core.lock
	$(PIP) --require-hashes --only-binary :all: -r $(VENV)/core.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/.test: $(VENV)/.core
	$(BIN)/python tools/requirements.py test > $(VENV)/test.lock
	$(PIP) --require-hashes --only-binary :all: -r $(VENV)/test.lock
	@touch $@

$(VENV)/.all: $(VENV)/.test
	$(PIP) --require-hashes --only-binary :all: -r requirements.lock
	@touch $@

# uv makes the lock, and must be there before a lock that fits pyproject.toml is.
$(BIN)/uv:
	$(PYTHON) -m venv $(VENV)
	sed -n '/^uv==/,/# via/p' requirements.lock > $(VENV)/uv.lock
	$(PIP) --require-hashes --only-binary :all: -r $(VENV)/uv.lock
