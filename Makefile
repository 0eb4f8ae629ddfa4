# What a person types and what CI runs are the same lines.
# Everything needs only cargo, except what is called opencv: that is the optional second finder of patterns, and
# `make setup-opencv` installs its packages on Debian and Ubuntu and says so.

PACKAGES := libopencv-dev libopencv-contrib-dev clang libclang-dev pkg-config
# Waits for whoever else is installing, and asks again when the network stumbles.
APT := -o DPkg::Lock::Timeout=600 -o Acquire::Retries=3
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: demo dist test test-opencv setup-opencv format lint lint-opencv docs book-pages bench bench-build clean

## Make a small recording, detect, solve, and compare with the truth.
demo:
	cargo run --release --quiet -- demo

## The program as one file, target/dist/cellmap, which needs no library of the machine that it runs on, the C library neither.
dist:
	cargo rustc --profile dist --bin cellmap -- -C target-feature=+crt-static

## All tests. Those on real recordings say "skipped: no recordings" where these are absent.
test:
	cargo test --release

## What OpenCV as a second finder can break.
test-opencv: setup-opencv
	cargo test --release --features opencv --lib --test detect_dictionaries --test detect_native --test detect_pictures --test detect_recordings
	CELLMAP_DETECTOR=opencv cargo test --release --features opencv --test detect_recordings

setup-opencv:
	@missing=""; for package in $(PACKAGES); do \
	    dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q "ok installed" || missing="$$missing $$package"; \
	done; \
	if [ -n "$$missing" ]; then \
	    command -v apt-get >/dev/null || { echo "this needs OpenCV 4 with its contrib modules, clang and libclang: install them, then run make again"; exit 1; }; \
	    echo "installing the Debian packages$$missing"; \
	    $(SUDO) apt-get $(APT) update -qq && \
	    $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get $(APT) install -y -qq --no-install-recommends $$missing >/dev/null || exit 1; \
	fi

format:
	cargo fmt --check

lint:
	cargo clippy --release --all-targets -- -D warnings

lint-opencv: setup-opencv
	cargo clippy --release --features opencv --lib --bins --bench detection_table --test detect_dictionaries --test detect_recordings -- -D warnings

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc --release --no-deps

## What of the book is generated: keys, errors, and with Chromium its pictures. Tests say when the first two are stale.
book-pages:
	cargo run --release --quiet -- schema --page > docs/src/keys.md
	cargo run --release --quiet --example error_page > docs/src/errors.md
	cargo run --release --quiet --example book_pictures -- target/release/cellmap

bench:
	cargo bench

bench-build:
	cargo bench --no-run

clean:
	cargo clean
