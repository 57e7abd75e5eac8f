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
photographs=$root/../shared/data/multi_light

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

start mesorig-sim run --rig "$rig" --sample "$sample" --seed 1
start mesorigd --rig "$rig" --state-dir "$out/state"
start mesorig-processd --products "$out/state/products"
stage capture "$bin/mesorig" run "$plan" --json --runtime-dir "$runtime"
end_services
btf=$out/sample.btf.exr svd=$out/sample.view-svd.btf.exr
mv "$(jq -r '.products[0].path // empty' "$out/json/capture.json")" "$btf" || fail "no product"
figure capture capture '"\(.frames_on_disk) of \(.frames_planned) frames, \(.virtual_s | round) s at the rig in \(.wall_s | round) s; BTF packed \(.processing_wall_s * 10 | round / 10) s after the first frame"'

stage truth "$bin/mesorig-sim" truth --sample "$sample" --like "$btf" --out "$out/truth.btf.exr" --json
stage btf "$bin/mesorig-btf" compare "$btf" "$out/truth.btf.exr" --json
figure btf btf '"\(.psnr_db * 100 | round / 100) dB against the simulator, relative error \(.rel_error * 1e4 | round / 1e4)"'

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
figure render render_demo '"\(.ms_per_frame | round) ms a frame of \(.width)x\(.height) (\(.renderer))"'

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
