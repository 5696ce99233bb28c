# `make render` and `make test` work as the first command in a fresh clone; everything that they make is in target/ and
# out/.

SHOWPIECE := scenes/showpiece.glb
RENDER_FLAGS :=
CARGO := $(shell command -v cargo || echo "$$HOME/.cargo/bin/cargo")

NAME := $(basename $(notdir $(SHOWPIECE)))
BISMAR := target/release/bismar

.DEFAULT_GOAL := help
.PHONY: help setup build render test clean

help:
	@echo "make setup   installs what is missing: Embree 4, libclang, a C linker"
	@echo "make build   builds $(BISMAR)"
	@echo "make render  renders $(SHOWPIECE) to out/$(NAME).exr and .png (SHOWPIECE=..., RENDER_FLAGS=...)"
	@echo "make test    formatting, lints, tests, documentation"
	@echo "make clean   removes target/ and out/"

setup:
	@scripts/setup.sh

build: setup
	$(CARGO) build --release --locked

render: build
	@mkdir -p out
	$(BISMAR) render $(SHOWPIECE) -o out/$(NAME).exr --preview out/$(NAME).png $(RENDER_FLAGS)

test: setup
	$(CARGO) fmt --all --check
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings
	$(CARGO) test --workspace --locked
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked

clean:
	$(CARGO) clean
	rm -rf out
