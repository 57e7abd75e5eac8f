#include "processing/btf/pixel_digest.h"

#include <OpenEXR/ImfChannelList.h>

#include "processing/btf/exr_file.h"
#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"

namespace mesorig::btf {
namespace {

// Digests of the part's header and channels, one after the other.
StatusOr<std::string> PartDigest(const ExrReader& file, int part) {
  int width = 0, height = 0;
  MESORIG_RETURN_IF_ERROR(file.PartSize(part, width, height));
  std::vector<std::string> names;
  const Imf::ChannelList& channels = file.header(part).channels();
  for (auto c = channels.begin(); c != channels.end(); ++c) names.push_back(c.name());
  const size_t texels = static_cast<size_t>(width) * static_cast<size_t>(height);
  MESORIG_RETURN_IF_ERROR(CheckMemory(
      static_cast<double>(texels) * static_cast<double>(names.size()) * sizeof(float), file.name()));
  std::vector<float> values(texels * names.size());
  std::vector<Slice<float>> slices;
  for (size_t c = 0; c < names.size(); ++c) {
    slices.push_back({names[c], values.data() + c * texels, 1, width});
  }
  MESORIG_RETURN_IF_ERROR(file.ReadPart(part, slices));
  ByteWriter digests;
  digests.PutString(file.PartName(part)).Put<int32_t>(width).Put<int32_t>(height);
  for (size_t c = 0; c < names.size(); ++c) {
    digests.PutString(names[c]).PutString(FrameDigest(
        {reinterpret_cast<const char*>(values.data() + c * texels), texels * sizeof(float)}));
  }
  return FrameDigest(digests.Take());
}

}  // namespace

StatusOr<std::string> PixelDigest(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader file, ExrReader::Open(path));
  std::string digests;
  for (int part = 0; part < file.part_count(); ++part) {
    MESORIG_ASSIGN_OR_RETURN(const std::string digest, PartDigest(file, part));
    digests += digest;
  }
  return FrameDigest(digests);
}

}  // namespace mesorig::btf
