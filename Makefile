# Two commands: `make demo` and `make test`. Both set up what is missing first.
SHELL := /bin/bash
ENV := set -e; . .venv/bin/activate;

.PHONY: demo test lint setup
setup:
	@bash .ci/setup

demo: setup
	@$(ENV) mpirun -n 2 python3 demos/punch_on_plate.py

lint: setup
	@$(ENV) ruff check . && ruff format --check .

test: lint
	@$(ENV) python3 -m pytest
	@$(ENV) mpirun -n 2 python3 -m pytest -m parallel -p no:cacheprovider --color=no
