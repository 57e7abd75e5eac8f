#pragma once
// Reading of report.json: everything in it may be missing or of another type.

#include <initializer_list>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace mesorig::report {

// The value at that path of keys, borrowed from `root`; null when there is none.
const nlohmann::json* Find(const nlohmann::json& root, std::initializer_list<const char*> path);
// Nothing unless it is a finite number. Booleans are no numbers.
std::optional<double> NumberIn(const nlohmann::json& object, const std::string& key);
// "" unless it is text.
std::string TextIn(const nlohmann::json& object, const std::string& key);

}  // namespace mesorig::report
