#include "protocol/base/bytes.h"

namespace mesorig {

std::string_view ByteReader::GetRaw(size_t size) {
  if (!ok_ || size > rest_.size()) {
    ok_ = false;
    rest_ = {};
    return {};
  }
  const std::string_view taken = rest_.substr(0, size);
  rest_.remove_prefix(size);
  return taken;
}

}  // namespace mesorig
