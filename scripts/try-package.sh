#!/bin/bash
# Packs the workspace's crates as for crates.io, builds examples/embedded from the packages alone and runs it. Wants a tree
# without changes; --allow-dirty packs the tree as it is.
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="$PATH:$HOME/.cargo/bin"
target=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
# What is packed is built below, with other flags than here: cargo need not build it as well.
cargo package --workspace --locked --no-verify "$@"
out=$target/try-package
rm -rf "$out/packages" "$out/embedded"
mkdir -p "$out/packages"
for package in "$target"/package/*.crate; do
    tar -xzf "$package" -C "$out/packages"
    printf '%s: %s bytes\n' "$(basename "$package")" "$(stat -c %s "$package")"
done
cp -r examples/embedded "$out/embedded"
rm -rf "$out/embedded/target"
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -1)
# The packages stand in for crates.io's until they are there.
sed -i 's/^bismar = .*/bismar = "'"$version"'"/' "$out/embedded/Cargo.toml"
cat >>"$out/embedded/Cargo.toml" <<EOF

[patch.crates-io]
bismar = { path = "../packages/bismar-$version" }
bismar-scene = { path = "../packages/bismar-scene-$version" }
bismar-transport = { path = "../packages/bismar-transport-$version" }
bismar-embree4-sys = { path = "../packages/bismar-embree4-sys-$version" }
EOF
# The versions that are tested here; what the crate does not need of them falls away.
cp Cargo.lock "$out/embedded/Cargo.lock"
cd "$out/embedded"
CARGO_TARGET_DIR=$out/target cargo run --release
