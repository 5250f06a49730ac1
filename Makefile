# make         sets up, generates and builds the C, checks it against the model, follows a line and a circle
# make test    every test
# make figures every figure of the paper and further ones, with their claims checked: build/figures/report.html
# make bench   instruction counts, sizes and rates beside peers; make bits: the same bits on every target there is
# make firmware the images of every target whose tools are here, into build/firmware
# make firmware-test   runs them, every law's bits and closed loops in QEMU, and compares with this host
# make guarantees   what holds of the C and what shows it, checked; see guarantees/README.md
# make clean   leaves what git has
PYTHON ?= python3
VENV := .venv
NOSLIP := $(VENV)/bin/noslip
READY := $(VENV)/.ready
export NOSLIP_CACHE ?= $(CURDIR)/build/compiled

MODEL := $(wildcard __init__.py model/*.py model/robots/*.py codegen/*.py)
ALL_PYTHON := $(MODEL) $(wildcard harness/*.py harness/*/*.py)
RUNTIME := $(wildcard runtime_c/*)
ROBOTS := labmate
RUNS := line circle

.PHONY: all setup generate check-generated check simulate figures test bench bits firmware firmware-test guarantees trig-sweep clean
.DELETE_ON_ERROR:

all: check simulate
	@cat build/check.txt $(RUNS:%=build/%.txt)
	@echo
	@echo "pictures: $(RUNS:%=build/%.png)"

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

generate: build/generated.stamp

build/generated.stamp: $(READY) $(MODEL) $(ROBOTS:%=generated/%) $(wildcard generated/*/*)
	@mkdir -p build
	$(foreach robot,$(ROBOTS),$(NOSLIP) generate $(robot) && $(NOSLIP) generate $(robot) --check &&) touch $@

check-generated: $(READY)
	$(foreach robot,$(ROBOTS),$(NOSLIP) generate $(robot) --check &&) true

check: build/check.txt

build/check.txt: build/generated.stamp $(ALL_PYTHON) $(RUNTIME)
	$(NOSLIP) check > $@ || (cat $@; false)

simulate: $(RUNS:%=build/%.txt)

build/%.txt: specs/%.toml build/generated.stamp $(ALL_PYTHON) $(RUNTIME)
	$(NOSLIP) simulate $< -o build/$*.csv --plot build/$*.png > $@ || (cat $@; false)

figures: build/figures.stamp

build/figures.stamp: build/generated.stamp $(ALL_PYTHON) $(RUNTIME) $(wildcard specs/figures/*.toml)
	$(NOSLIP) figures -o build/figures
	@touch $@

test: export PYTHONDONTWRITEBYTECODE := # what the tests start finds noslip compiled
test: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/python -m pytest -n 2 --dist loadgroup --no-loadscope-reorder

bench: $(READY)
	$(VENV)/bin/python bench/run.py

bits: $(READY)
	$(VENV)/bin/python tests/test_bits.py

firmware:
	$(MAKE) --no-print-directory -C firmware all BUILD=$(CURDIR)/build/firmware

firmware-test: $(READY)
	$(VENV)/bin/python -m noslip.tests.firmware

# With UPDATE=--update what is measured becomes the budget.
guarantees: $(READY)
	$(VENV)/bin/python -m noslip.guarantees $(UPDATE)

# Every float in range against a higher precision (about a minute on two cores), and a dense sample of doubles.
trig-sweep:
	@mkdir -p build
	$(CC) -std=c99 -O2 -ffp-contract=off -fno-math-errno -Iruntime_c tests/c/trig_sweep.c -lm -o build/trig_sweep
	build/trig_sweep float 1 0 2 & other=$$!; build/trig_sweep float 1 1 2 && wait $$other
	build/trig_sweep double 100000000 1992
	build/trig_sweep atan2 50000000 1992

clean:
	rm -rf build $(VENV) *.egg-info .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
