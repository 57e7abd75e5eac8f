#pragma once
// `*.btf.exr`: multi-part OpenEXR that ordinary viewers open (DESIGN, "Files"). Part 0 is a
// preview picture and alone carries the attributes; an uncompressed BTF has parts V000... with
// channels L000.R/G/B (half, ZIPS), channels of absent lights left out; a codec stores its factors
// as named parts. A file is whole or absent.

#include <filesystem>
#include <map>
#include <string>
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
  std::vector<uint8_t> present;    // v * nL + l, light fastest; 1 is present
  uint64_t file_bytes = 0;
};

// InvalidArgument names the file and what is wrong (not an EXR, not a mesorig BTF, a newer major
// version, an attribute that is missing or out of range); never a crash on hostile bytes.
StatusOr<BtfFileInfo> ReadBtfInfo(const std::filesystem::path& path);

// Writes the uncompressed file. Values beyond half's range are prevented by value_scale, which is
// chosen from the largest magnitude. NaN and infinities are refused (InvalidArgument).
Status WriteSampledBtf(const SampledBtf& btf, const std::filesystem::path& path);
// Reads an uncompressed file. A compressed one is refused with its codec's name.
StatusOr<SampledBtf> ReadSampledBtf(const std::filesystem::path& path);

// A named part of float or half channels, all of one size: how codecs store factors.
struct Plane {
  std::string name;                  // part name
  int width = 0, height = 0;
  std::vector<std::string> channels;  // sorted by name when read
  bool half = true;                  // stored as half, else float
  std::vector<float> values;         // [channel][row][column]
};
// Writes part 0 (attributes of `info`, preview) and the planes.
Status WriteCodedBtf(const BtfFileInfo& info, const std::vector<Plane>& planes,
                     const std::filesystem::path& path);
struct CodedBtf {
  BtfFileInfo info;
  std::map<std::string, Plane> planes;
};
StatusOr<CodedBtf> ReadCodedBtf(const std::filesystem::path& path);

}  // namespace mesorig::btf
