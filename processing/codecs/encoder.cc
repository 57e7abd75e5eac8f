#include "processing/codecs/encoder.h"

#include <fmt/ranges.h>

#define MESORIG_ENTRY(id, public_name) \
  namespace mesorig::codecs::id {      \
  const Encoder& TheEncoder();         \
  }
#include "processing/codecs/registry_table.inc"
#undef MESORIG_ENTRY

namespace mesorig::codecs {

const std::vector<const Encoder*>& AllEncoders() {
  static const std::vector<const Encoder*> all = {
#define MESORIG_ENTRY(id, public_name) &id::TheEncoder(),
#include "processing/codecs/registry_table.inc"
#undef MESORIG_ENTRY
  };
  return all;
}

StatusOr<const Encoder*> FindEncoder(std::string_view name) {
  std::vector<std::string_view> names;
  for (const Encoder* encoder : AllEncoders()) {
    if (encoder->name() == name) return encoder;
    names.push_back(encoder->name());
  }
  return InvalidArgument("there is no codec `{}`; there are {}", name, fmt::join(names, ", "));
}

}  // namespace mesorig::codecs
