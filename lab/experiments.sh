#!/usr/bin/env bash
# The experiments of docs/results in sequence: clutter removal, the paper's tables, depth noise, one
# noisy side view, views.
#
#   lab/experiments.sh OUT [NAME…]      all of them, or those whose name begins with one of these
#
# Finished experiments are not repeated, and interrupted ones continue. `graspmill experiment report` makes the tables.
set -euo pipefail

out=${1:?where the runs go}
shift
wanted=("$@")
here=$(cd "$(dirname "$0")/.." && pwd)
graspmill=${GRASPMILL:-$here/target/release/graspmill}

# run NAME CONFIG PROTOCOL [--set KEY=VALUE …]
run() {
    local name=$1 config=$2 protocol=$3
    shift 3
    if [ ${#wanted[@]} -gt 0 ]; then
        local hit=
        for prefix in "${wanted[@]}"; do [[ $name == "$prefix"* ]] && hit=1; done
        [ -n "$hit" ] || return 0
    fi
    echo "== $name" >&2
    "$graspmill" experiment run "$here/configs/experiment/$config.toml" --out "$out/$name" --set "protocol=$protocol" "$@" > /dev/null
}

# VGN's network with its own threshold, 0.9, and with 0.5; the paper's with its own, 0.9, and Eq. 8; its layers with
# the head by closing.
vgn=(--set plan=vgn)
half=(--set plan.detection.quality_min=0.5)
closings=(--set plan=paper)
paper=("${closings[@]}" --set "model=$here/models/paper-200k.safetensors")
eq8=(--set plan.ranking.policy=paper --set plan.detection.quality_min=0.9)
lower=(--set plan.ranking.policy=paper --set plan.detection.quality_min=0.7)
surest=(--set plan.ranking.policy=vgn-best --set plan.detection.quality_min=0.7)
scaled=(--set plan.cloud.scale_to_table=true)
# The judge's objects on the experiments' table: the scenes' grid must have the planner's voxels.
mkdir -p "$out"
sed -e '/^\[\[container\]\]/,/^$/d' -e 's/^size_m = 0.48 .*/size_m = 0.30/' -e 's/^resolution = 64 .*/resolution = 40/' \
    "$here/configs/generate/judge.toml" > "$out/larger.toml"
hard=(--set "scene=$(realpath "$out")/larger.toml")
everyday=(--set scene=../generate/everyday.toml)

# voxels CONFIG [--set KEY=VALUE …]: the rows of the networks of voxels.
voxels() {
    run "$1-paper" "$1" "$1: the paper's network, 0.9, Eq. 8" "${@:2}" "${paper[@]}" "${eq8[@]}"
    run "$1-closings" "$1" "$1: head by closing, 0.9, Eq. 8" "${@:2}" "${closings[@]}" "${eq8[@]}"
    run "$1-closings-lower" "$1" "$1: head by closing, 0.7, Eq. 8" "${@:2}" "${closings[@]}" "${lower[@]}"
    run "$1-closings-surest" "$1" "$1: head by closing, 0.7, surest first" "${@:2}" "${closings[@]}" "${surest[@]}"
    run "$1-vgn" "$1" "$1: VGN, 0.9" "${@:2}" "${vgn[@]}"
    run "$1-vgn-half" "$1" "$1: VGN, 0.5" "${@:2}" "${vgn[@]}" "${half[@]}"
}

# Rounds of seeds that were not used for tuning.
held=(--set 'seeds=[1001]')
one=(--set 'seeds=[1002]')
for kind in pile packed; do
    run "$kind-judge" "$kind" "$kind: the judge" "${held[@]}"
    run "$kind-judge-eq8" "$kind" "$kind: the judge, 0.9, Eq. 8" "${held[@]}" "${eq8[@]}"
    voxels "$kind" "${held[@]}"
done
run everyday-judge pile "everyday objects in piles of five: the judge" "${held[@]}" "${everyday[@]}"
run everyday-paper pile "everyday objects in piles of five: the paper's network, 0.9, Eq. 8" "${held[@]}" "${everyday[@]}" "${paper[@]}"
run everyday-vgn pile "everyday objects in piles of five: VGN, 0.9" "${held[@]}" "${everyday[@]}" "${vgn[@]}"

for table in table1 table2 table3; do
    run "$table-judge" "$table" "$table: the judge, 0.9, Eq. 8" "${eq8[@]}"
    run "$table-judge-best" "$table" "$table: the judge, surest first"
    voxels "$table"
done

# Depth does not depend on light, but on the sensor's noise.
for noise in d435 dex; do
    run "noise-$noise" table2 "Table 2: the judge, $noise noise" --set "noise.kind=$noise"
done

# One noisy view from the side, GIGA's five seeds (larger objects: one other seed); "halts" forgives touches on the way,
# as GIGA's and VGN's simulators do.
for kind in pile packed; do
    for touching in fails halts; do
        touch=(--set "touching=$touching")
        run "giga-$kind-judge-$touching" "giga-$kind" "GIGA $kind, a touch $touching: the judge" "${touch[@]}"
        run "giga-$kind-paper-$touching" "giga-$kind" "GIGA $kind, a touch $touching: the paper's network, 0.9, Eq. 8, scaled to the table" "${touch[@]}" "${paper[@]}" "${scaled[@]}"
        run "giga-$kind-vgn-$touching" "giga-$kind" "GIGA $kind, a touch $touching: VGN, 0.9, scaled to the table" "${touch[@]}" "${vgn[@]}" "${scaled[@]}"
    done
    run "giga-$kind-hard-judge" "giga-$kind" "GIGA $kind, larger objects: the judge" "${one[@]}" "${hard[@]}"
    run "giga-$kind-hard-vgn" "giga-$kind" "GIGA $kind, larger objects: VGN, 0.9, scaled to the table" "${one[@]}" "${vgn[@]}" "${scaled[@]}" "${hard[@]}"
done

# What views and noise cost the judge: six views 30° off the vertical, one from the side (60°), and others.
look=(--set 'seeds=[8101]' --set objects.viable_only=true)
for noise in none d435 dex; do
    run "views-six-$noise" giga-pile "pile, six views, $noise noise: the judge" "${look[@]}" --set "noise.kind=$noise" \
        --set views.count=6 --set views.polar_rad=0.5236
    run "views-side-$noise" giga-pile "pile, one side view, $noise noise: the judge" "${look[@]}" --set "noise.kind=$noise"
done
run views-72-dex giga-pile "pile, one view at 72°, dex noise: the judge" "${look[@]}" --set views.polar_rad=1.2566
run views-30-dex giga-pile "pile, one view at 30°, dex noise: the judge" "${look[@]}" --set views.polar_rad=0.5236
run views-above-dex giga-pile "pile, one view from above, dex noise: the judge" "${look[@]}" --set views.polar_rad=0
run views-two-dex giga-pile "pile, two opposite views at 60°, dex noise: the judge" "${look[@]}" --set views.count=2
run views-three-dex giga-pile "pile, three views at 60°, dex noise: the judge" "${look[@]}" --set views.count=3
