#!/bin/bash
# The steps of .github/workflows, each of which is one of these words; they run on a new Debian 12 or 13 as root, too.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="$HOME/.cargo/bin:$PATH"
case "${1:-}" in
prepare)
    for tool in make curl git python3; do
        command -v $tool >/dev/null && continue
        apt-get update -qq
        apt-get install -qq --no-install-recommends ca-certificates curl git make python3 >/dev/null
    done
    command -v cargo >/dev/null || curl -sSf https://sh.rustup.rs | sh -s -- -y --profile minimal -c clippy,rustfmt
    # A container's checkout belongs to another user.
    git config --global --get-all safe.directory 2>/dev/null | grep -qxF "$PWD" || git config --global --add safe.directory "$PWD"
    ;;
readme) make render ;;
test) CI=true .ci/run ;;
packages)
    scripts/setup.sh --python --npm </dev/null
    make deb wheel npm
    scripts/workflow.sh collect
    ;;
collect)
    rm -rf target/release-files
    mkdir -p target/release-files
    cp target/bismar_*.deb target/wheel/*.whl target/npm/*.tgz target/release-files/
    (cd target/release-files && sha256sum -- * >SHA256SUMS)
    ;;
*)
    echo "usage: $0 prepare|readme|test|packages|collect" >&2
    exit 64
    ;;
esac
