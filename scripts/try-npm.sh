#!/bin/bash
# Packs the npm packages with target/debug/bismar, which is built (or takes those in target/npm: --packed), installs them into
# an empty folder without a network, and runs npm/test, the types and the commands of docs/npm.md.
# --roots: in clean roots of Debian 12 and 13 (target/npm-bookworm, target/npm-trixie), with their Node; needs root.
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="$PATH:$HOME/.cargo/bin"
packed=false roots=false
for flag in "$@"; do
    case $flag in
    --packed) packed=true ;;
    --roots) roots=true ;;
    *) echo "usage: $0 [--packed] [--roots]" >&2; exit 64 ;;
    esac
done
scripts/setup.sh --npm
if ! $packed; then
    cargo build --quiet --locked --package bismar --bin bismar
    target=$(cargo metadata --no-deps --format-version 1 | sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
    scripts/make-npm.sh "$target/debug/bismar"
fi
# Another network, in which there is nothing.
offline=()
if unshare --net true 2>/dev/null; then offline=(unshare --net); fi

# try FOLDER COMMAND...: installs into FOLDER and tests there, in the root that COMMAND enters.
try() {
    local folder=$1
    shift
    cp target/npm/*.tgz "$folder"
    mkdir "$folder/try" "$folder/repository" "$folder/repository/python"
    cp -r scenes "$folder/repository"
    cp -r python/bismar "$folder/repository/python"
    cp npm/test/*.mjs "$folder/try"
    sed -n '/^```js$/,/^```$/{/^```/!p}' docs/npm.md >"$folder/try/docs.mjs"
    ln -s ../repository/scenes "$folder/try/scenes"
    "${offline[@]}" "$@" bash -c '
        set -euo pipefail
        cd "$0/try"
        export BISMAR_REPOSITORY=$0/repository npm_config_cache=$0/cache
        npm install --no-audit --no-fund --offline ../bismar-linux-x64-gnu-*.tgz ../bismar-[0-9]*.tgz
        [ "$(find node_modules -mindepth 1 -maxdepth 2 -name package.json | wc -l)" = 1 ]
        du -sb --apparent-size node_modules
        node docs.mjs
        [ -s cornell.png ]
        node --test' "${inside:-$folder}"
}

if ! $roots; then
    folder=$(mktemp -d)
    trap 'rm -rf "$folder"' EXIT
    try "$folder"
    # The types, if a compiler is there: npm may be without a network.
    tsc=target/npm-tools/node_modules/typescript/bin/tsc
    [ -f $tsc ] || npm install --silent --no-audit --no-fund --no-save --prefix target/npm-tools typescript@5 || true
    if [ -f $tsc ]; then
        cp npm/test/types.mts npm/test/types.cts "$folder/try"
        node $tsc --noEmit --strict --module node16 --target es2022 "$folder"/try/types.mts "$folder"/try/types.cts
    else
        echo "npm: types not checked: there is no typescript" >&2
    fi
    exit
fi

for suite in bookworm trixie; do
    root=$PWD/target/npm-$suite
    if ! [ -e "$root/ready" ]; then
        rm -rf "$root"
        debootstrap --variant=minbase --keyring=/usr/share/keyrings/debian-archive-keyring.gpg $suite "$root" >"$root.log"
        chroot "$root" env DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends nodejs npm >>"$root.log"
        touch "$root/ready"
    fi
    rm -rf "$root/tmp/try"
    mkdir "$root/tmp/try"
    echo "== $suite: $(chroot "$root" node --version), $(chroot "$root" ldd --version | head -n 1)"
    # shellcheck disable=SC2016
    inside=/tmp/try try "$root/tmp/try" unshare --mount --pid --fork bash -c '
        mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev" && exec chroot "$0" "$@"' "$root"
done
