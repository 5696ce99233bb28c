#!/bin/bash
# Builds the Python wheel into target/wheel: maturin compiles python/, auditwheel copies the installed Embree and TBB in.
# make-wheel.sh [PROFILE]: release, if no other is given.
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="$PATH:$HOME/.cargo/bin"
profile=${1:-release}
scripts/setup.sh --python
PATH="$PWD/target/wheel-tools/bin:$PATH"
out=target/wheel
rm -rf "$out"
mkdir -p "$out/linked"
maturin build --quiet --locked --profile "$profile" --manifest-path python/Cargo.toml --auditwheel skip --out "$out/linked"
# The libraries that the wheel may expect of a system are those of the oldest glibc that this one's symbols need.
auditwheel repair --plat auto --wheel-dir "$out" "$out"/linked/*.whl
ls -l "$out"/*.whl
