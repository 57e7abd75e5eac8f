#include "processing/btf/mdf_file.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "processing/btf/exr_attributes.h"
#include "processing/btf/exr_file.h"

namespace mesorig::btf {
namespace {

constexpr float kMaxHalf = 65504;
// D, C, and what is read of a file stands beside nothing else of its size.
constexpr double kBytesPerTexel = 8;

Status CheckMdfInfo(const MdfHeader& header) {
  MESORIG_RETURN_IF_ERROR(CheckMdfHeader(header));
  return CheckText("provenance", header.provenance_json, true);
}

void PutMdfAttributes(const MdfHeader& h, Imf::Header& header) {
  AttributeWriter put(header);
  put.Text("format", kMdfFormat);
  put.Number("formatMajor", kMdfFormatMajor);
  put.Number("formatMinor", kMdfFormatMinor);
  put.Number("mdfWidth", h.width);
  put.Number("mdfHeight", h.height);
  put.Real("pitchMm", h.pitch_mm);
  put.Real("hRefMm", h.h_ref_mm);
  put.Points("views", h.views);
  put.Points("viewPositionsMm", h.view_positions_mm);
  put.Flag("calibrated", h.calibrated);
  put.Text("provenance", h.provenance_json);
}

StatusOr<MdfHeader> GetMdfAttributes(const Imf::Header& header, const std::string& file) {
  AttributeReader get(header, file);
  get.Format(kMdfFormat, kMdfFormatMajor);
  MdfHeader h;
  get.Number("mdfWidth", h.width);
  get.Number("mdfHeight", h.height);
  get.Real("pitchMm", h.pitch_mm);
  get.Real("hRefMm", h.h_ref_mm);
  get.Points("views", h.views);
  get.Points("viewPositionsMm", h.view_positions_mm);
  get.Flag("calibrated", h.calibrated);
  get.Text("provenance", h.provenance_json);
  MESORIG_RETURN_IF_ERROR(get.status());
  if (const Status status = CheckMdfInfo(h); !status.ok()) return Annotate(status, file);
  return h;
}

Status CheckPartSize(const ExrReader& reader, int part, const MdfHeader& header) {
  int width = 0, height = 0;
  MESORIG_RETURN_IF_ERROR(reader.PartSize(part, width, height));
  if (width != header.width || height != header.height) {
    return InvalidArgument("{}: part {} has {} x {} pixels, its attributes say {} x {}",
                           reader.name(), part, width, height, header.width, header.height);
  }
  return OkStatus();
}

StatusOr<MdfFileInfo> ReadInfo(const ExrReader& reader) {
  MdfFileInfo info;
  MESORIG_ASSIGN_OR_RETURN(info.header, GetMdfAttributes(reader.header(0), reader.name()));
  info.file_bytes = reader.file_bytes();
  MESORIG_RETURN_IF_ERROR(CheckPartSize(reader, 0, info.header));
  return info;
}

// Written so that NaN is refused.
Status CheckValues(const Mdf& mdf, int view) {
  const auto distance = mdf.Distance(view), confidence = mdf.Confidence(view);
  for (size_t i = 0; i < distance.size(); ++i) {
    if (!(distance[i] >= 0 && std::isfinite(distance[i]))) {
      return InvalidArgument("view {} texel {}: a distance of {} mm is not finite and >= 0", view,
                             i, distance[i]);
    }
    if (!(confidence[i] >= 0 && confidence[i] <= kMaxHalf)) {
      return InvalidArgument("view {} texel {}: a confidence of {} is not in [0, {}]", view, i,
                             confidence[i], kMaxHalf);
    }
  }
  return OkStatus();
}

// Part 0 shows the depth of the view nearest to the zenith, near is bright.
std::vector<float> Preview(const Mdf& mdf) {
  const std::vector<Vec3>& views = mdf.header().views;
  const auto top =
      std::max_element(views.begin(), views.end(), [](Vec3 a, Vec3 b) { return a.z < b.z; });
  const auto distance = mdf.Distance(static_cast<int>(top - views.begin()));
  const auto [least, most] = std::minmax_element(distance.begin(), distance.end());
  const float span = *most - *least;
  std::vector<float> grey(distance.size(), 0.5f);
  for (size_t i = 0; span > 0 && i < grey.size(); ++i) {
    grey[i] = 0.02f + 0.88f * (*most - distance[i]) / span;
  }
  return grey;
}

std::vector<PartToWrite> Parts(const MdfHeader& header) {
  std::vector<PartToWrite> parts;
  for (int v = -1; v < header.view_count(); ++v) {
    PartToWrite part;
    part.name = v < 0 ? "preview" : ViewPart(v);
    part.width = header.width;
    part.height = header.height;
    if (v < 0) {
      part.channels = {{"R"}, {"G"}, {"B"}};
      PutMdfAttributes(header, part.header);
    } else {
      part.channels = {{"D", /*half=*/false}, {"C"}};
    }
    parts.push_back(std::move(part));
  }
  return parts;
}

}  // namespace

StatusOr<MdfFileInfo> ReadMdfInfo(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader reader, ExrReader::Open(path));
  return ReadInfo(reader);
}

Status WriteMdf(const Mdf& mdf, const std::filesystem::path& path) {
  Status status = CheckMdfInfo(mdf.header());
  for (int v = 0; status.ok() && v < mdf.header().view_count(); ++v) status = CheckValues(mdf, v);
  if (!status.ok()) return Annotate(status, path.string());
  const std::vector<float> preview = Preview(mdf);
  return WriteExr(path, mdf.header().width, mdf.header().height, Parts(mdf.header()),
                  [&](size_t part, size_t channel, std::vector<float>& values) {
                    const int view = static_cast<int>(part) - 1;
                    const std::span<const float> from = part == 0      ? std::span(preview)
                                                        : channel == 0 ? mdf.Distance(view)
                                                                       : mdf.Confidence(view);
                    std::copy(from.begin(), from.end(), values.begin());
                  });
}

StatusOr<Mdf> ReadMdf(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader reader, ExrReader::Open(path));
  MESORIG_ASSIGN_OR_RETURN(const MdfFileInfo info, ReadInfo(reader));
  MESORIG_ASSIGN_OR_RETURN(const auto named, reader.PartsByName());
  std::vector<int> parts;
  for (int v = 0; v < info.header.view_count(); ++v) {
    const auto part = named.find(ViewPart(v));
    if (part == named.end()) {
      return InvalidArgument("{}: part {} is missing", path.string(), ViewPart(v));
    }
    MESORIG_RETURN_IF_ERROR(CheckPartSize(reader, part->second, info.header));
    parts.push_back(part->second);
  }
  MESORIG_RETURN_IF_ERROR(
      CheckMemory(kBytesPerTexel * static_cast<double>(info.header.texel_count() * parts.size()),
                  path.string()));
  Mdf mdf(info.header);
  const int width = info.header.width;
  for (int v = 0; v < info.header.view_count(); ++v) {
    MESORIG_RETURN_IF_ERROR(reader.ReadPart(parts[static_cast<size_t>(v)],
                                            {{"D", mdf.MutableDistance(v).data(), 1, width},
                                             {"C", mdf.MutableConfidence(v).data(), 1, width}}));
    if (const Status status = CheckValues(mdf, v); !status.ok()) {
      return Annotate(status, path.string());
    }
  }
  return mdf;
}

}  // namespace mesorig::btf
