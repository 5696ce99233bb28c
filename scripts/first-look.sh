#!/bin/bash
# The table of README.md: error and CPU seconds (of all threads) of every balance at the same number of paths, on two
# scenes, against a reference of 4096 paths a pixel by the balance heuristic; stderr has the comparison of docs/noise.md.
# Pictures go to out/first-look; references are kept.
#   scripts/first-look.sh [SPP]
set -euo pipefail
cd "$(dirname "$0")/.."
spp=${1:-64} size=96x64 seeds="1 2 3 4 5 6 7 8"
bismar=target/release/bismar out=out/first-look
mkdir -p "$out"
TIMEFORMAT=%U

# A number of a JSON file by its key.
number() { sed -n "s/^ *\"$1\": *\([-+0-9.e]*\),\{0,1\}$/\1/p" "$2" | head -n 1; }

echo "| scene | \`--balance\` | relMSE | CPU seconds |"
echo "| --- | --- | --- | --- |"
for scene in veach glossy-sun; do
    sky=()
    [ -f "scenes/$scene.hdr" ] && sky=(--env "scenes/$scene.hdr")
    render() { "$bismar" -q render "scenes/$scene.glb" "${sky[@]}" --size $size --aov none "$@"; }
    reference=$out/$scene-reference.exr
    [ -f "$reference" ] || render --balance half --spp 4096 --seed 1000 -o "$reference"
    for balance in half power max second-order progressive; do
        for seed in $seeds; do
            picture=$out/$scene-$balance-$seed
            seconds=$({ time render --balance $balance --spp "$spp" --seed "$seed" -o "$picture.exr" \
                --stats "$picture.json"; } 2>&1)
            "$bismar" compare "$picture.exr" "$reference" --json >"$picture-compare.json"
            echo "$(number rel_mse "$picture-compare.json") $seconds $(number noise "$picture.json")"
        done | awk -v scene=$scene -v balance=$balance '
            { error += $1; seconds += $2; noise += $3 }
            END { printf "| %s | %s | %.2e | %.2f |\n", scene, balance, error / NR, seconds / NR
                  printf "%s %s: noise by --stats %.4f, root of relMSE %.4f\n", scene, balance, noise / NR,
                      sqrt(error / NR) >"/dev/stderr" }'
    done
done
