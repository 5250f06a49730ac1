# make         sets up, generates and builds the C, checks it against the model, follows a line and a circle
# make quick   before a commit, in about a minute: lint, rooms, generated C, and the tests of model, codegen and verification
# make test    every check, in a few minutes: of long ones the smaller version, of many similar ones some
# make nightly make test, and all that takes longer, in less than two hours: all builds of the bit digest, all targets in QEMU,
#              all figures, the long random tests, the tests that tests/by_day.json does not keep, the guarantees, other kernels, whether
#              small changes of the sources are found. Goes on after a step that fails, and where it was stopped:
#              build/nightly.html
# make by-day  chooses again what `make test` keeps of long tests: tests/by_day.json
# make margins the tests, and how much of its tolerance each comparison needs: fails where it is more than a tenth
# make test-TOPIC   the tests of a folder: make test-model, make test-runtime_c
# make types   the types of every room, by mypy
# make figures every figure of the paper and further ones, with their claims checked: build/figures/report.html;
#              with ALL=--all also those of other robots and of the floor in a physics engine, which take minutes
# make films   a page for each robot with a film of its run, and for some of the figures: build/films/car.html
# make site    the pages to read, with search, for a browser and no network: build/site/index.html
# make playground   a page with a robot to drag: the generated C as WebAssembly, with clang: build/playground/index.html
# make bench   instruction counts, sizes and rates beside peers; with ALL=--all also sweeps and long chains
# make bits    the same bits on every target there is
# make firmware the images of every target whose tools are here, into build/firmware
# make firmware-test   runs them, every law's bits and closed loops in QEMU, and compares with this host
# make guarantees   what holds of the C and what shows it, checked; see checks/guarantees/README.md
# make dist    wheel, sdist, and a zip of the C that is committed, as users get it, into dist/
# make clean   leaves what git has
PYTHON ?= python3
VENV := .venv
NOSLIP := $(VENV)/bin/noslip
READY := $(VENV)/.ready
READY_DEV := $(VENV)/.ready-dev
READY_SITE := $(VENV)/.ready-site
export NOSLIP_CACHE ?= $(CURDIR)/build/compiled

python = $(wildcard $(foreach room,$(1),$(addprefix $(room)/,*.py */*.py */*/*.py)))
MODEL := __init__.py $(call python,model codegen)
ROOMS := analysis checks cli examples readers simulation
ALL_PYTHON := $(MODEL) $(call python,$(ROOMS))
RUNTIME := $(wildcard runtime_c/*)
ROBOTS := labmate
RUNS := line circle

include firmware/targets.mk # standard: the flags with which all targets compute the same bits

.PHONY: all by-day setup generate check-generated check simulate figures films site playground lint types quick test suite margins nightly bench bits firmware firmware-test guarantees trig-sweep dist clean
.DELETE_ON_ERROR:

all: generate
	@$(MAKE) --no-print-directory -j2 check simulate
	@cat build/check.txt $(RUNS:%=build/%.txt)
	@echo
	@echo "pictures: $(RUNS:%=build/%.png)"

setup: $(READY_DEV)

# Compiled to bytecode by the installation (uv leaves it to the first import), so that no command does it at each start.
USED := casadi, cffi, control, pycparser, scipy.integrate, sympy, noslip.simulation.closed_loop, noslip.simulation.plot

# Installs noslip with the extras $(1): with uv, which takes seconds, where there is one or it can be had; else with pip.
define install
	@echo "installing the Python packages of noslip$(1) into $(VENV)"
	@uv=$$(command -v uv || echo build/uv/bin/uv); \
	{ $$uv --version || { $(PYTHON) -m venv build/uv && build/uv/bin/python -m pip install --disable-pip-version-check uv; }; } \
	  >/dev/null 2>&1; \
	{ [ -x $(VENV)/bin/python ] || $$uv venv --quiet --python $(PYTHON) $(VENV); } && \
	$$uv pip install --python $(VENV)/bin/python -c constraints.txt -e '.$(1)' || \
	{ $(PYTHON) -m venv $(VENV) && $(VENV)/bin/python -m pip install --disable-pip-version-check -c constraints.txt -e '.$(1)'; }
	@PYTHONDONTWRITEBYTECODE= $(VENV)/bin/python -c 'import $(USED)'
	@touch $@
endef

$(READY): pyproject.toml constraints.txt
	$(call install,)

$(READY_DEV): $(READY)
	$(call install,[dev])

$(READY_SITE): $(READY)
	$(call install,[site])

generate: build/generated.stamp

build/generated.stamp: $(READY) $(MODEL) firmware/boards/targets.toml $(ROBOTS:%=generated/%) $(wildcard generated/*/*)
	@mkdir -p build
	$(VENV)/bin/python -m noslip.codegen.targets > build/targets.mk && mv build/targets.mk firmware/targets.mk
	$(foreach robot,$(ROBOTS),$(NOSLIP) generate $(robot) &&) touch $@

check-generated: $(READY)
	$(foreach robot,$(ROBOTS),$(NOSLIP) generate $(robot) --check &&) true

check: build/check.txt

build/check.txt: build/generated.stamp $(ALL_PYTHON) $(RUNTIME)
	$(NOSLIP) check > $@ || (cat $@; false)

simulate: $(RUNS:%=build/%.txt)

build/%.txt: examples/specs/%.toml build/generated.stamp $(ALL_PYTHON) $(RUNTIME)
	$(NOSLIP) simulate $< -o build/$*.csv --plot build/$*.png > $@ || (cat $@; false)

figures: build/figures$(ALL).stamp

build/figures$(ALL).stamp: build/generated.stamp $(ALL_PYTHON) $(RUNTIME) $(wildcard examples/specs/figures/*.toml)
	$(NOSLIP) figures $(ALL) -o build/figures
	@touch $@

# A page with a film for the SPEC of each robot, and for some of the figures; of a run that stops (exit 1) up to there.
FILMS := $(wildcard examples/specs/robots/*.toml) $(foreach name,waypoints fastest reversing cusp,examples/specs/figures/$(name).toml)
films: $(FILMS:%.toml=build/films/%.stamp)

build/films/%.stamp: %.toml build/generated.stamp $(ALL_PYTHON) $(RUNTIME)
	@mkdir -p $(@D)
	$(NOSLIP) simulate $< -o build/films/$(*F).csv --animate build/films/$(*F).html || [ $$? = 1 ]
	@touch $@

# What `make figures` has drawn and `make films` has filmed is in the gallery. A broken link is an error.
site: $(READY_SITE)
	$(VENV)/bin/python docs/site/pages.py build/pages
	$(VENV)/bin/sphinx-build -q -E -W --keep-going -j 2 -c docs/site -d build/doctrees build/pages build/site
	@echo "pages: build/site/index.html"

playground: build/generated.stamp
	$(VENV)/bin/python examples/playground/build.py build/playground
	@echo "page: build/playground/index.html"

PYTEST := $(VENV)/bin/pytest -n 2 --dist loadgroup --no-loadscope-reorder
QUICK := rooms names poles structure model verify codegen

# The repository's root is the package noslip: mypy finds it by a link of that name.
types: $(READY_DEV)
	@mkdir -p build/types && ln -sfn $(CURDIR) build/types/noslip
	cd build/types && $(CURDIR)/$(VENV)/bin/mypy --config-file ../../pyproject.toml $(foreach room,model codegen $(ROOMS),-p noslip.$(room))

lint: $(READY_DEV)
	$(VENV)/bin/ruff check .

export PYTHONDONTWRITEBYTECODE := # what is started here finds noslip compiled
quick: lint types check-generated
	$(PYTEST) $(QUICK:%=tests/*/test_%.py)

test: $(READY_DEV)
	$(MAKE) --no-print-directory -j3 lint types suite # the types are checked on a core that the tests leave idle

# Tests run make themselves, without this one's jobs. That an assert explains itself takes each process 9 s: only where one fails.
suite: $(READY_DEV)
	@unset MAKEFLAGS MFLAGS; echo '$(PYTEST)'; \
	  $(PYTEST) --assert=plain || { $(PYTEST) --last-failed --last-failed-no-failures=none; exit 1; }

test-%: $(READY_DEV)
	$(PYTEST) tests/$*

by-day: $(READY_DEV)
	rm -rf build/by_day # where nothing is compiled yet, as in a clean clone
	COVERAGE_FILE=build/lines NOSLIP_CACHE=$(CURDIR)/build/by_day env -u MAKEFLAGS -u MFLAGS $(PYTEST) \
	  -m 'not nightly or left' --cov=noslip --cov-context=test --cov-report= --junitxml=build/times.xml
	$(VENV)/bin/python -m noslip.tests.by_day build/times.xml build/lines

margins: $(READY_DEV)
	env -u MAKEFLAGS -u MFLAGS $(PYTEST) --margins=build/margins.json

nightly: $(READY_DEV) $(READY_SITE)
	env -u MAKEFLAGS -u MFLAGS $(VENV)/bin/python -m noslip.tests.nightly_run

bench: $(READY_DEV)
	$(VENV)/bin/python checks/bench/run.py $(ALL)

bits: $(READY_DEV)
	$(VENV)/bin/python tests/runtime_c/test_bits.py

firmware:
	$(MAKE) --no-print-directory -C firmware all BUILD=$(CURDIR)/build/firmware

firmware-test: $(READY_DEV)
	$(VENV)/bin/python -m noslip.tests.firmware

# With UPDATE=--update what is measured becomes the budget.
guarantees: $(READY_DEV)
	$(VENV)/bin/python -m noslip.checks.guarantees $(UPDATE)

# Every float in range against a higher precision (minutes on two cores), and a dense sample of doubles.
trig-sweep:
	@mkdir -p build
	$(CC) $(standard) -O2 -Iruntime_c tests/c/trig_sweep.c -lm -o build/trig_sweep
	build/trig_sweep float 1 0 2 & other=$$!; build/trig_sweep float 1 1 2 && wait $$other
	build/trig_sweep double 100000000 1992
	build/trig_sweep atan2 50000000 1992
	build/trig_sweep functions 1 20000000 1992

dist: $(READY_DEV)
	rm -rf dist
	$(VENV)/bin/python -m build --quiet --outdir dist .
	version=$$($(VENV)/bin/noslip --version | cut -d' ' -f2); $(MAKE) --no-print-directory dist/noslip-c-$$version.zip
	@ls dist

# The same bytes wherever it is made: the times in it are those of the commit, in UTC.
dist/noslip-c-%.zip:
	@rm -rf build/zip && mkdir -p dist build/zip
	git -c core.autocrlf=false archive HEAD codegen/runtime.py runtime_c | tar -x -C build/zip
	$(PYTHON) build/zip/codegen/runtime.py build/zip/for_users
	TZ=UTC0 git -c core.autocrlf=false archive --format=zip -o $@ --prefix=noslip-c-$*/runtime_c/ \
	  $$(printf -- '--add-file=%s ' build/zip/for_users/*) --prefix=noslip-c-$*/ HEAD LICENSE README.md docs/paths.md \
	  docs/firmware.md generated

clean:
	rm -rf dist build $(VENV) *.egg-info .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
