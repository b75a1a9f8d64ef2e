# forefeel: every target works on a fresh clone (Linux, Python 3.11+, network for packages only).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# two stages: what runs the demo, and what the tests and checks need beyond it; versions and hashes are pinned
DEMO := $(VENV)/.demo
READY := $(VENV)/.ready
# bytecode of what is used comes with its first use: that of all would take half of the time and 100 MB
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

# one thread for linear algebra in each of two test processes; bytecode is kept, or each start compiles anew
test system: export OPENBLAS_NUM_THREADS := 1
demo test system: export PYTHONDONTWRITEBYTECODE :=

.PHONY: help demo test check docs bench hidden-effects system fuzz format lock clean

help: ## what there is
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

$(DEMO): deploy/lock/demo.txt pyproject.toml
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "make: $(PYTHON) has no venv; type: sudo apt-get install python3-venv"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) --require-hashes -r deploy/lock/demo.txt
	rm -rf forefeel.egg-info  # an old one hides new entry points
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

$(READY): $(DEMO) deploy/lock/dev.txt
	$(PIP) --require-hashes -r deploy/lock/dev.txt
	$(BIN)/python -c 'from forefeel.common.estimation.predictor import compile_kernels; compile_kernels()'
	$(BIN)/python -c 'from forefeel.common.causes.registry import compile_kernels; compile_kernels()'
	@touch $@

demo: $(DEMO) ## a minute and a half on this machine, live at 127.0.0.1:8600, report in out/demo
	$(BIN)/forefeel demo

test: $(READY) ## all tests; then, one after the other, those of real processes
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --ignore tests/process
	$(BIN)/python -m pytest tests/process

check: $(READY) ## ruff, mypy --strict, the import layers and the words, tests included
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tests.repository.words

docs: $(READY) ## the documentation as pages in site/, its reference from the code; any dead link fails
	$(PIP) --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# sysidentpy asks for an older numpy than the product's and works with this one
PEERS = $(PIP) --editable '.[bench]' && $(PIP) --no-deps 'sysidentpy>=0.9'

bench: $(READY) ## everything beside its peers, in one run: benchmarks/RESULTS.md (an hour, quiet machine, root)
	$(PEERS)
	$(BIN)/python -m benchmarks

hidden-effects: $(READY) ## both generators: false confidence first; 400 recordings, PySINDy, sysidentpy
	$(PEERS)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m soak --timeout 900
	$(BIN)/python -m tests.hidden_effects.bench --jobs 2 --methods product pysindy sysidentpy memory
	$(BIN)/python -m tests.hidden_effects
	$(BIN)/python -m tests.hidden_effects.mutants

MINUTES ?= 10
system: $(READY) ## as root, by hand: faults, attacks, signals, soak, page (45 minutes); docs/explanation/faults.md
	$(BIN)/python -m tests.system --minutes $(MINUTES) --out docs/explanation/faults.md

fuzz: $(READY) ## 100,000 byte strings for every parser
	$(BIN)/python -m pytest -m fuzz -s --timeout 900

format: $(READY) ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

LOCK = $(BIN)/uv pip compile pyproject.toml --python-version 3.11 --universal --generate-hashes --upgrade \
	--no-emit-index-url --no-header --no-annotate --quiet
lock: $(READY) ## new versions of all packages with their hashes, deploy/lock
	$(PIP) uv
	$(LOCK) --extra demo -o deploy/lock/demo.txt
	$(LOCK) --extra dev -c deploy/lock/demo.txt -o deploy/lock/dev.txt

clean: ## remove the environment and results
	rm -rf $(VENV) out build site *.egg-info
