# SPDX-License-Identifier: MIT
# Each command installs what it needs first; `make` alone lists them.
.PHONY: help demo test test-long hours fresh bits coverage fuzz check compilers mutate \
	format lock firmware sim hardware bench pictures release site installed setup clean
.DEFAULT_GOAL := help

PYTHON ?= python3
BOARD ?= nano
environment = $(BOARD:f405=stm32f405)
export PATH := $(CURDIR)/.venv/bin:$(PATH)
export PLATFORMIO_SETTING_ENABLE_TELEMETRY := no
export PLATFORMIO_DISABLE_UPGRADE_CHECK := true
unexport PLATFORMIO_CORE_DIR
# Compile modules once, not in each of the hundreds of processes that tests start.
unexport PYTHONDONTWRITEBYTECODE
# Tests run in several processes: those that load the firmware's C under the address
# sanitizer, then the others, of which many wait, so that there are more than cores
# (docs/decisions/tests.md). C++ that throws has to be there before the
# sanitizer, and what that complains of would go down with a process's stderr.
cores := $(shell nproc)
log := detect_leaks=0:log_path=$(CURDIR)/build/sanitizer
asan := IMU_ASAN=1 ASAN_OPTIONS=$(log) UBSAN_OPTIONS=$(log) \
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) libstdc++.so.6"
tests := python -m pytest -q --dist loadfile --max-worker-restart 2 --durations 10
# Both run, even if the first fails; the status covers both.
both = $(asan) $(tests) -n $(cores) -m "native$(1)" $(2) || status=1; \
	$(tests) -n $(shell expr 2 \* $(cores) + 1) -m "not native$(1)" $(2) || status=1; \
	exit $$status

# One thread for arrays in each process: more would wait for each other.
test test-long coverage: export OPENBLAS_NUM_THREADS := 1

help: ## lists the commands
	@sed -n 's/^\([a-z0-9-]*\):.*## /\1\t/p' Makefile | expand -t 14

demo: ## virtual probes, daemon, subscriber (BOARD=nano, f405, both, pico, mega)
	@$(PYTHON) tools/setup.py demo --board $(BOARD)
	@imud demo --board $(BOARD) $(if $(SECONDS),--seconds $(SECONDS))

# Programs that want a processor all the time, to see that no test minds.
beside = $(if $(BESIDE),busy=; trap 'kill $$busy' EXIT; \
	for each in $$(seq $(BESIDE)); do while :; do :; done & busy="$$busy $$!"; done;)

test: ## all tests, those of the C under sanitizers (BESIDE=6 busy loops, ORDER=7 of files)
	@$(PYTHON) tools/setup.py test
	@export IMU_SAMPLE=1 IMU_ORDER=$(ORDER); status=0; $(beside) $(both)

test-long: ## the tests that `make test` shortens, in full
	@$(PYTHON) tools/setup.py test-long
	@export IMU_LONG=1; status=0; \
	  $(call both, and (long or sampled or nightly or hypothesis),-o timeout=1800)

hours: ## twelve hours of both boards, with faults from a seed (HOURS=12 SEED=1 MINUTES=)
	@$(PYTHON) tools/setup.py demo
	@cd tests && python -m hours --hours $(or $(HOURS),12) --seed $(or $(SEED),1) \
	  $(if $(MINUTES),--minutes $(MINUTES)) $(if $(FRESH),--fresh)

fresh: ## demo and tests in a fresh clone on bare Debian 12 and 13 (SUITE=trixie)
	@$(PYTHON) tools/fresh.py $(SUITE:%=--suite %)

bits: ## checks that ten minutes of recordings give the same poses on every processor
	@$(PYTHON) tools/setup.py test
	@IMU_BITS_SECONDS=600 python -m pytest -q -o timeout=1800 tests/system/test_bits.py

coverage: ## fails if the tests of firmware/core leave out a line of it
	@$(PYTHON) tools/setup.py coverage
	@rm -rf build/native
	@IMU_COVERAGE=1 python -m pytest -q -n $(cores) --dist loadfile -m native \
	  tests/core tests/protocol
	@gcovr --merge-lines --fail-under-line 100 --filter firmware/core/ build/native

fuzz: ## random input, with clang's fuzzer (SECONDS=60 for each target)
	@$(PYTHON) tools/setup.py check
	@$(MAKE) --silent --directory tests/fuzz fuzz

check: ## formatting, lints, types, the rules of the house; all three compilers
	@$(PYTHON) tools/setup.py check
	@python tools/check.py

mutate: ## lists small changes of a room that no test notices (ROOM=math SEED=1 COUNT=20)
	@$(PYTHON) tools/setup.py test
	@python tools/mutate.py $(or $(ROOM),math) --seed $(or $(SEED),1) \
	  --count $(or $(COUNT),20)

compilers: ## the Nano's images with avr-gcc 5.4, 7.3 and 14.2: bytes, and the reserve
	@$(PYTHON) tools/setup.py demo --board nano
	@python tools/compilers.py

format: ## formats C and Python
	@$(PYTHON) tools/setup.py check
	@python tools/check.py --format

lock: ## updates requirements.lock to the newest versions that pyproject.toml allows
	@$(PYTHON) tools/setup.py check
	@python tools/locked.py

firmware: ## image of a board (BOARD=nano, mega, f405, pico, pico-micropython, pico2-micropython), or mpy
	@$(PYTHON) tools/setup.py demo --board $(BOARD)
	@$(if $(filter mpy pico%,$(BOARD)),,pio run --environment $(environment))
	@$(if $(filter pico%,$(BOARD)),echo "build/pico/$(BOARD).uf2: copy it onto the drive that the board shows")

sim: ## builds the virtual boards: build/sim/nano, build/sim/f405
	@$(PYTHON) tools/setup.py demo

# A gigabyte that nothing else needs: docs/decisions/boards.md.
solids := build/hardware/venv
$(solids)/ready: hardware/requirements.txt
	@echo "build123d goes into $(solids): 1 GB"
	@$(PYTHON) -m venv $(solids)
	@$(solids)/bin/pip install -q -r $<
	@touch $@

hardware: $(solids)/ready ## parts to print, checked: build/hardware (ONLY=nano PICTURES=1)
	@$(solids)/bin/python -m hardware $(if $(ONLY),--only $(ONLY)) \
	  $(if $(PICTURES),--pictures)

bench: ## accuracy, or WHAT=afterwards, honesty, nano, mega, f405, micropython, pico, card, faults, host, bridge, attacks, hosts, calibration, limb, page, strokes, tip
	@$(PYTHON) -m benchmarks --check $(WHAT)
	@$(PYTHON) tools/setup.py bench
	@python -m benchmarks $(WHAT)

pictures: ## draws the plots of docs/pictures from the results of `make bench`
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/pictures/results.py

release: ## builds packages for pip, firmware, lists and sums, of the last commit: build/release/dist
	@$(PYTHON) tools/setup.py release
	@python tools/release.py $(if $(NO_SOURCES),--without-sources) $(if $(TWICE),--twice) $(if $(KEY),--key $(KEY))

site: ## builds the documents as a site with search: build/site/html; fails on broken links
	@$(PYTHON) tools/setup.py release
	@python -m sphinx -q -W --keep-going -c tools/website -d build/site/doctrees \
	  . build/site/html/$(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)

installed: ## installs the packages of `make release` on bare Debian 12 and 13 (SUITE=trixie)
	@python tools/installed.py $(SUITE:%=--suite %)

setup: ## installs everything that these commands need
	@$(PYTHON) tools/setup.py check
	@$(PYTHON) tools/setup.py bench

clean: ## removes everything that was built, but keeps .venv
	@rm -rf build .pio
