#include "processing/exchange/importer.h"

#include <fmt/ranges.h>

#define MESORIG_ENTRY(id, public_name) \
  namespace mesorig::exchange::id {    \
  const Importer& TheImporter();       \
  }
#include "processing/exchange/registry_table.inc"
#undef MESORIG_ENTRY

namespace mesorig::exchange {

const std::vector<const Importer*>& AllImporters() {
  static const std::vector<const Importer*> all = {
#define MESORIG_ENTRY(id, public_name) &id::TheImporter(),
#include "processing/exchange/registry_table.inc"
#undef MESORIG_ENTRY
  };
  return all;
}

StatusOr<const Importer*> FindImporter(std::string_view name) {
  std::vector<std::string_view> names;
  for (const Importer* importer : AllImporters()) {
    if (importer->name() == name) return importer;
    names.push_back(importer->name());
  }
  return InvalidArgument("there is no format `{}`; there are {}", name, fmt::join(names, ", "));
}

}  // namespace mesorig::exchange
