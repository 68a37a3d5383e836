# The commands of the project; `make help` lists them. They work on a bare machine with Python 3.11
# or 3.12: the first one creates .venv and installs the packages there, nowhere else.

VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
ARGS ?=
TASK ?= door/unlock

.PHONY: help demo demo-policy drive top test suite study study-policies tasks links faults fuzz train-paper loaders mutants bench compare docs lint \
	setup clean

help: ## list the targets
	@echo "make <target> [ARGS='...']    ARGS go to the command, e.g. make demo ARGS='--no-video'"
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14 | sed 's/^/  /'

demo: $(STAMP) ## run the whole system by a script; log, summary and pictures go to runs/
	$(BIN)/trill demo $(ARGS)

demo-policy: $(STAMP) ## run a learned policy on door/unlock, live; log, summary and pictures go to runs/
	$(BIN)/trill demo --policy policies/door-unlock $(ARGS)

drive: $(STAMP) ## drive the same robot from your keyboard
	$(BIN)/trill drive $(ARGS)

top: $(STAMP) ## show the live table of a running system
	$(BIN)/trill top $(ARGS)

test: $(STAMP) ## run the unit and integration tests, a few minutes
	$(BIN)/python -m pytest $(ARGS)

suite: $(STAMP) ## check every promise about standing, walking and reaching, a quarter hour
	$(BIN)/python -m verification.walking $(ARGS)

study: $(STAMP) ## run the latency study with the synthetic operator, resumable; hours on two cores
	$(BIN)/trill study latency $(ARGS)

study-policies: $(STAMP) ## train and evaluate the three kinds of policy on the data sets that are there; hours
	$(BIN)/trill study policies --run kinds --jobs 2 $(ARGS)

tasks: $(STAMP) ## run each scored task 25 times with the synthetic operator, under an hour
	$(BIN)/python -m lab.studies.tasks run all --seeds 0:25 --jobs 2 --out runs/studies/tasks.jsonl $(ARGS)

train-paper: $(STAMP) ## train the paper's network on a GPU, of TASK (door/unlock), in 6 minutes; rendering apart
	$(BIN)/trill train $(TASK) --recipe paper --profile paper --device cuda --minutes 6 \
		--set training.rate=0.0005 --set training.schedule=one-cycle --set training.clip=5 \
		--set training.validate_every=1000 $(ARGS)

links: $(STAMP) ## compare injected delays, requested and achieved, live and in simulated time
	$(BIN)/python -m verification.links $(ARGS)

faults: $(STAMP) ## test killed recorders, bad readers, cut networks, skewed clocks; a quarter hour
	$(BIN)/python -m verification.faults $(ARGS)

fuzz: $(STAMP) ## give 100,000 damaged payloads to every decoder
	$(BIN)/python -m verification.fuzz $(ARGS)

loaders: $(STAMP) ## load exported demonstrations in robomimic and lerobot, each in its own venv
	$(BIN)/python -m verification.loaders $(ARGS)

mutants: $(STAMP) ## change the guard's code in every way; each change must fail a test; minutes
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[mutation]'
	rm -rf mutants
	$(BIN)/python -m mutmut run $(ARGS)
	$(BIN)/python -m mutmut results

bench: $(STAMP) ## run every benchmark: bus, logger, controller, start
	@set -e; for file in benchmarks/bench_*.py; do \
		echo "== $$file"; $(BIN)/python "$$file" $(ARGS); done

compare: $(STAMP) ## compare the speed of another source tree with this one's: ARGS='../old'
	$(BIN)/python benchmarks/compare.py $(ARGS)

docs: $(STAMP) ## write the generated reference pages again
	$(BIN)/python -m docs.reference $(ARGS)

lint: $(STAMP) ## check style, types and the import rules
	PATH="$(CURDIR)/$(BIN):$$PATH" deploy/lint.sh

setup: $(STAMP) ## create .venv and install the packages, without running anything

clean: ## delete .venv, compiled kernels and caches; runs/ stays
	find common services -name '*.abi3.so' -delete
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache

$(STAMP): pyproject.toml deploy/setup.sh
	deploy/setup.sh $(VENV)
