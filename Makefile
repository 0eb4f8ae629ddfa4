# What a person types and what CI runs are the same lines.
# `make demo` and `make test` install what is missing on Debian and Ubuntu (OpenCV and libclang, for the detector) and say so.

PACKAGES := libopencv-dev libopencv-contrib-dev clang libclang-dev pkg-config
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: demo test setup format lint docs bench bench-build clean

## Make a small recording, detect, solve, and compare with the truth.
demo: setup
	cargo run --release --quiet -- demo

## All tests. Those on real recordings say "skipped: no recordings" where these are absent.
test: setup
	cargo test --release

setup:
	@command -v cargo >/dev/null || { echo "cellmap needs Rust 1.89 or newer: install it with rustup, then run make again"; exit 1; }
	@missing=""; for package in $(PACKAGES); do \
	    dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q "ok installed" || missing="$$missing $$package"; \
	done; \
	if [ -n "$$missing" ]; then \
	    command -v apt-get >/dev/null || { echo "cellmap needs OpenCV 4 with its contrib modules, clang and libclang: install them, then run make again"; exit 1; }; \
	    echo "installing the Debian packages$$missing"; \
	    $(SUDO) apt-get update -qq && \
	    DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $$missing >/dev/null || exit 1; \
	fi

format:
	cargo fmt --check

lint: setup
	cargo clippy --release --all-targets -- -D warnings
	cargo clippy --release --lib --bins --no-default-features -- -D warnings

docs: setup
	RUSTDOCFLAGS="-D warnings" cargo doc --release --no-deps

bench: setup
	cargo bench

bench-build: setup
	cargo bench --no-run

clean:
	cargo clean
