#pragma once
// `*.btf.exr`: multi-part OpenEXR that ordinary viewers open (DESIGN, "Files"). Part 0 is a
// preview picture and alone carries the attributes; an uncompressed BTF has parts V000... with
// channels L000.R/G/B (half, ZIPS), channels of absent lights left out, and where they are known the
// variances L000.V (float, sr^-2, without value_scale; all pairs or none); a codec stores its factors
// as named parts. A file is whole or absent.

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "processing/btf/sampled_btf.h"

namespace mesorig::btf {

inline constexpr int kFormatMajor = 1, kFormatMinor = 0;

// What a file says of itself, from part 0 alone.
struct BtfFileInfo {
  BtfHeader header;
  std::string codec;               // "raw" for an uncompressed BTF
  int codec_version = 1;
  std::string codec_options_json;  // what the encoder was told and what it found, "{}" for raw
  double value_scale = 1;          // stored * scale = value
  bool clamp_negative = false;     // of a codec: what decodes below zero is zero (codecs/clamped.h)
  std::vector<uint8_t> present;    // v * nL + l, light fastest; 1 is present
  uint64_t file_bytes = 0;
};

// InvalidArgument names the file and what is wrong (not an EXR, not a mesorig BTF, a newer major
// version, an attribute that is missing or out of range); never a crash on hostile bytes.
StatusOr<BtfFileInfo> ReadBtfInfo(const std::filesystem::path& path);

// Writes the uncompressed file. Values beyond half's range are prevented by value_scale, which is
// chosen from the largest magnitude. NaN and infinities are refused (InvalidArgument).
Status WriteSampledBtf(const SampledBtf& btf, const std::filesystem::path& path);
// value_scale is 1 where the largest magnitude lies in [2^-6, 2^12], else a power of two: nothing
// is lost to the scaling itself.
// Reads an uncompressed file. A compressed one is refused with its codec's name, one that does not
// fit into this machine's memory with its size.
StatusOr<SampledBtf> ReadSampledBtf(const std::filesystem::path& path);

// A named part of float or half channels, all of one size: how codecs store factors.
struct Plane {
  std::string name;                  // part name
  int width = 0, height = 0;
  std::vector<std::string> channels;  // sorted by name when read
  bool half = true;                  // stored as half, else float
  std::vector<float> values;         // [channel][row][column]
  // Stored as bytes instead: values are whole numbers in [-127, 127], four to a pixel of UINT
  // channels along the row (attribute `byteWidth` of the part: the width before that).
  bool bytes = false;
};
// Writes part 0 (attributes of `info`; `preview` is W*H*3 linear RGB, usually the decoded image of
// PreviewPair) and the planes. NaN, infinities and halves that overflow are refused.
Status WriteCodedBtf(const BtfFileInfo& info, const std::vector<Plane>& planes,
                     std::span<const float> preview, const std::filesystem::path& path);
struct CodedBtf {
  BtfFileInfo info;
  std::map<std::string, Plane> planes;
};
StatusOr<CodedBtf> ReadCodedBtf(const std::filesystem::path& path);

// The pair whose image stands in part 0: the present one whose view is nearest to the zenith and
// whose light stands nearest to 35 degrees from it. {0, 0} when nothing is present.
std::pair<int, int> PreviewPair(const BtfHeader& header, const std::vector<uint8_t>& present);
// InvalidArgument, with sizes, where a SampledBtf of this header exceeds the machine's memory.
Status CheckDenseMemory(const BtfHeader& header, const std::filesystem::path& path);
// To the nearest half and back, as a plane stored as half reads. What overflows becomes infinite.
void RoundToHalf(std::span<float> values);
// The size that the present samples would have as half, without any compression, bytes: the
// numerator of every compression ratio.
uint64_t UncompressedBytes(const BtfHeader& header, const std::vector<uint8_t>& present);

}  // namespace mesorig::btf
