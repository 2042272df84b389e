# palpate: `make demo` shows it, `make test` proves it. See docs/contributing/development.md.
SHELL := /bin/bash
export FUZZ_SECONDS ?= 5

.PHONY: demo test test-ci test-all bench manual package web test-web format clean help

help:
	@echo "make demo      build palpate, let a simulated hand feel a generated knee, write a report"
	@echo "make test      build, and run the tests that every commit has to pass"
	@echo "make test-ci   these and the rest of what decides a landing: journeys, sanitizers, fuzzers (FUZZ_SECONDS=5)"
	@echo "make test-all  every test and check there is; goes on where an interrupted run stopped"
	@echo "make bench     comparisons with other libraries, same work in one run"
	@echo "make manual    the manual as a site, build/manual/docs/README.html"
	@echo "make package   Debian packages, an archive that runs from any folder and a Python wheel, in out/packages"
	@echo "make web       the page without a server: a folder of files with palpate in WebAssembly, web/dist-static/"
	@echo "make test-web  make web, its forces compared with those of the program, and the page in a browser"
	@echo "make format    clang-format every file"
	@echo "make clean     remove build/ and out/"

demo:
	@tools/demo

test:
	@tools/test checks release

# goes on after `make test` where that has passed on the same sources
test-ci:
	@tools/test --resume checks release ci asan fuzz

test-all:
	@tools/test --resume checks release ci asan fuzz nightly asan-all tsan builds

bench:
	@tools/bench

manual:
	@tools/setup && tools/setup --manual
	@tools/build_program palpate-verify
	@sphinx-build -q -W --keep-going -b html -c docs/site . build/manual
	@echo "build/manual/docs/README.html"

package:
	@tools/setup
	@tools/build_program palpate_packaged
	@tools/make_packages build/release out/packages

web:
	@tools/build_web

test-web: web
	@tools/setup --test
	@tools/build_program palpate_c
	@PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=bindings/python PALPATE_LIBRARY=build/release/src/bindings/c/libpalpate.so \
	  /usr/bin/python3 tests/wasm/forces_test.py web/dist-static/assets/palpate.wasm
	@PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=bindings/python PALPATE_LIBRARY=build/release/src/bindings/c/libpalpate.so \
	  /usr/bin/python3 tests/wasm/files_test.py web/dist-static/assets/palpate.wasm
	@/usr/bin/python3 tests/browser/static_test.py web/dist-static

format:
	@tools/check_format --fix

clean:
	rm -rf build out web/dist-static
