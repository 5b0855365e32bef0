#!/usr/bin/env bash
# All experiments of docs/results in sequence: clutter removal, the paper's tables, the comparison with VGN, depth noise, ablations.
#
#   scripts/experiments.sh OUT [NAME…]      all of them, or those whose name begins with one of these
#
# Finished experiments are not repeated, and interrupted ones continue. `experiments compare` makes the tables.
set -euo pipefail

out=${1:?where the runs go}
shift
wanted=("$@")
here=$(cd "$(dirname "$0")/.." && pwd)
experiments=${EXPERIMENTS:-$here/target/release/experiments}

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
    "$experiments" run "$here/configs/experiment/$config.toml" --out "$out/$name" --set "protocol=$protocol" "$@" > /dev/null
}

# Two thresholds for VGN: its own, 0.9, and 0.5, at which our network finds grasps. With refinement a position needs a quality of
# 0.05; for VGN's network, in whose training successes had a weight of 4.9, the same odds are 0.2.
vgn_network=(--set model=../../models/vgn-200k.safetensors)
vgn_places=(--set plan.detection.surface_side=front --set plan.detection.origin_behind_tips_m=0.05 --set plan.detection.quality_min=0.2)
vgn_plan=(--set plan=../plan/vgn.toml --set plan.detection.voxel_offset=0.5)
half=(--set plan.detection.quality_min=0.5)
vgn_policy=(--set plan=paper --set plan.ranking.policy=vgn-best --set plan.detection.quality_min=0.5)
paper_policy=(--set plan=paper --set plan.detection.quality_min=0.5)

# Rounds of a seed that was not used for tuning.
for kind in pile packed; do
    held=(--set 'seeds=[1001]')
    run "$kind-ours" "$kind-refined" "$kind: our network, refined" "${held[@]}"
    run "$kind-vgn" "$kind" "$kind: VGN, 0.9" "${held[@]}" "${vgn_network[@]}" "${vgn_plan[@]}"
    run "$kind-vgn-half" "$kind" "$kind: VGN, 0.5" "${held[@]}" "${vgn_network[@]}" "${vgn_plan[@]}" "${half[@]}"
    run "$kind-vgn-paper" "$kind" "$kind: VGN's network, Eq. 8, 0.5" "${held[@]}" "${vgn_network[@]}" "${vgn_plan[@]}" "${half[@]}" --set plan.ranking.policy=paper
    run "$kind-vgn-refined" "$kind-refined" "$kind: VGN's network, refined" "${held[@]}" "${vgn_network[@]}" "${vgn_places[@]}"
    run "$kind-ours-vgn" "$kind" "$kind: our network, VGN's choice, 0.5" "${held[@]}" "${vgn_policy[@]}"
    run "$kind-ours-paper" "$kind" "$kind: our network, Eq. 8, 0.5" "${held[@]}" "${paper_policy[@]}"
done

run table1 table1 "Table 1: refined"
run table2 table2 "Table 2: refined"
run table3 table3 "Table 3: refined"
run table4-vgn table3 "Table 4: VGN, 0.5" "${vgn_network[@]}" "${vgn_plan[@]}" "${half[@]}"
run table4-vgn-paper table3 "Table 4: VGN's network, Eq. 8, 0.5" "${vgn_network[@]}" "${vgn_plan[@]}" "${half[@]}" --set plan.ranking.policy=paper
run table4-vgn-refined table3 "Table 4: VGN's network, refined" "${vgn_network[@]}" "${vgn_places[@]}"
run table4-ours-paper table3 "Table 4: our network, Eq. 8, 0.5" "${paper_policy[@]}"
run table4-ours-vgn table3 "Table 4: our network, VGN's choice, 0.5" "${vgn_policy[@]}"
run table1-paper table1 "Table 1: Eq. 8, 0.5" "${paper_policy[@]}"
run table2-paper table2 "Table 2: Eq. 8, 0.5" "${paper_policy[@]}"

# Depth does not depend on light, but on the sensor's noise.
run noise-d435 table2 "Table 2: refined, D435-like noise" --set noise.kind=d435
run noise-dex table2 "Table 2: refined, dex noise" --set noise.kind=dex
run noise-dex-scaled table2 "Table 2: refined, dex noise, scaled to the table" --set noise.kind=dex --set plan.cloud.scale_to_table=true

for kind in pile packed; do
    one=(--set 'seeds=[1000]')
    run "giga-$kind" "giga-$kind" "GIGA $kind: our network, refined, one view" "${one[@]}"
    run "giga-$kind-vgn-scaled" "giga-$kind" "GIGA $kind: VGN, 0.5, scaled to the table" "${one[@]}" "${vgn_network[@]}" "${vgn_plan[@]}" "${half[@]}" \
        --set plan.cloud.scale_to_table=true
    run "giga-$kind-vgn" "giga-$kind" "GIGA $kind: VGN, 0.5" "${vgn_network[@]}" "${vgn_plan[@]}" "${half[@]}"
done

for views in 1 2 3; do
    run "views-$views" pile-refined "pile: refined, $views views" --set "views.count=$views" --set 'seeds=[1001]'
done
