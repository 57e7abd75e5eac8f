// Files from outside: whatever bytes stand in them, reading ends with a Status.

#include <gtest/gtest.h>

#include <fstream>
#include <random>

#include "processing/btf/btf_file.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

void WriteBytes(const std::filesystem::path& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

// What was read holds together, or the refusal says why.
template <typename T>
void ExpectWholeOrRefused(const StatusOr<T>& read, const BtfHeader* header) {
  if (read.ok()) {
    EXPECT_TRUE(CheckHeader(*header).ok()) << CheckHeader(*header);
  } else {
    EXPECT_FALSE(Message(read.status()).empty());
  }
}

// Reads with every entry point.
void ExpectEveryReadWholeOrRefused(const std::filesystem::path& path) {
  const auto info = ReadBtfInfo(path);
  ExpectWholeOrRefused(info, info.ok() ? &info->header : nullptr);
  const auto sampled = ReadSampledBtf(path);
  ExpectWholeOrRefused(sampled, sampled.ok() ? &sampled->header() : nullptr);
  const auto coded = ReadCodedBtf(path);
  ExpectWholeOrRefused(coded, coded.ok() ? &coded->info.header : nullptr);
}

std::string ValidFile(const TemporaryFolder& folder) {
  BtfHeader header = SmallHeader(6, 4, RingDirections(1, 3, 40), RingDirections(1, 2, 40));
  header.mask.assign(header.texel_count(), 1);
  EXPECT_TRUE(WriteSampledBtf(SyntheticBtf(header), folder / "valid").ok());
  return *ReadFile(folder / "valid");
}

TEST(BtfFileMutation, BytesChanged) {
  TemporaryFolder folder;
  const std::string valid = ValidFile(folder);
  std::mt19937 random(1);
  constexpr char kNasty[] = {0, 1, -1, 127, -128, 'A', 0x10, 0x40};
  for (int i = 0; i < 4000; ++i) {
    std::string bytes = valid;
    const size_t changes = 1 + random() % 4;
    for (size_t k = 0; k < changes; ++k) {
      // Two thirds of them in the headers, which the library trusts most.
      const size_t range = random() % 3 != 0 ? std::min<size_t>(bytes.size(), 2500) : bytes.size();
      bytes[random() % range] = random() % 2 != 0 ? kNasty[random() % sizeof(kNasty)]
                                                  : static_cast<char>(random());
    }
    WriteBytes(folder / "bad", bytes);
    ExpectEveryReadWholeOrRefused(folder / "bad");
  }
}

TEST(BtfFileMutation, LengthsChanged) {
  TemporaryFolder folder;
  const std::string valid = ValidFile(folder);
  std::mt19937 random(2);
  constexpr uint32_t kLengths[] = {0, 1, 0x7fffffff, 0x80000000, 0xffffffff, 0x10000000, 65536};
  for (int i = 0; i < 2000; ++i) {
    std::string bytes = valid;
    const uint32_t length = kLengths[random() % std::size(kLengths)];
    std::memcpy(bytes.data() + random() % std::min<size_t>(bytes.size() - 4, 4000), &length, 4);
    WriteBytes(folder / "bad", bytes);
    ExpectEveryReadWholeOrRefused(folder / "bad");
  }
}

TEST(BtfFileMutation, Truncated) {
  TemporaryFolder folder;
  const std::string valid = ValidFile(folder);
  const size_t step = std::max<size_t>(1, valid.size() / 1000);
  for (size_t n = 0; n < valid.size(); n += step) {
    WriteBytes(folder / "bad", std::string_view(valid).substr(0, n));
    ExpectEveryReadWholeOrRefused(folder / "bad");
    EXPECT_FALSE(ReadSampledBtf(folder / "bad").ok()) << n << " of " << valid.size() << " bytes";
  }
}

TEST(BtfFileMutation, PiecesMovedAndRepeated) {
  TemporaryFolder folder;
  const std::string valid = ValidFile(folder);
  std::mt19937 random(3);
  for (int i = 0; i < 1000; ++i) {
    std::string bytes = valid;
    const size_t at = random() % bytes.size(), n = random() % 64;
    if (random() % 2 != 0) {
      bytes.erase(at, n);
    } else {
      bytes.insert(random() % bytes.size(), bytes.substr(at, n));
    }
    WriteBytes(folder / "bad", bytes);
    ExpectEveryReadWholeOrRefused(folder / "bad");
  }
}

}  // namespace
}  // namespace mesorig::btf
