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
// Which start of its session the folder's products were made of; 0: it does not say. A session that
// began again since, for frames to be taken again, makes them stale.
uint32_t StartOfProducts(const std::filesystem::path& folder);
// Readies the folder for what is made of this start: products of another one are removed.
// Displacement images stay, each knows its frames. Unavailable names the file.
Status BeginProducts(const std::filesystem::path& folder, uint32_t start);

v1::Product ProductOf(const char* kind, const std::filesystem::path& path, uint64_t bytes);

}  // namespace mesorig::service
