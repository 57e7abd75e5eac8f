#pragma once
// Internal to processing/service: where the products of a session are. Reentrant.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/messages/processing.pb.h"

namespace mesorig::service {

// InvalidArgument for an id that is no plain folder name.
Status CheckSessionId(const std::string& session_id);

// `<folder>/sample.btf.exr`, `<folder>/sample.mdf.exr`; displacement images of sweeps, which
// outlive the job, lie in `<folder>/displacements`.
std::filesystem::path BtfPath(const std::filesystem::path& folder);
std::filesystem::path MdfPath(const std::filesystem::path& folder);
std::filesystem::path DisplacementsPath(const std::filesystem::path& folder);
// The products in the folder of a session that was packed to its end; none for any other folder.
// The MDF is written last, and the displacements tell that there must be one.
std::vector<v1::Product> ProductsOnDisk(const std::filesystem::path& folder);

v1::Product ProductOf(const char* kind, const std::filesystem::path& path, uint64_t bytes);

}  // namespace mesorig::service
