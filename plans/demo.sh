#!/usr/bin/env bash
# The demo: a scripted session from capture to report, every program a process of its own.
# usage: plans/demo.sh --bin DIR [--out DIR]      (./run demo builds first and calls this)
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
bin= out=$root/out/demo
while [ $# -gt 0 ]; do
  case "$1" in
    --bin) bin=$(cd "${2:?--bin needs a folder}" && pwd); shift 2 ;;
    --out) out=${2:?--out needs a folder}; shift 2 ;;
    *) echo "demo: unknown argument $1; usage: ./run demo [--out DIR]" >&2; exit 2 ;;
  esac
done
mkdir -p "$out" || { echo "demo: $out cannot be made" >&2; exit 2; }
out=$(cd "$out" && pwd)
rig=$root/rigs/demo.toml sample=$root/rigs/samples/weave.toml plan=$root/plans/demo.toml
photographs=$root/../shared/data/multi_light laser_line=$root/../shared/data/laser_line

runtime=$(mktemp -d /tmp/mesorig-demo-XXXXXX)
services=()
# Services go in the reverse order of their start, by the ids that we started.
end_services() {
  for ((i = ${#services[@]} - 1; i >= 0; --i)); do
    kill "${services[i]}" 2>/dev/null && wait "${services[i]}" 2>/dev/null || true
  done
  services=()
}
trap 'end_services; rm -rf "$runtime"' EXIT

fail() { echo "demo: $*" >&2; exit 1; }

# start NAME ARGUMENTS...: a service, found in the runtime directory once it answers.
start() {
  local name=$1
  shift
  "$bin/$name" "$@" --runtime-dir "$runtime" 2>"$out/log/$name.log" &
  services+=($!)
  for _ in $(seq 600); do
    [ -f "$runtime/$name.endpoint" ] && return
    kill -0 "${services[-1]}" 2>/dev/null || break
    sleep 0.1
  done
  tail -n 5 "$out/log/$name.log" >&2
  fail "$name did not start"
}

# stage NAME COMMAND...: runs it, keeps its JSON in json/NAME.json with its wall_s.
stage() {
  local name=$1 started
  shift
  started=$(date +%s%N)
  "$@" >"$out/json/$name.tmp" || fail "$name failed"
  jq --argjson ns $(($(date +%s%N) - started)) '. + {stage_wall_s: ($ns / 1e9)}' \
    "$out/json/$name.tmp" >"$out/json/$name.json" || fail "$name printed no JSON"
  rm "$out/json/$name.tmp"
}
figure() { printf '%-12s %s\n' "$1" "$(jq -r "$3" "$out/json/$2.json")"; }

rm -rf "$out"/json "$out"/log "$out"/state
mkdir -p "$out/json" "$out/log" "$out/pictures"

start mesorig-sim run --rig "$rig" --sample "$sample" --seed 1 --log "$out/log/rig.tsv"
start mesorigd --rig "$rig" --state-dir "$out/state"
start mesorig-processd --products "$out/state/products"
# The simulator plays the operator who remounts the laser.
export MESORIG_DEMO_SIM=$bin/mesorig-sim MESORIG_DEMO_RUNTIME=$runtime
operator='"$MESORIG_DEMO_SIM" inject operator remount "$MESORIG_PROMPT_MOUNT" \
  --runtime-dir "$MESORIG_DEMO_RUNTIME"'
stage capture "$bin/mesorig" run "$plan" --on-prompt "$operator" --json --runtime-dir "$runtime"
end_services
btf=$out/sample.btf.exr svd=$out/sample.view-svd.btf.exr mdf=$out/sample.mdf.exr
take_product() {  # take_product KIND FILE
  mv "$(jq -r --arg kind "$1" '.products[] | select(.kind == $kind).path' \
    "$out/json/capture.json")" "$2" || fail "no $1 among the products"
}
take_product btf "$btf"
take_product mdf "$mdf"
figure capture capture '"\(.frames_on_disk) of \(.frames_planned) frames, \(.sweeps) sweeps; \(.virtual_s | round) s at the rig in \(.wall_s | round) s; files packed \(.processing_wall_s * 10 | round / 10) s after the first frame"'

stage truth "$bin/mesorig-sim" truth --sample "$sample" --like "$btf" --out "$out/truth.btf.exr" --json
stage truth_nominal "$bin/mesorig-sim" truth --sample "$sample" --like "$btf" --nominal \
  --out "$out/nominal.btf.exr" --json
stage btf_nominal "$bin/mesorig-btf" compare "$btf" "$out/nominal.btf.exr" --json
rm "$out/nominal.btf.exr"
stage btf "$bin/mesorig-btf" compare "$btf" "$out/truth.btf.exr" --by-angle --json
figure btf btf '"\(.psnr_db * 100 | round / 100) dB against the simulator, relative error \(.rel_error * 1e4 | round / 1e4)"'

stage truth_mdf "$bin/mesorig-sim" truth --sample "$sample" --like "$mdf" \
  --out "$out/truth.mdf.exr" --json
stage mdf "$bin/mesorig-btf" compare "$mdf" "$out/truth.mdf.exr" --by-angle --json
figure mdf mdf '"median |error| \(.median_abs_mm * 1e3 | round) um (best plane \(.best_plane_median_abs_mm * 1e3 | round) um), \(.coverage * 1e3 | round / 10) % measured"'

for terms in 1 2 4 8 16; do
  stage "svd$terms" "$bin/mesorig-btf" compress "$btf" --codec view-svd --terms $terms \
    --out "$out/terms.tmp.btf.exr" --json
  [ $terms = 4 ] && mv "$out/terms.tmp.btf.exr" "$svd"
done
rm -f "$out/terms.tmp.btf.exr"
figure view-svd svd4 '"\(.terms) terms: \(.psnr_db * 100 | round / 100) dB, 1:\(.ratio | round), \(.seconds * 100 | round / 100) s"'

for scene in demo slab; do
  stage "render_$scene" "$bin/mesorig-render" "$root/scenes/$scene.toml" --btf "$svd" \
    --out "$out/pictures/$scene.png" --json
done
figure render render_demo '"\(.ms_per_frame | round) ms a frame of \(.width_px)x\(.height_px) (\(.renderer))"'

# Silhouettes of the measured relief beside those of the surface that is really displaced by the
# true one.
stage relief "$bin/mesorig-sim" truth --sample "$sample" --mesh "$runtime/relief.obj" --json
stage silhouette "$bin/mesorig-render" "$root/scenes/silhouette.toml" --btf "$svd" --mdf "$mdf" \
  --relief "$runtime/relief.obj" --compare "$out/pictures/silhouettes.png" --frames 1 \
  --out "$out/pictures/silhouette.png" --json
figure silhouette silhouette '"IoU \(.silhouette_iou * 1e3 | round / 1e3) at the rim (BTF only \(.silhouette_iou_btf_only * 1e3 | round / 1e3)), \(.silhouettes.passes) peeling passes, \(.ms_per_frame | round) ms a frame"'

# The same texels seen steeply and flatly, measured and true, for the report.
views=(1 25 37) lights=(20 20 20)
for i in 0 1 2; do
  for side in sample truth; do
    "$bin/mesorig-btf" slice "$out/$side.mdf.exr" --view "${views[i]}" \
      --out "$out/pictures/${side}_depth_v${views[i]}.png" >/dev/null || fail "slice of $side failed"
  done
  for side in sample truth; do
    "$bin/mesorig-btf" slice "$out/$side.btf.exr" --view "${views[i]}" --light "${lights[i]}" \
      --out "$out/pictures/${side}_v${views[i]}.png" >/dev/null || fail "slice of $side failed"
  done
done

if [ -d "$photographs" ]; then
  for name in cat owl; do
    stage "import_$name" "$bin/mesorig-btf" import --format multi-light "$photographs/$name" \
      --out "$out/$name.btf.exr" --json
    stage "real_$name" "$bin/mesorig-btf" cross-validate "$out/$name.btf.exr" --codec rf-ptm --json \
      --pictures "$out/pictures/$name"
    figure "$name" "real_$name" '"\(.psnr_db * 100 | round / 100) dB for a light left out (Lambert \(.lambert_psnr_db * 100 | round / 100) dB)"'
  done
else
  echo "photographs  skipped: no $photographs"
fi

if [ -d "$laser_line" ]; then  # the wall in the upper rows does not move: how far the line does
  stage stripe "$bin/mesorig-btf" stripe "$laser_line"/*.jpg --region 0,5,640,166 --json
  figure stripe stripe '"the line on the wall stands within \(.position_std_px * 1e3 | round / 1e3) px (standard deviation over \(.fitted) photographs)"'
else
  echo "stripe       skipped: no $laser_line"
fi

# report.json: every figure beside the time that it took.
pictures() {  # file|caption|section lines to JSON, for the files that are there
  while IFS='|' read -r file caption section; do
    [ -f "$out/$file" ] || continue
    jq -n --arg file "$file" --arg caption "$caption" --arg section "$section" \
      '{$file, $caption, $section}'
  done | jq -s .
}
pictures >"$out/json/pictures.list" <<TEXT
pictures/demo.png|Left the BTF on a torus and a slab, right a plain texture of the same sample|Renderings
pictures/slab.png|The sample as it lay on the rig: BTF on the left, plain texture on the right|Renderings
pictures/silhouettes.png|Left the BTF on the surface's own silhouette, middle with the measured MDF, right the true relief traced; below a part enlarged|Silhouettes
$(for i in 0 1 2; do
  echo "pictures/sample_depth_v${views[i]}.png|Distance to the mesostructure, measured, view ${views[i]}|Relief, measured and true"
  echo "pictures/truth_depth_v${views[i]}.png|Distance to the mesostructure, true, view ${views[i]}|Relief, measured and true"
done)
$(for i in 0 1 2; do
  echo "pictures/sample_v${views[i]}.png|Measured, view ${views[i]}, light ${lights[i]}|Measured and true"
  echo "pictures/truth_v${views[i]}.png|The simulator's truth, view ${views[i]}, light ${lights[i]}|Measured and true"
done)
$(for name in cat owl; do
  for file in "$out/pictures/$name"/*.png; do
    echo "pictures/$name/$(basename "$file")|$name: photographed, and predicted from the other lights|Photographs, relit"
  done
done)
TEXT
jq -n --slurpfile pictures "$out/json/pictures.list" -f "$root/plans/report.jq" "$out"/json/*.json \
  >"$out/report.json" || fail "report.json failed"
stage report "$bin/mesorig-btf" report "$out/report.json" --out "$out/report.html" --json
echo "report       $out/report.html, $out/report.json; $(find "$out/pictures" -name '*.png' | wc -l) pictures in $out/pictures"
