#pragma once
// The subcommands of mesorig-btf, without their command lines. Each prints its result to standard
// output, as text or as one JSON object.

#include <filesystem>
#include <optional>
#include <string>

#include "processing/codecs/encoder.h"
#include "processing/codecs/target.h"
#include "protocol/base/status.h"

namespace mesorig::processing {

// Of a BTF or an MDF.
Status Info(const std::filesystem::path& file, bool json);
// btf/pixel_digest.h.
Status Digest(const std::filesystem::path& file, bool json);

Status Import(const std::filesystem::path& from, const std::string& format,
              const std::filesystem::path& to, bool json);

struct CompressOptions {
  std::filesystem::path from, to;
  std::string codec;
  codecs::EncodeOptions encode;
  codecs::Target target;  // instead of encode.terms, where one is set
  bool stream = false;  // from strips of the file, never held whole; no errors are measured
  bool json = false;
};
Status Compress(const CompressOptions& options);

// Of two BTFs or two MDFs. by_angle: also per ring of views and of lights.
Status Compare(const std::filesystem::path& a, const std::filesystem::path& reference,
               bool by_angle, bool json);

// report.json to report.html (docs/report.md). An empty `to` is report.html beside it.
Status Report(const std::filesystem::path& report_json, std::filesystem::path to, bool json);

struct SliceOptions {
  std::filesystem::path from, to;
  int view = 0;
  std::optional<int> light;  // an MDF has none
  double exposure = 0;  // 0: so that all but the brightest hundredth is below white
  bool json = false;
};
// Of a BTF a picture, of an MDF the heights that the view shows.
Status Slice(const SliceOptions& options);

struct CrossValidateOptions {
  std::filesystem::path from;
  std::string codec;
  codecs::EncodeOptions encode;
  std::optional<std::filesystem::path> pictures;  // folder for measured | predicted, one a light
  bool json = false;
};
Status CrossValidateFile(const CrossValidateOptions& options);

}  // namespace mesorig::processing
