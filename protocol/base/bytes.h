#pragma once
// Little-endian serialisation with bounds checks. A reader that ran past its end stays failed and
// returns zeros, so that a parser checks `ok()` once at its end (and before it allocates by a
// length that it read).

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace mesorig {

class ByteWriter {
 public:
  template <typename T>
  ByteWriter& Put(T value) {
    static_assert(std::is_arithmetic_v<T>);
    const size_t at = bytes_.size();
    bytes_.resize(at + sizeof(T));
    std::memcpy(bytes_.data() + at, &value, sizeof(T));
    return *this;
  }
  // u32 length, then the bytes.
  ByteWriter& PutString(std::string_view text) {
    Put(static_cast<uint32_t>(text.size()));
    bytes_.append(text);
    return *this;
  }
  ByteWriter& PutRaw(std::string_view raw) {
    bytes_.append(raw);
    return *this;
  }
  const std::string& bytes() const { return bytes_; }
  std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

// Borrows the bytes.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : rest_(bytes) {}
  template <typename T>
  T Get() {
    static_assert(std::is_arithmetic_v<T> && !std::is_same_v<T, bool>);
    T value{};
    const std::string_view raw = GetRaw(sizeof(T));
    if (raw.size() == sizeof(T)) std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }
  std::string_view GetString() { return GetRaw(Get<uint32_t>()); }
  // Empty, and failed, when fewer than `size` bytes are left.
  std::string_view GetRaw(size_t size);
  size_t remaining() const { return rest_.size(); }
  bool ok() const { return ok_; }
  // Whole: nothing missing, nothing left over.
  bool done() const { return ok_ && rest_.empty(); }

 private:
  std::string_view rest_;
  bool ok_ = true;
};

}  // namespace mesorig
