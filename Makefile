# Everything a person or a machine runs. `make demo` and `make test` work on a fresh clone with Rust, a C linker and Python 3.
export CARGO_TARGET_DIR ?= $(CURDIR)/target
BIN := $(CARGO_TARGET_DIR)/release
PYTHON_ENV := $(CARGO_TARGET_DIR)/python
export REALBEAM_PYTHON ?= $(PYTHON_ENV)/bin/python

.PHONY: build demo test fuzz page lint deny bench

# All targets in one go: Cargo would otherwise build Burn a second time for the tests, whose dependencies switch on other features.
build:
	@scripts/fetch-onnxruntime.sh $(BIN)
	cargo build --release --locked --workspace --all-targets

demo: build
	$(BIN)/realbeam-demo --out build/demo

test: build
	@scripts/python-env.sh $(PYTHON_ENV)
	cargo test --release --locked --workspace

# A minute of mutated files for everything that reads a stranger's bytes; `make fuzz FUZZ_S=3600` takes longer.
FUZZ_S ?= 60
fuzz: build
	REALBEAM_FUZZ_S=$(FUZZ_S) cargo test --release --locked --workspace --test fuzz -- --nocapture

# Looks at the server's page in a headless Chromium, and writes what it saw; needs `pip install playwright` and says so where it is missing.
page: build
	$(REALBEAM_PYTHON) scripts/look_at_page.py $(BIN)/realbeam-server build/page

lint:
	cargo fmt --all --check
	cargo clippy --release --locked --workspace --all-targets -- -D warnings

# Licences, sources and advisories of every dependency; needs `cargo install cargo-deny --locked`.
deny:
	cargo deny --locked check

bench: build
	cargo bench --locked --workspace
