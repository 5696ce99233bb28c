#!/bin/bash
# The table of README.md: error (with its standard error over seeds) and CPU seconds of every balance at the same number
# of paths, direct light, on two scenes, against a reference of 4096 paths a pixel by the balance heuristic. Stderr has
# the comparison of docs/noise.md. Pictures go to out/first-look; references are kept.
#   scripts/first-look.sh [SPP [path]]
set -euo pipefail
cd "$(dirname "$0")/.."
spp=${1:-64} integrator=${2:-direct} size=96x64 seeds=$(seq 64)
bismar=target/release/bismar out=out/first-look/$integrator
mkdir -p "$out"
TIMEFORMAT=%U

# A number of a JSON file by its key.
number() { sed -n "s/^ *\"$1\": *\([-+0-9.e]*\),\{0,1\}$/\1/p" "$2" | head -n 1; }

echo "| scene | \`--balance\` | relMSE | CPU seconds |"
echo "| --- | --- | --- | --- |"
for scene in veach glossy-sun; do
    sky=()
    [ -f "scenes/$scene.hdr" ] && sky=(--env "scenes/$scene.hdr")
    render() {
        "$bismar" -q render "scenes/$scene.glb" "${sky[@]}" --size $size --aov none --integrator "$integrator" "$@"
    }
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
            { error += $1; squares += $1 * $1; seconds += $2; noise += $3 }
            END { deviation = sqrt((squares / NR - (error / NR) ^ 2) / (NR - 1))
                  printf "| %s | `%s` | %.4f ± %.4f | %.2f |\n", scene, balance, error / NR, deviation, seconds / NR
                  printf "%s %s: noise by --stats %.4f, root of relMSE %.4f\n", scene, balance, noise / NR,
                      sqrt(error / NR) >"/dev/stderr" }'
    done
done
