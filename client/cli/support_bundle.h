#pragma once
// What somebody who helps needs, in one file: no pixels, no keys, no secrets.

#include <filesystem>
#include <string>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::client {

struct BundleFile {
  std::string name;  // within the bundle; no folders
  std::string content;
};

// A gzipped tar of a folder with these files, by the system's tar; whole or absent. InvalidArgument
// for an `out` that is there or does not end in .tar.gz, and for a name that is none.
Status WriteBundle(const std::filesystem::path& out, const std::vector<BundleFile>& files);

}  // namespace mesorig::client
