#pragma once
// Files of light vectors. The parsers take text, so that tests can feed them anything.

#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::exchange::multi_light {

struct LightEntry {
  std::string image;  // file name as written; empty in lights.txt
  Vec3 direction;     // unit vector to the light, normalised
};

// `.lp`: a count, then `image x y z` a line; names may hold spaces, the last three words are the
// vector. InvalidArgument names `file`, the line and the field.
StatusOr<std::vector<LightEntry>> ParseLp(std::string_view text, const std::string& file);
// `lights.txt`: a count, then `x y z` a line.
StatusOr<std::vector<LightEntry>> ParseLights(std::string_view text, const std::string& file);

// cat.2 before cat.10: runs of digits compare as numbers.
bool NaturalLess(std::string_view a, std::string_view b);

}  // namespace mesorig::exchange::multi_light
