# Everything that a person or a CI machine does with cloudparity. `make help` lists it.
#
# One profile (release) for building, checking and testing: the dependencies compile once.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
# rustup's folder first: a login shell may not have read its settings yet.
export PATH := $(HOME)/.cargo/bin:$(PATH)

CARGO_FLAGS := --release --locked
PROGRAM := $(or $(CARGO_TARGET_DIR),target)/release/cloudparity
SCENE := parity/scenes/procedural-clouds.scene.json
# Newer than the requirements when .venv holds what they name.
ENVIRONMENT := .venv/requirements.stamp

.PHONY: help setup system demo demo-live web test lint paper paper-full paper-accept findings-paper bench bench-quick fuzz sweep sweep-test build clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 18

setup: system $(ENVIRONMENT) ## check the compiler, install what is missing, make .venv

system:
	@tools/setup.sh system

$(ENVIRONMENT): requirements.txt requirements-dev.txt requirements-releases.txt | system
	@tools/setup.sh python
	@touch $@

build: setup
	cargo build $(CARGO_FLAGS)

# The demo prints the path of its page, and fails where field or picture differ from Cycles.
demo: build ## render the cloud, compare it with the committed Cycles reference, write out/demo/index.html and the page out/demo/web
	$(PROGRAM) publish $(SCENE) --quality medium --resolution 320x180 --film-transparent true --truth parity/reference/procedural-clouds-320x180.exr -o out/demo/web
	$(PROGRAM) demo -o out/demo

web: build ## the cloud as a page for browsers with WebGPU, out/web; SCENE=FILE takes another scene
	$(PROGRAM) publish $(SCENE) --quality medium --resolution 640x360 -o out/web

demo-live: build ## the same with a fresh Cycles render as reference (needs bpy; minutes)
	$(PROGRAM) demo --live -o out/demo

bench-quick: build ## has anything become slower? minutes, as ratios, beside the committed baseline
	$(PROGRAM) bench-quick $(SCENE) --baseline parity/bench-baseline.json

# The second takes hours where the cache has no reference of the two heavy scenes.
bench: build ## speed of the evaluators and of path tracing against Cycles, as ratios on this machine
	$(PROGRAM) bench $(SCENE)
	$(PROGRAM) bench-bake
	$(PROGRAM) time-to-error -o out/time-to-error

# Files side by side: what a file makes once, it makes once; each process has bpy in it. Threads of a metric that have nothing to do sleep.
PYTEST := OMP_WAIT_POLICY=passive .venv/bin/python -m pytest --quiet --numprocesses auto --maxprocesses 4 --dist loadfile

# The newest release of Blender that setup made an environment of, and the tests of scripts that run in it, too.
NEWEST := $(shell sed -n 's/^NEWEST=//p' tools/setup.sh)
NEWEST_PYTHON := $(or $(CLOUDPARITY_CACHE),$(HOME)/.cache/cloudparity)/blender/$(NEWEST)/bin/python
TESTS_BY_NEWEST := $(addprefix tests/python/test_,export_and_build.py newer_releases.py node_data.py probe.py reference.py \
	scene_io.py volume_objects.py)

test: setup ## lints, all tests of Rust and Python, doc tests
	@$(MAKE) --no-print-directory lint
	if cargo nextest --version >/dev/null 2>&1; \
	then cargo nextest run $(CARGO_FLAGS); \
	else cargo test $(CARGO_FLAGS) --lib --bins --tests; fi
	cargo test $(CARGO_FLAGS) --doc
	PYTHONDONTWRITEBYTECODE=1 $(PYTEST) tests/python # caches in blend/ would build the program anew
	if $(NEWEST_PYTHON) -c 'import bpy, pytest, xdist' 2>/dev/null; \
	then PYTHONDONTWRITEBYTECODE=1 $(subst .venv/bin/python,$(NEWEST_PYTHON),$(PYTEST)) $(TESTS_BY_NEWEST); \
	else echo "left out: tests by Blender $(NEWEST), which has no environment here"; fi

lint: setup ## format, clippy, the core alone, documentation, ruff; warnings are errors
	cargo fmt --check
	cargo clippy $(CARGO_FLAGS) --all-targets -- -D warnings
	cargo clippy $(CARGO_FLAGS) --lib --no-default-features -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc $(CARGO_FLAGS) --no-deps
	.venv/bin/python -m ruff check .
	.venv/bin/python -m ruff format --check .

PAPER := PYTHONPATH=tools PYTHONDONTWRITEBYTECODE=1 .venv/bin/python -m paper

paper: setup ## rebuild the figures and tables of docs/ from committed records, out/paper; what was changed is named, and the exit status 1
	$(PAPER)

paper-full: build ## make the records from nothing (hours, resumable), and compare them; RECORD=NAME one of them, TAKE=1 commits to them
	$(PAPER) full --program $(PROGRAM) $(addprefix --record ,$(RECORD)) $(if $(TAKE),--take)

paper-accept: setup ## take records, figures and tables of docs/ as they are, after a deliberate change
	$(PAPER) accept $(RECORD)

findings-paper: setup ## the paper on errors of Cycles, docs/findings, from its record
	PYTHONDONTWRITEBYTECODE=1 .venv/bin/python tools/findings_paper.py parity/records/findings.json docs/findings

# Needs a nightly compiler and cargo-fuzz (docs/fuzzing.md); nothing else of the project does.
RUNS := 1000000
TARGETS := npy tuning study preset records graph scene

fuzz: ## RUNS=1000000 inputs for each of TARGETS, coverage-guided; stops at what it finds
	tools/fuzz.sh $(RUNS) $(TARGETS)

# snakemake has an environment of its own, .venv-sweep, made on demand.
SWEEP := parity/workflows/sweep.yaml
PROFILE := parity/workflows/profiles/local

sweep: build ## SWEEP=FILE.yaml in chunks (docs/sweeps.md), on this machine; PROFILE=parity/workflows/profiles/slurm on a cluster
	tools/setup.sh sweep
	.venv-sweep/bin/snakemake --snakefile parity/workflows/Snakefile --configfile $(SWEEP) --profile $(PROFILE)

sweep-test: build ## a study of 2,000 runs by one process and on two nodes of Slurm, one of which is killed; as root on Debian
	tools/sweep-test.sh

clean: ## remove what was built and written; .venv and .venv-sweep stay
	cargo clean
	rm -rf out .pytest_cache .ruff_cache
