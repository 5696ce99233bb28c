#!/bin/bash
# Packs target/release into target/bismar_VERSION_ARCH.deb: both programs, manual pages, completions, documents, scenes.
# What the programs need is found by dpkg-shlibdeps, so the package fits the Debian it is made on, and later ones.
set -euo pipefail
cd "$(dirname "$0")/.."

release=target/release
for program in bismar bismar-study; do
    [ -x $release/$program ] || { echo "make build first" >&2; exit 64; }
done
# Code of more than 100 kB was inlined level by level, as stacks of lobes can be, and takes minutes of every build.
large=$(nm -S --size-sort $release/bismar | awk '$3 ~ /[tT]/ && $2 > "0000000000019000" { print "0x" $2, $4 }')
[ -z "$large" ] || { printf 'functions above 100 kB:\n%s\n' "$large" >&2; exit 1; }
command -v dpkg-shlibdeps >/dev/null || { echo "needs dpkg-dev: apt install dpkg-dev" >&2; exit 69; }

version=$($release/bismar -V | cut -d' ' -f2)
arch=$(dpkg --print-architecture)
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
root=$stage/root
mkdir -p "$root/DEBIAN" "$root/usr/share/doc/bismar" "$stage/debian"

install -Dm755 -s -t "$root/usr/bin" $release/bismar $release/bismar-study
$release/bismar -q man "$root/usr/share/man/man1"
$release/bismar-study -q man "$root/usr/share/man/man1"
gzip -9n "$root"/usr/share/man/man1/*.1
for program in bismar bismar-study; do
    for place in bash:bash-completion/completions/$program zsh:zsh/vendor-completions/_$program \
        fish:fish/vendor_completions.d/$program.fish; do
        file=$root/usr/share/${place#*:}
        mkdir -p "$(dirname "$file")"
        $release/$program completions "${place%%:*}" > "$file"
    done
done
install -Dm644 -t "$root/usr/share/doc/bismar" README.md docs/*.md docs/*.png docs/*.svg
cat LICENSE-MIT LICENSE-APACHE > "$root/usr/share/doc/bismar/copyright"
install -Dm644 -t "$root/usr/share/bismar/scenes" scenes/*.glb scenes/*.hdr scenes/README.md

# dpkg-shlibdeps wants to stand beside a debian/control.
printf 'Source: bismar\n\nPackage: bismar\nArchitecture: any\n' > "$stage/debian/control"
depends=$(cd "$stage" && dpkg-shlibdeps -O root/usr/bin/bismar root/usr/bin/bismar-study 2>/dev/null)
cat > "$root/DEBIAN/control" <<END
Package: bismar
Version: $version
Architecture: $arch
Maintainer: the Bismar authors <bismar@localhost>
Section: graphics
Priority: optional
Installed-Size: $(du -sk --exclude=DEBIAN "$root" | cut -f1)
Depends: ${depends#shlibs:Depends=}
Description: offline glTF renderer
 Renders glTF 2.0 scenes by path tracing to OpenEXR and PNG, and finds, for
 each pixel, the balance between light and BSDF sampling. Needs a processor
 with AVX2.
END
package=target/bismar_${version}_$arch.deb
dpkg-deb --root-owner-group --build "$root" "$package" >/dev/null
echo "$package"
