#!/bin/bash
# Fuzzes the doors by which strangers' files come in, with libFuzzer: scripts/fuzz.sh TARGET SECONDS, or all SECONDS for one
# after the other. Seeds are tests/mutations.rs's valid files. Needs a nightly toolchain; installs cargo-fuzz into target/fuzz.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${1:?which target, or all?} seconds=${2:?for how many seconds?}
export PATH="$PWD/target/fuzz/bin:$PATH:$HOME/.cargo/bin"
[ -x target/fuzz/bin/cargo-fuzz ] || scripts/requirements/install.sh fuzz
BISMAR_SEEDS=$PWD/fuzz/corpus cargo test --quiet --test all mutations::valid_files_pass_their_doors >/dev/null
# The same dependencies and the same instructions as the program's.
cp Cargo.lock fuzz/Cargo.lock
export RUSTFLAGS="-C target-cpu=x86-64-v3"
targets=$target
[ "$target" != all ] || targets=$(cargo +nightly fuzz list)
for one in $targets; do
    # Memory: what a file may take, and the fuzzer's own.
    cargo +nightly fuzz run "$one" -- -max_total_time="$seconds" -rss_limit_mb=2048 -timeout=20 -max_len=65536
done
