#pragma once
// A script of faults: lines `at SECONDS DEVICE FAULT...`, SECONDS of virtual time since the
// simulator started; `#` begins a comment, empty lines mean nothing. Lines of one instant act in
// the script's order.

#include <filesystem>
#include <string_view>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/sim_server.h"

namespace mesorig::simulator {

// Sorted by time. InvalidArgument names `path`, the line and what is wrong with it.
StatusOr<std::vector<sim_wire::TimedInjection>> ParseFaultScript(std::string_view text,
                                                                 std::string_view path,
                                                                 const Rig& rig);
// NotFound when there is no such file; Unavailable when it cannot be read.
StatusOr<std::vector<sim_wire::TimedInjection>> LoadFaultScript(const std::filesystem::path& path,
                                                                const Rig& rig);

}  // namespace mesorig::simulator
