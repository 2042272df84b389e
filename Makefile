# palpate: `make demo` shows it, `make test` proves it. See docs/contributing/development.md.
SHELL := /bin/bash
export FUZZ_SECONDS ?= 10
# of `make test`: some of checks release asan fuzz, or asan-all builds tsan
STAGES ?=

.PHONY: demo test bench manual format clean help

help:
	@echo "make demo     build palpate, let a simulated hand feel a generated knee, write a report"
	@echo "make test     every test and check; FUZZ_SECONDS=10 for each fuzzer; STAGES='checks release' for some"
	@echo "make bench    comparisons with other libraries, same work in one run"
	@echo "make manual   the manual as a site, build/manual/docs/README.html"
	@echo "make format   clang-format every file"
	@echo "make clean    remove build/ and out/"

demo:
	@tools/demo

test:
	@tools/test $(STAGES)

bench:
	@tools/bench

manual:
	@tools/setup --manual
	@sphinx-build -q -W --keep-going -b html -c docs/site . build/manual
	@echo "build/manual/docs/README.html"

format:
	@tools/check_format --fix

clean:
	rm -rf build out
