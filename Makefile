# `make render` and `make test` work as the first command in a fresh clone; everything that they make is in target/ and
# out/.

SHOWPIECE := scenes/showpiece.glb
RENDER_FLAGS :=
CARGO := $(shell command -v cargo || echo "$$HOME/.cargo/bin/cargo")

NAME := $(basename $(notdir $(SHOWPIECE)))
BISMAR := target/release/bismar

.DEFAULT_GOAL := help
.PHONY: help setup build render test deb try-container wheel try-wheel npm try-npm try-npm-roots try-docs bench bench-peers agreement stability clean

help:
	@echo "make setup   installs what is missing: Embree 4, libclang, a C linker"
	@echo "make build   builds $(BISMAR)"
	@echo "make render  renders $(SHOWPIECE) to out/$(NAME).exr and .png (SHOWPIECE=..., RENDER_FLAGS=...)"
	@echo "make test    formatting, lints, tests, documentation"
	@echo "make deb     packs both programs for Debian (target/bismar_*.deb)"
	@echo "make try-container  builds container/Containerfile with that package and tries it"
	@echo "make wheel   builds the Python package (target/wheel/*.whl), with Embree in it"
	@echo "make try-wheel  tests it in a clean virtual environment"
	@echo "make npm     packs the npm packages (target/npm/*.tgz), with the program and Embree in them"
	@echo "make try-npm tests them in an empty folder without a network; try-npm-roots in Debian 12 and 13"
	@echo "make try-docs  runs every command of docs/guide.md and docs/gallery.md"
	@echo "make bench   a render against the limit of its rays, threads, allocations, set-up, memory"
	@echo "make bench-peers  error against seconds, side by side with Mitsuba 3 and Cycles (needs Python, 1.5 GiB)"
	@echo "make agreement    converged pictures against Mitsuba's"
	@echo "make stability    every --balance through the ways to fail, into docs/stability.md (minutes)"
	@echo "make clean   removes target/ and out/"

setup:
	@scripts/setup.sh

build: setup
	$(CARGO) build --release --locked

# Without the studies, which take as long to build again.
render: setup
	$(CARGO) build --release --locked --package bismar
	@mkdir -p out
	$(BISMAR) render $(SHOWPIECE) -o out/$(NAME).exr --preview out/$(NAME).png $(RENDER_FLAGS)

test: setup
	@scripts/test.sh "$(CARGO)"

deb: build
	@scripts/make-deb.sh

try-container: deb
	@scripts/try-container.sh

wheel: setup
	@scripts/make-wheel.sh

try-wheel: setup
	@scripts/try-wheel.sh

npm: build
	@scripts/make-npm.sh

try-npm: setup
	@scripts/try-npm.sh

try-npm-roots: setup
	@scripts/try-npm.sh --roots

try-docs: build
	scripts/try-docs.sh

bench: build
	$(CARGO) bench --package bismar-study --locked --bench replay -- $(BENCH_FLAGS)

# BENCH_FLAGS="--quick" for a look; docs/throughput.md and lab/peers.md say what is measured.
bench-peers: build
	lab/bench-peers/setup.sh target/peers
	target/peers/mitsuba/bin/python lab/bench-peers/bench.py $(BENCH_FLAGS)

agreement: build
	lab/bench-peers/setup.sh target/peers
	target/peers/mitsuba/bin/python lab/bench-peers/bench.py --agreement --peers mitsuba --scenes cornell,veach,blob $(BENCH_FLAGS)

stability: build
	$(BISMAR) study stability --out out/stability
	scripts/stability-page.sh out/stability/stability.md >docs/stability.md

clean:
	$(CARGO) clean
	rm -rf out
