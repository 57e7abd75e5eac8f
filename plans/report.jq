# The figures of the demo's stages ($s, one object a stage) as report.json (docs/report.md).
# usage: jq -n --slurpfile pictures pictures.list -f report.jq json/*.json
def pick($keys): with_entries(select(.key as $k | $keys | index($k)));
def round2: . * 100 | round / 100;

([inputs | {key: (input_filename | split("/") | last | rtrimstr(".json")), value: .}]
 | from_entries) as $s
| {
    title: "mesorig demo",
    sample: "weave with a raised letter",
    capture: ($s.capture
      | pick(["frames_planned", "frames_on_disk", "virtual_s", "wall_s", "deterministic"])),
    btf: (($s.btf | pick(["psnr_db", "rel_error", "by_view_theta", "by_light_theta"]))
      + {psnr_nominal_db: $s.btf_nominal.psnr_db, wall_s: $s.capture.processing_wall_s,
         processing_s: $s.capture.processing_s}),
    mdf: (($s.mdf | pick(["median_abs_mm", "rmse_mm", "coverage", "best_plane_median_abs_mm",
                          "theta_limit_deg", "by_view_theta"]))
      + {wall_s: $s.capture.processing_wall_s}),
    codec: {
      view_svd: ($s.svd4
        | pick(["terms", "bytes", "ratio", "psnr_db", "rel_error", "encode_s", "decode_s"])),
      sweep: [$s.svd1, $s.svd2, $s.svd4, $s.svd8, $s.svd16]
    },
    render: ($s.render_demo | pick(["ms_per_frame", "renderer"])
      + {megapixels: (.width_px * .height_px / 1e6)}
      + ($s.silhouette | {silhouette_iou, silhouette_iou_btf_only,
                          silhouette_ms_per_frame: .ms_per_frame,
                          silhouette_passes: .silhouettes.passes,
                          silhouette_wall_s: .stage_wall_s})),
    stripe: ($s.stripe | if . then pick(["position_std_px", "position_mad_px", "fitted"])
                                   + {wall_s: .stage_wall_s} else null end),
    real: ({cat: $s.real_cat, owl: $s.real_owl} | with_entries(select(.value != null))
      | map_values(pick(["psnr_db", "lambert_psnr_db"]) + {wall_s: .stage_wall_s})),
    stages: ([
      {name: "capture", wall_s: $s.capture.wall_s,
       figure: "\($s.capture.frames_on_disk) of \($s.capture.frames_planned) frames durable"},
      {name: "BTF and MDF built (computing)", wall_s: $s.capture.processing_s,
       figure: "BTF \($s.btf.psnr_db | round2) dB against truth; MDF median |error| \($s.mdf.median_abs_mm * 1e4 | round / 1e4) mm, \($s.mdf.coverage * 1e4 | round / 100) % measured"},
      {name: "truth of the simulator", wall_s: $s.truth.stage_wall_s,
       figure: "standard error \($s.truth.standard_error | . * 1e4 | round / 1e4) 1/sr"},
      {name: "view-svd, four terms", wall_s: $s.svd4.encode_s,
       figure: "\($s.svd4.psnr_db | round2) dB, 1:\($s.svd4.ratio | round)"},
      {name: "rendering", wall_s: $s.render_demo.stage_wall_s,
       figure: "\($s.render_demo.ms_per_frame | round) ms a frame"},
      {name: "silhouettes, traced truth included", wall_s: $s.silhouette.stage_wall_s,
       figure: "IoU \($s.silhouette.silhouette_iou * 1e3 | round / 1e3) at the rim, BTF only \($s.silhouette.silhouette_iou_btf_only * 1e3 | round / 1e3)"}
    ] + [$s.stripe | select(. != null)
         | {name: "laser line on a wall", wall_s: .stage_wall_s,
            figure: "\(.position_std_px * 1e4 | round / 1e4) px standard deviation"}]
      + [{name: "cat", real: $s.real_cat}, {name: "owl", real: $s.real_owl} | select(.real != null)
         | {name: "\(.name): a light left out", wall_s: .real.stage_wall_s,
            figure: "\(.real.psnr_db | round2) dB, Lambert \(.real.lambert_psnr_db | round2) dB"}]),
    pictures: $pictures[0]
  }
