#!/bin/bash
# The table of docs/noise.md: estimated over true error of balances at the same number of paths, direct light, on two scenes,
# against a reference of 4096 paths a pixel by the balance heuristic. Pictures go to out/first-look; references are kept.
#   scripts/first-look.sh [SPP [path [SEEDS]]]
set -euo pipefail
cd "$(dirname "$0")/.."
spp=${1:-64} integrator=${2:-direct} size=96x64 seeds=${3:-$(seq 31)}
bismar=${BISMAR:-target/release/bismar} out=out/first-look/$integrator
mkdir -p "$out"

# A number of a JSON file by its key.
number() { sed -n "s/^ *\"$1\": *\([-+0-9.e]*\),\{0,1\}$/\1/p" "$2" | head -n 1; }

for scene in veach glossy-sun; do
    sky=()
    [ -f "scenes/$scene.hdr" ] && sky=(--env "scenes/$scene.hdr")
    render() {
        "$bismar" -q render "scenes/$scene.glb" "${sky[@]}" --size $size --aov none --integrator "$integrator" "$@"
    }
    reference=$out/$scene-reference.exr
    [ -f "$reference" ] || render --balance half --spp 4096 --seed 1000 -o "$reference"
    for balance in half second-order progressive; do
        rows=$(for seed in $seeds; do
            picture=$out/$scene-$balance-$seed
            render --balance $balance --spp "$spp" --seed "$seed" -o "$picture.exr" --stats "$picture.json"
            "$bismar" compare "$picture.exr" "$reference" --json >"$picture-compare.json"
            echo "$(number rel_mse "$picture-compare.json") $(number noise "$picture.json")"
        done)
        awk '{ print $2 / sqrt($1) }' <<<"$rows" | sort -g | awk '{ ratio[NR] = $1 }
            END { printf "| %s | `%s` | %.2f | %.2f | %.2f |\n", scene, balance, ratio[1], ratio[int((NR + 1) / 2)],
                      ratio[NR] }' scene=$scene balance=$balance
    done
done
