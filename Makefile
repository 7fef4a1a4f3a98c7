# Everything runs from a virtual environment in .venv that holds exactly requirements.lock.
# Another interpreter: make PYTHON=python3.12 test

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PEERS := $(VENV)/.installed-peers
WRITERS := $(VENV)/.installed-docs
# Simulators that examples need: an environment of their own, with what their pages say to install.
GALLERY := $(VENV)-gallery
EXAMPLES := fission_gas wet_clutch
# In requirements.lock; the other two locks hold one extra more each, at the same versions.
EXTRAS := plot report bayes evolution fmi excel parquet dask mpi petab dev
UV := uv==0.13.9
COMPILE = $(VENV)-lock/bin/uv pip compile pyproject.toml --universal --python-version 3.11 \
    --fork-strategy fewest --generate-hashes --no-header --no-annotate --no-emit-index-url \
    --no-emit-find-links --quiet $(UPGRADE)

# The .venv is made when it is missing or broken, and made anew when an interpreter of another
# version is asked for; otherwise a changed lock is installed into the one that is there.
MINOR := import sys; print("%d.%d" % sys.version_info[:2])
HAVE := $(shell $(BIN)/python -c '$(MINOR)' 2>/dev/null)
WANTED := $(if $(PYTHON),$(shell $(PYTHON) -c '$(MINOR)' 2>/dev/null),$(HAVE))
ifneq ($(HAVE),$(or $(WANTED),none))
CREATE := create-venv
$(STAMP): FORCE
endif
PYTHON ?= python3

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo reproduce test test-long kernels browser docs browser-docs gallery bench judges hardening lint lock clean .venv create-venv FORCE

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(addprefix demo-,$(EXAMPLES)) ## Identify the laws of both examples into out/

demo-%: $(STAMP)
	$(BIN)/aleator identify examples/$*/study.toml --output out/$*

reproduce: $(STAMP) ## Compute the paper's figures and judge its claims, into out/paper
	$(BIN)/python -m reproduction --output out/paper

test: $(STAMP) ## Run the tests, the doctests of the source and the README
	@# Once, not in each process that a test starts: some systems keep no bytecode.
	$(BIN)/python -m compileall -q src
	$(BIN)/pytest -m "not long" --numprocesses auto --dist loadfile --no-loadscope-reorder --durations=20

test-long: $(STAMP) ## Run the tests that take a minute or more each
	$(BIN)/pytest -m long --numprocesses auto --dist loadfile --durations=0

kernels: $(STAMP) ## Run the numerical tests under other kernels of the BLAS, and with two threads
	$(BIN)/python tests/kernels.py

browser: $(STAMP) ## Look at report.html in a headless Chromium, which must be there
	$(BIN)/pytest tests/browser/browse.py

docs: $(WRITERS) ## Build the site into out/docs; a warning is an error
	$(BIN)/sphinx-build --builder html --conf-dir website --fail-on-warning --keep-going --quiet . out/docs
	@echo "Written: out/docs/index.html"

browser-docs: docs ## Look at every page of the site in a headless Chromium
	$(BIN)/pytest tests/browser/pages.py

gallery: $(GALLERY)/.installed ## Identify the gallery's examples, with their simulators; draw figures, hold numbers
	$(GALLERY)/bin/python website/gallery.py

bench: $(PEERS) ## Run the benchmarks, against peers that only they need
	$(BIN)/python -m benchmarks

judges: $(STAMP) ## Answers to 64 random studies and all examples (BEFORE=record.jsonl compares)
	@mkdir -p out
	$(BIN)/python -m benchmarks.judges out/judges.jsonl $(if $(BEFORE),--before $(BEFORE))

hardening: $(STAMP) ## Damage files, kill commands, let simulators fail: what is promised then
	$(BIN)/python -m hardening

lint: $(STAMP) ## Check style, formatting, types and layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict src reproduction benchmarks hardening website
	$(BIN)/lint-imports

lock: ## Write requirements.lock anew (UPGRADE=--upgrade takes newer versions)
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/python -m pip install --quiet $(UV)
	$(COMPILE) $(addprefix --extra ,$(EXTRAS)) --output-file requirements.lock
	$(COMPILE) $(addprefix --extra ,$(EXTRAS) peers) --constraint requirements.lock --output-file requirements-bench.lock
	$(COMPILE) $(addprefix --extra ,$(EXTRAS) docs) --constraint requirements.lock --output-file requirements-docs.lock

clean: ## Remove results, caches and build outputs (not .venv)
	rm -rf out build dist .pytest_cache .ruff_cache .mypy_cache .hypothesis \
	    .import_linter_cache $(VENV)-lock
	find src tests reproduction benchmarks hardening -name __pycache__ -type d -prune -exec rm -rf {} +

.venv: $(STAMP)

$(STAMP): requirements.lock pyproject.toml | $(CREATE)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

$(PEERS): requirements-bench.lock $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-bench.lock
	@touch $@

$(WRITERS): requirements-docs.lock $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-docs.lock
	@touch $@

$(GALLERY)/.installed: requirements.lock pyproject.toml $(wildcard examples/*/README.md) | $(STAMP)
	$(BIN)/python -m venv $(GALLERY)
	$(GALLERY)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(GALLERY)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	sed -n 's/^    pip install \(.*==.*\)/\1/p' examples/*/README.md | \
	    xargs $(GALLERY)/bin/python -m pip install --quiet --disable-pip-version-check
	@touch $@

create-venv:
	@command -v $(PYTHON) >/dev/null || { \
	    echo "$(PYTHON) is not installed. Remedy: make PYTHON=<a Python 3.11 or newer> ..."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "Aleator needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) -V 2>&1)."; \
	    echo "Remedy: make PYTHON=python3.12 ... (any newer interpreter by name)"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { \
	    echo "$(PYTHON) lacks venv or pip (ensurepip)."; \
	    echo "Remedy: install them (on Debian and Ubuntu: apt install python3-venv)"; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)
