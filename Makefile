# What anyone types while working on primfit. `make help` lists it.
.DEFAULT_GOAL := help
.PHONY: help dev test quick lint rust fuzz docs bench wheel sdist ci

GLIBC ?= 2_28

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' Makefile | expand -t 10

dev:  ## editable build with every extra and tool; again after a change of Rust
	pip install --editable ".[dev]"

test:  ## all Python tests; one: make test ARGS="tests/test_planes.py -k corner"
	pytest $(ARGS)

quick:  ## tests of every part that take less than a minute of CPU together
	pytest -m quick $(ARGS)

lint:  ## style and types of Python and Rust
	ruff check .
	ruff format --check .
	mypy
	cargo fmt --check
	cargo clippy --workspace --all-targets --locked -- -D warnings

rust:  ## tests of the Rust crates
	cargo test --locked

fuzz:  ## damaged files for every reader, for a minute
	python fuzz/files.py --seconds 60 --seed "$$(date +%Y%m%d)"

docs:  ## the site, in site/; warnings are errors
	mkdocs build --strict

bench:  ## accuracy on our reference
	python benches/accuracy.py $(ARGS)

wheel:  ## a wheel in dist/ for any Linux with glibc 2.28 or later (GLIBC=2_17 for older ones)
	maturin build --release --locked --zig --compatibility manylinux_$(GLIBC) --out dist

sdist:  ## the source, with tests and docs, in dist/
	maturin sdist --out dist

ci:  ## what CI does, on a clone of what is committed
	.ci/run
