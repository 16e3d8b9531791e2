# Two commands: `make demo` and `make test`. Both set up what is missing first.
SHELL := /bin/bash
ENV := set -e; . .venv/bin/activate;

.PHONY: demo test suite suite-beside suite-ranks suite-newest test-slow test-rounding nightly bench study docs pictures lint setup bare test-debian13 test-newest
setup: fenics_contact/kernels/__pycache__/fresh
	@bash .ci/setup

# Without what is compiled ahead for scenes of all kinds
bare: fenics_contact/kernels/__pycache__/fresh
	@bash .ci/setup bare

# Numba notices an edit of a cached kernel's own file, not of those that it calls: after any edit all are compiled anew
fenics_contact/kernels/__pycache__/fresh: $(wildcard fenics_contact/kernels/*.py)
	@mkdir -p $(@D) && rm -f $(@D)/*.nbi $(@D)/*.nbc && touch $@

demo: bare
	@$(ENV) mpirun -n 2 python3 demos/punch_on_plate.py

# Runs what the committed CSV files lack and draws again: make study NAME=sphere (tubes punch cylinder hertz maps economy all)
study: setup
	@$(ENV) python3 -m fenics_contact.studies $(NAME)

# HTML in build/docs, without a network; a warning is an error
docs: bare
	@bash .ci/setup docs
	@$(ENV) python3 -m sphinx -n -W --keep-going -q -b html docs build/docs && echo "documents: build/docs/index.html"

# Runs the code of the documents' pages and draws their pictures again: make pictures PAGES="wiper balloon", all by default
pictures: setup
	@$(ENV) python3 docs/pages.py $(PAGES)

lint: bare
	@$(ENV) ruff check . && ruff format --check . && mypy

test: lint suite

# The tests alone, without types, which are checked with the libraries that `make setup` is written for. Each runs once: on two
# processes those that these could change, which do there all that they do on one; on one process they run in `make nightly`.
# Files are handed out whole: what a file solves once is solved once, and neither process is left with a long rest
suite: setup
	@$(ENV) python3 -m pytest -n 2 --dist loadfile -m "not parallel and not slow"
	@$(ENV) mpirun -n 2 python3 -m pytest -m "parallel and not slow" -p no:cacheprovider --color=no

# Those that take longer than all others of their file: many ranks, fine meshes, long ways
test-slow: setup
	@$(ENV) python3 -m pytest -n 2 -m slow

# What another release could trip over: all that runs on one process, and on two what its communicators, what is freed and
# when, files and restarts decide; ONLY, FILES: some of these tests alone
suite-beside: setup
	@$(ENV) python3 -m pytest -n 2 --dist loadfile -m "not parallel and not slow" $(ONLY)
	@$(MAKE) suite-ranks FILES="$(FILES) tests/test_plane.py"

FILES := tests/test_faults.py tests/test_restart.py tests/test_steppers.py
suite-ranks: setup
	@$(ENV) mpirun -n 2 python3 -m pytest -m "parallel and not slow" -p no:cacheprovider --color=no $(FILES)

# With the newest release on two processes, where its communicators and orders of sums differ
suite-newest:
	@$(MAKE) suite-ranks FILES="$(FILES) tests/test_plane.py tests/test_raised_penalty.py tests/test_arc_length.py"

# What could hinge on the last bits, with the plain kernels that OpenBLAS falls back to on CPUs it does not know
test-rounding: setup
	@$(ENV) OPENBLAS_CORETYPE=Prescott python3 -m pytest -n 2 tests/test_linear.py tests/test_verdicts.py tests/test_damping.py \
	  tests/test_stabilisation.py tests/test_arc_length.py tests/test_steppers.py tests/test_branches.py

# What `make test` runs on two processes, on one, and what `make test-slow` runs on one, on two; then 200 random scenes on one
# process and on two, each in a process of its own: a line per scene, and how many ended how; at last what the newest release
# could trip over (root only)
nightly: setup
	@$(ENV) python3 -m pytest -n 2 --dist loadfile -m "parallel and not slow"
	@$(ENV) mpirun -n 2 python3 -m pytest -m "parallel and slow" -p no:cacheprovider --color=no
	@$(ENV) python3 tests/random_scenes.py 0 200 --ranks 1 2 --out results/random_scenes.csv
	@SUITE=unstable bash .ci/debian13 suite-newest

# Races against the programs that are installed, what a run is made of, anew; the tables of docs/speed.md
bench: setup
	@rm -f $(foreach name,speed speed_large growth sliding forms kernels,fenics_contact/studies/data/$(name).csv)
	@$(ENV) python3 -m fenics_contact.studies speed pieces

# The suite in a bare Debian 13, and by hand against the newest release in Debian's development branch (root only)
test-debian13:
	@bash .ci/debian13

test-newest:
	@SUITE=unstable bash .ci/debian13
