# Every command here is complete on a machine with python3 (3.11+), python3-venv, make, git and g++.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The lowest versions that pyproject.toml allows, in an environment of their own.
LOWEST := .venv-lowest
# Twice quiet: errors are shown, the chatter of a machine's own pip configuration is not.
INSTALL := $(BIN)/pip install --quiet --quiet --disable-pip-version-check -c constraints.txt -e

# Compiled functions are kept from one run to the next (JAX's persistent cache), small ones too.
export JAX_COMPILATION_CACHE_DIR := $(CURDIR)/.cache/jax
export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS := 0.1

# More arguments for pytest, pyright or the benchmarks: make test ARGS="-m 'not slow' -k pose".
ARGS ?=

# A ratio to a one-thread peer is only fair when the numerical libraries keep to one thread as well.
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1

# Tests compile thousands of functions and run each a few times: two thirds of the time are saved where XLA hurries. Everything
# else (notebooks, demo, validation, benchmarks) runs the code as users have it. Two workers, and one BLAS thread each: four on two
# cores wait for one another.
QUICK := XLA_FLAGS="--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true --xla_cpu_use_fusion_emitters=false $(XLA_FLAGS)"

.PHONY: help demo test lowest lint format types notebooks validation bench gate clean distclean

help:
	@echo "make demo       calibrate the bundled flight and write out/haian/report.html"
	@echo "make test       run the tests"
	@echo "make lowest     install the lowest versions that pyproject.toml allows, and run a few tests and the demo with them"
	@echo "make lint       check style and formatting (make format mends what it can)"
	@echo "make types      check the types"
	@echo "make notebooks  execute every notebook in a temporary copy"
	@echo "make validation measure every claim of docs/validation.md anew and write the pages (half an hour)"
	@echo "make bench      measure speed against the peers; make gate also fails when a ratio is too high"
	@echo "make clean      remove what these commands wrote; make distclean removes $(VENV) and $(LOWEST) as well"

# The stamps $(VENV)/.app and $(VENV)/.dev are newer than pyproject.toml and constraints.txt while an install is current.
$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "whiskjax needs Python 3.11 or newer: make PYTHON=python3.11 ...")'
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.app: pyproject.toml constraints.txt | $(BIN)/pip
	@echo "Installing whiskjax into $(VENV) (the first time takes a minute or more)"
	@$(INSTALL) ".[app]"
	@touch $@

# What the developers' install brings includes the app.
$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/pip
	@echo "Installing whiskjax and the developers' tools into $(VENV) (the first time takes a minute or more)"
	@$(INSTALL) ".[dev,bench]"
	@touch $@ $(VENV)/.app

demo: $(VENV)/.app
	$(BIN)/whiskjax calibrate examples/haian --out out/haian

test: $(VENV)/.dev
	$(ONE_THREAD) $(QUICK) $(BIN)/python -m pytest -n 2 --dist worksteal $(ARGS)

$(LOWEST)/.done: pyproject.toml constraints-lowest.txt | $(BIN)/pip
	@echo "Installing the lowest versions into $(LOWEST)"
	@$(PYTHON) -m venv $(LOWEST)
	@$(LOWEST)/bin/pip install --quiet --quiet --disable-pip-version-check -c constraints-lowest.txt \
		-e ".[app]" hypothesis packaging pyproj pytest scipy
	@touch $@

# Few compilations, every room: float64, files, a simulated flight, and one calibration from the command line to its report.
lowest: $(LOWEST)/.done
	$(LOWEST)/bin/python -m tests.lowest
	$(QUICK) $(LOWEST)/bin/python -m pytest -p no:cacheprovider tests/rules tests/files/test_docs.py tests/app/test_example.py $(ARGS)
	$(QUICK) $(LOWEST)/bin/whiskjax calibrate examples/haian --out out/lowest

lint: $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check

format: $(VENV)/.dev
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# The variable stops pyright from asking the registry whether there is a newer pyright.
types: $(VENV)/.dev
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(BIN)/pyright $(ARGS)

# Half an hour on two cores. Commands that find a figure outside its band end in an error, and the page says so.
VALIDATION := out/validation
validation: $(VENV)/.dev
	mkdir -p $(VALIDATION)
	-$(BIN)/whiskjax reproduce whiskbroom --out $(VALIDATION)/whiskbroom
	-$(BIN)/whiskjax reproduce location --out $(VALIDATION)/location
	-$(BIN)/whiskjax reproduce three-line --out $(VALIDATION)/three_line
	-$(BIN)/python -m tests.real --out $(VALIDATION)/real
	-$(BIN)/python -m tests.peers --out $(VALIDATION)/peers
	for study in whiskbroom location three_line; do $(BIN)/python docs/$$study.py $(VALIDATION)/$$study || exit 1; done
	$(BIN)/python docs/validation.py $(VALIDATION)

notebooks: $(VENV)/.dev
	$(BIN)/python -m notebooks $(ARGS)

bench: $(VENV)/.dev
	$(ONE_THREAD) $(BIN)/python -m benchmarks $(ARGS)

gate: $(VENV)/.dev
	$(ONE_THREAD) $(BIN)/python -m benchmarks --gate $(ARGS)

clean:
	rm -rf out dist build .cache .hypothesis .pytest_cache .ruff_cache benchmarks/peers/build
	find . \( -path ./$(VENV) -o -path ./$(LOWEST) \) -prune -o -name __pycache__ -type d -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV) $(LOWEST)
