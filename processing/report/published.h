#pragma once
// Internal to processing/report: sizes that papers print, what they follow from, and what our files hold
// for the same data and settings.

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace mesorig::report {

std::string PublishedTables();
nlohmann::json PublishedJson();

}  // namespace mesorig::report
