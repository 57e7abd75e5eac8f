#include <string>

#include "daemon/drivers/driver.h"

// One `Driver Describe()` a driver folder, in a namespace named after it.
#define MESORIG_ENTRY(id, name)   \
  namespace mesorig::daemon::id { \
  Driver Describe();              \
  }
#include "daemon/drivers/registry_table.inc"
#undef MESORIG_ENTRY

namespace mesorig::daemon {
namespace {

template <typename Factory>
StatusOr<Factory> Find(std::string_view name, Factory Driver::*member, std::string_view kind) {
  std::string names;
  for (const Driver& driver : AllDrivers()) {
    if (driver.*member == nullptr) continue;
    if (driver.name == name) return driver.*member;
    names += fmt::format("{}{}", names.empty() ? "" : ", ", driver.name);
  }
  return InvalidArgument("no driver \"{}\" for {}; there are: {}", name, kind, names);
}

}  // namespace

const std::vector<Driver>& AllDrivers() {
  static const std::vector<Driver> drivers = [] {
    std::vector<Driver> all;
#define MESORIG_ENTRY(id, public_name) \
  all.push_back(id::Describe());       \
  all.back().name = public_name;
#include "daemon/drivers/registry_table.inc"
#undef MESORIG_ENTRY
    return all;
  }();
  return drivers;
}

StatusOr<std::unique_ptr<Axis>> MakeAxis(std::string_view driver, const DriverContext& context,
                                         int index) {
  MESORIG_ASSIGN_OR_RETURN(const auto make, Find(driver, &Driver::make_axis, "axes"));
  return make(context, index);
}

StatusOr<std::unique_ptr<LampBank>> MakeLampBank(std::string_view driver,
                                                 const DriverContext& context) {
  MESORIG_ASSIGN_OR_RETURN(const auto make, Find(driver, &Driver::make_lamp_bank, "lamp banks"));
  return make(context);
}

StatusOr<std::unique_ptr<DigitalLines>> MakeDigitalLines(std::string_view driver,
                                                         const DriverContext& context) {
  MESORIG_ASSIGN_OR_RETURN(const auto make, Find(driver, &Driver::make_lines, "digital lines"));
  return make(context);
}

StatusOr<std::unique_ptr<LineLaser>> MakeLineLaser(std::string_view driver,
                                                   const DriverContext& context) {
  MESORIG_ASSIGN_OR_RETURN(const auto make, Find(driver, &Driver::make_laser, "line lasers"));
  return make(context);
}

StatusOr<std::unique_ptr<Camera>> MakeCamera(std::string_view driver, const DriverContext& context,
                                             int index) {
  MESORIG_ASSIGN_OR_RETURN(const auto make, Find(driver, &Driver::make_camera, "cameras"));
  return make(context, index);
}

}  // namespace mesorig::daemon
