# forefeel: every target works on a fresh clone (Linux, Python 3.11+, network for packages only).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# two stages: what runs the demo, and what the tests and checks need beyond it; versions and hashes are pinned
DEMO := $(VENV)/.demo
READY := $(VENV)/.ready
# bytecode of what is used comes with its first use: that of all would take half of the time and 100 MB
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# says what it does: half a minute without a word looks broken
TELLING_PIP := $(BIN)/python -m pip install --disable-pip-version-check --no-compile --progress-bar off
BUILD := $(BIN)/python common/kernels/build.py
INSTALL_ZIG := $(PIP) --require-hashes -r deploy/lock/compiler.txt
REMOVE_ZIG := $(BIN)/python -m pip uninstall --quiet --disable-pip-version-check --yes ziglang

# one thread for linear algebra in each of two test processes; bytecode is kept, or each start compiles anew
test system: export OPENBLAS_NUM_THREADS := 1
demo test system: export PYTHONDONTWRITEBYTECODE :=

.PHONY: help kernels demo test check docs bench hidden-effects system firmware ros fuzz sanitize format wheel lock clean

help: ## what there is
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

$(BIN)/pip:
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "make: $(PYTHON) has no venv; type: sudo apt-get install python3-venv"; exit 2; }
	$(PYTHON) -m venv $(VENV)

# without a compiler, ziglang (400 MB) is in the environment for as long as the build takes
kernels: | $(BIN)/pip ## the C library of common/kernels, where it is not of these sources
	@$(BUILD) --check || { \
	[ "$$CC" ] || command -v cc >/dev/null || { $(INSTALL_ZIG) && zig=yes; }; \
	$(BUILD); status=$$?; [ -z "$$zig" ] || $(REMOVE_ZIG); exit $$status; }

$(DEMO): deploy/lock/demo.txt pyproject.toml setup.py | kernels
	$(TELLING_PIP) --require-hashes -r deploy/lock/demo.txt
	rm -rf src/forefeel.egg-info  # an old one hides new entry points
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

$(READY): $(DEMO) deploy/lock/dev.txt | kernels
	$(PIP) --require-hashes -r deploy/lock/dev.txt
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

bench: $(READY) ## everything beside its peers, or ONLY="prediction recording": benchmarks/RESULTS.md (3 hours, quiet, root)
	$(PEERS)
	$(BIN)/python -m benchmarks $(ONLY:%=--only %)

hidden-effects: $(READY) ## both generators: false confidence first; 400 recordings, PySINDy, sysidentpy
	$(PEERS)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m soak --timeout 900
	$(BIN)/python -m tests.hidden_effects.bench --jobs 2 --methods product pysindy sysidentpy memory
	$(BIN)/python -m tests.hidden_effects
	$(BIN)/python -m tests.hidden_effects.mutants

MINUTES ?= 10
system: $(READY) ## as root, by hand: faults, attacks, signals, soak, page (45 minutes); docs/explanation/faults.md
	$(BIN)/python -m tests.system --minutes $(MINUTES) --out docs/explanation/faults.md

# AVR and ARM have no compiler in Python's registry; the chips' emulators in JavaScript stay outside of the clone
FIRMWARE_PACKAGES := make gcc-avr avr-libc gcc-arm-none-eabi qemu-system-misc nodejs npm
CHIPS = $${XDG_CACHE_HOME:-$$HOME/.cache}/forefeel/chips
firmware: $(READY) ## as root, or with its tools: builds firmware/, prints the sizes, and runs it in emulated chips (2 minutes)
	@for tool in avr-gcc arm-none-eabi-gcc qemu-system-avr node npm; do command -v $$tool >/dev/null || missing=yes; done; \
	[ -z "$$missing" ] || { [ "$$(id -u)" = 0 ] && apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
	apt-get install -y -qq --no-install-recommends $(FIRMWARE_PACKAGES); } || \
	{ echo "make: type: sudo apt-get install $(FIRMWARE_PACKAGES)"; exit 2; }
	npm install --silent --no-audit --no-fund --prefix "$(CHIPS)" avr8js@0.21.1 rp2040js@1.4.1 || echo "make: no avr8js, no rp2040js"
	$(MAKE) -C firmware OUT=$(abspath out/firmware/index) INDEX=1 >/dev/null
	$(MAKE) -C firmware OUT=$(abspath out/firmware)
	$(BIN)/python -m tests.firmware out/firmware "$(CHIPS)/node_modules"

fuzz: $(READY) ## 100,000 byte strings for every parser
	$(BIN)/python -m pytest -m fuzz -s --timeout 900

# a copy, for only a preloaded sanitizer can load such a library; leaks are Python's
RUNTIME = $$(for name in asan ubsan stdc++; do cc -print-file-name=lib$$name.so; done | paste -sd:)
sanitize: $(READY) ## address and undefined behaviour over the kernels' tests and 10,000 random calls (gcc)
	rm -rf out/sanitize && mkdir -p out/sanitize
	cp -a common docs master slave src tests pyproject.toml out/sanitize
	CFLAGS='-g -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all' $(BIN)/python out/sanitize/common/kernels/build.py
	cd out/sanitize && export PYTHONPATH=src LD_PRELOAD="$(RUNTIME)" ASAN_OPTIONS=detect_leaks=0 && \
	$(abspath $(BIN)/python) -m tests.random_kernel_calls 10000 1 && \
	$(abspath $(BIN)/python) -m pytest -p no:cacheprovider $$(grep -lE 'common\.(kernels|estimation)' tests/unit/*.py tests/property/*.py)

ROS := out/ros-peers
ros: $(READY) ## by hand: what zenoh-ros2-sdk and rclpy (260 MB, in out/) hear of `forefeel ros` at 200 Hz for a minute
	$(PIP) --editable '.[ros]'
	$(PYTHON) -m venv $(ROS)
	$(ROS)/bin/python -m pip install --quiet --disable-pip-version-check zenoh-ros2-sdk==0.1.8 \
	ros-kilted-rclpy ros-kilted-rmw-fastrtps-cpp ros-kilted-sensor-msgs ros-kilted-geometry-msgs
	$(BIN)/python -m tests.peers.ros_wires --python $(ROS)/bin/python

format: $(READY) ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

wheel: $(DEMO) ## dist: wheels for every Python on Linux with glibc 2.17, x86_64 and aarch64
	rm -rf build
	$(INSTALL_ZIG)
	for machine in x86_64 aarch64; do CC="$(abspath $(BIN)/python) -m ziglang cc -target $$machine-linux-gnu.2.17" \
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist . || exit; done
	$(REMOVE_ZIG)

LOCK = $(BIN)/uv pip compile --python-version 3.11 --universal --generate-hashes --upgrade \
	--no-emit-index-url --no-header --no-annotate --quiet
lock: $(READY) ## new versions of all packages with their hashes, deploy/lock
	$(PIP) uv
	$(LOCK) --group compiler -o deploy/lock/compiler.txt
	$(LOCK) pyproject.toml --extra demo -o deploy/lock/demo.txt
	$(LOCK) pyproject.toml --extra dev -c deploy/lock/demo.txt -o deploy/lock/dev.txt

clean: ## remove the environment and results
	rm -rf $(VENV) out build dist site src/*.egg-info common/kernels/libkernels.so
