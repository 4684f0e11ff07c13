# SPDX-License-Identifier: MIT
# Each command installs what it needs first; `make` alone lists them.
.PHONY: help demo test bits coverage fuzz check format firmware sim bench bench-nano \
	bench-f405 bench-card bench-host pictures setup clean
.DEFAULT_GOAL := help

PYTHON ?= python3
BOARD ?= nano
environment = $(BOARD:f405=stm32f405)
export PATH := $(CURDIR)/.venv/bin:$(PATH)
export PLATFORMIO_SETTING_ENABLE_TELEMETRY := no
export PLATFORMIO_DISABLE_UPGRADE_CHECK := true
unexport PLATFORMIO_CORE_DIR
asan := IMU_ASAN=1 ASAN_OPTIONS=detect_leaks=0 \
	LD_PRELOAD=$$(gcc -print-file-name=libasan.so)

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 14

demo: ## virtual probes, the daemon, a subscriber (BOARD=nano, f405, both; SECONDS=15)
	@$(PYTHON) tools/setup.py demo
	@python tools/demo.py --board $(BOARD) $(if $(SECONDS),--seconds $(SECONDS))

test: ## all tests; those of the C once more under the address sanitizer
	@$(PYTHON) tools/setup.py test
	@$(asan) python -m pytest -q -m native; first=$$?; python -m pytest && exit $$first

bits: ## ten minutes of recordings have the same poses on every processor
	@$(PYTHON) tools/setup.py test
	@IMU_BITS_SECONDS=600 python -m pytest -q -o timeout=1800 tests/system/test_bits.py

coverage: ## fails where a line of firmware/core is run by no test
	@$(PYTHON) tools/setup.py coverage
	@rm -rf build/native
	@IMU_COVERAGE=1 python -m pytest -q -m native
	@gcovr --fail-under-line 100 --filter firmware/core/ build/native

fuzz: ## any input at all, with clang's fuzzer (SECONDS=60 for each target)
	@$(PYTHON) tools/setup.py check
	@$(MAKE) --silent --directory tests/fuzz fuzz

check: ## formatting, lints, types, the rules of the house; all three compilers
	@$(PYTHON) tools/setup.py check
	@python tools/check.py

format: ## lays out C and Python
	@$(PYTHON) tools/setup.py check
	@python tools/check.py --format

firmware: ## the image of a board (BOARD=nano, f405): .pio/build/nano/firmware.hex
	@$(PYTHON) tools/setup.py demo
	@pio run --environment $(environment)

sim: ## the virtual boards: build/sim/nano, build/sim/f405
	@$(PYTHON) tools/setup.py demo

bench: ## accuracy on recordings with optical truth, beside VQF: tables and JSON
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/accuracy.py
	@python benchmarks/accuracy.py --board f405

bench-nano: ## cycles, stack, flash and RAM: the image, its parts, every filter
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/cycles.py

bench-f405: ## the same of the F405: instructions, both of its rates, every filter
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/cycles.py --board f405

bench-card: ## an hour of logging on the virtual F405, compared with its wire
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/card.py

bench-host: ## the daemon: decoding, latency, CPU, memory, clocks; 12 h with faults
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/host.py
	@python benchmarks/clocks.py
	@python benchmarks/soak.py

pictures: ## docs/pictures, from what `make bench` has measured
	@$(PYTHON) tools/setup.py bench
	@python benchmarks/picture.py

setup: ## everything any of these needs
	@$(PYTHON) tools/setup.py check
	@$(PYTHON) tools/setup.py bench

clean: ## removes what was built; .venv stays
	@rm -rf build .pio
