# The commands of the README. Each makes .venv from its lock first if that is not done yet.
# Paths are passed through the environment, so that a folder with a space in its name works.

PORT ?= 3000
DATA ?= ./var
PYTHON ?=
SEED ?=
SEEDS ?=
ARGS ?=
export PORT DATA PYTHON

.DEFAULT_GOAL := help
.PHONY: help run demo test test-postgresql check lint fast bench campaign peers simulate screenshots lock venv venv-dev
MAKEFLAGS += --no-print-directory

help:
	@echo 'Fieldstack Hard-Core: a household ledger that dies and comes back, with proof.'
	@echo
	@echo '  make run        start everything; the URL is printed (PORT=3000 DATA=./var)'
	@echo '  make demo       a sample household, and a page with buttons that break the server (in DATA/demo)'
	@echo '  make test       all tests, in at most 15 minutes on two cores (ARGS="-k restart" for some)'
	@echo '  make test-postgresql   the integration tests once more, with every ledger in a PostgreSQL server'
	@echo '  make check      format, lint, types, import laws, fast tests; under a minute'
	@echo '  make bench      the numbers, measured on this machine beside their baselines (BENCH=deaths for one part)'
	@echo '  make peers      put the supervisors that BENCH=peers compares with under ./var/peers'
	@echo '  make campaign   random faults on living processes, and an audit after each run (RUNS=20)'
	@echo '  make simulate   many simulated crises (SEEDS=5000), or one again (SEED=1234)'
	@echo '  make screenshots   pictures of every state into ./var/screenshots (needs a Chromium)'
	@echo '  make lock       write the two locks anew from pyproject.toml (needs uv)'
	@echo
	@echo 'Needed: Linux 5.4 or newer, CPython 3.11 or newer. The first run sets up .venv by itself.'
	@echo 'Try it: make run, and in a second terminal: .venv/bin/hardcore drill crash'

venv:
	@sh scripts/venv run

venv-dev:
	@sh scripts/venv dev

run: venv
	@exec .venv/bin/hardcore --data "$$DATA" up --port "$$PORT"

demo: venv
	@exec .venv/bin/python -m examples.demo --data "$$DATA/demo" --port "$$PORT"

test: venv-dev
	@exec sh scripts/test $(ARGS)

test-postgresql: venv-dev
	@TEST_STORE=postgresql exec .venv/bin/python -m pytest -q -n 4 --dist loadfile $(or $(ARGS),tests/integration)

check: lint fast

lint: venv-dev
	@echo 'Format'
	@.venv/bin/ruff format --check --quiet --output-format concise . || \
		{ echo 'To format: .venv/bin/ruff format .' >&2; exit 1; }
	@echo 'Lint'
	@.venv/bin/ruff check --quiet --output-format concise .
	@echo 'Types'
	@.venv/bin/mypy --no-error-summary
	@echo 'Import laws'
	@.venv/bin/lint-imports --config pyproject.toml >.venv/lint-imports.log 2>&1 || { cat .venv/lint-imports.log; exit 1; }

fast: venv-dev
	@echo 'Fast tests'
	@exec .venv/bin/python -m pytest --quiet tests/unit tests/architecture tests/contract

bench: venv-dev
	@exec .venv/bin/python -m bench $(BENCH) $(ARGS)

peers: venv-dev
	@sh scripts/peers

campaign: venv-dev
	@exec .venv/bin/python -m tests.campaign --runs $(or $(RUNS),20) $(ARGS)

simulate: venv-dev
	@exec .venv/bin/python -m tests.simulation $(if $(SEED),--seed $(SEED)) $(if $(SEEDS),--seeds $(SEEDS)) $(ARGS)

screenshots: venv-dev
	@exec .venv/bin/python -m tests.browser.screenshots $(ARGS)

lock:
	@command -v uv >/dev/null || { echo 'make lock needs uv on the PATH: install it (pip install uv) and start again.' >&2; exit 1; }
	@sh scripts/lock
