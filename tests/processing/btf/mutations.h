#pragma once
// Deterministic damage to a valid file, thousands of cases: what reads it must end with a Status.

#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <string_view>

#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {

using Read = std::function<void(const std::filesystem::path& path)>;

inline void ReadBytes(const TemporaryFolder& folder, std::string_view bytes, const Read& read) {
  std::ofstream(folder / "bad", std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  read(folder / "bad");
}

inline void MutateBytes(const std::string& valid, const Read& read) {
  TemporaryFolder folder;
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
    ReadBytes(folder, bytes, read);
  }
}

inline void MutateLengths(const std::string& valid, const Read& read) {
  TemporaryFolder folder;
  std::mt19937 random(2);
  constexpr uint32_t kLengths[] = {0, 1, 0x7fffffff, 0x80000000, 0xffffffff, 0x10000000, 65536};
  for (int i = 0; i < 2000; ++i) {
    std::string bytes = valid;
    const uint32_t length = kLengths[random() % std::size(kLengths)];
    std::memcpy(bytes.data() + random() % std::min<size_t>(bytes.size() - 4, 4000), &length, 4);
    ReadBytes(folder, bytes, read);
  }
}

// `read` must refuse every one.
inline void Truncate(const std::string& valid, const Read& read) {
  TemporaryFolder folder;
  const size_t step = std::max<size_t>(1, valid.size() / 1000);
  for (size_t n = 0; n < valid.size(); n += step) {
    SCOPED_TRACE(n);
    ReadBytes(folder, std::string_view(valid).substr(0, n), read);
  }
}

inline void MovePieces(const std::string& valid, const Read& read) {
  TemporaryFolder folder;
  std::mt19937 random(3);
  for (int i = 0; i < 1000; ++i) {
    std::string bytes = valid;
    const size_t at = random() % bytes.size(), n = random() % 64;
    if (random() % 2 != 0) {
      bytes.erase(at, n);
    } else {
      bytes.insert(random() % bytes.size(), bytes.substr(at, n));
    }
    ReadBytes(folder, bytes, read);
  }
}

}  // namespace mesorig::btf
