# Everything a newcomer needs; `make help` says what. Works from a bare machine with Python 3.11
# or 3.12: the first command makes .venv and installs the packages there, nowhere else.

VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
ARGS ?=

.PHONY: help demo drive top test suite study tasks links faults fuzz loaders bench docs lint setup clean

help: ## say what there is
	@echo "make <target> [ARGS='...']    ARGS go to the command, e.g. make demo ARGS='--no-video'"
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10 | sed 's/^/  /'

demo: $(STAMP) ## the robot walks and works by a script; leaves log, summary, pictures in runs/
	$(BIN)/trill demo $(ARGS)

drive: $(STAMP) ## the same robot on your keyboard
	$(BIN)/trill drive $(ARGS)

top: $(STAMP) ## live table of a running system
	$(BIN)/trill top $(ARGS)

test: $(STAMP) ## unit and integration tests, a few minutes
	$(BIN)/python -m pytest $(ARGS)

suite: $(STAMP) ## every promise about standing, walking and reaching, ten minutes
	$(BIN)/python -m verification.walking $(ARGS)

study: $(STAMP) ## the latency study with the synthetic operator, resumable; hours on two cores
	$(BIN)/trill study latency $(ARGS)

tasks: $(STAMP) ## 25 seeds of each scored task by the synthetic operator, under an hour on two cores
	$(BIN)/python -m lab.studies.tasks run all --seeds 0:25 --jobs 2 --out runs/studies/tasks.jsonl $(ARGS)

links: $(STAMP) ## injected delays, asked for against achieved, live and in simulated time
	$(BIN)/python -m verification.links $(ARGS)

faults: $(STAMP) ## killed recorders, bad readers, cut networks, skewed clocks; a quarter of an hour
	$(BIN)/python -m verification.faults $(ARGS)

fuzz: $(STAMP) ## 100,000 damaged payloads at every decoder
	$(BIN)/python -m verification.fuzz $(ARGS)

loaders: $(STAMP) ## robomimic and lerobot load exported demonstrations, each in a venv of its own
	$(BIN)/python -m verification.loaders $(ARGS)

bench: $(STAMP) ## measure the figures the README quotes
	@set -e; for file in benchmarks/bench_*.py; do \
		echo "== $$file"; $(BIN)/python "$$file" $(ARGS); done

docs: $(STAMP) ## write the generated reference pages again
	$(BIN)/python -m docs.reference $(ARGS)

lint: $(STAMP) ## style, types and who imports whom
	PATH="$(CURDIR)/$(BIN):$$PATH" deploy/lint.sh

setup: $(STAMP) ## make .venv and install, without running anything

clean: ## forget .venv and caches; runs/ stays
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache

$(STAMP): pyproject.toml deploy/setup.sh
	deploy/setup.sh $(VENV)
