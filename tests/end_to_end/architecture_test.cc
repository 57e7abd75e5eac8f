// The arrows of the house: what each library may link, held against CMake's own graph and against
// the includes of the sources. A library not named here by its prefix fails: decide where it lives.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
using Prefixes = std::vector<std::string>;

// Longest matching prefix decides. Empty: nothing of the project.
const std::map<std::string, Prefixes> kMayLink = {
    {"protocol_base", {}},
    {"protocol_rig", {"protocol_base"}},
    {"protocol_plan", {"protocol_base", "protocol_rig"}},
    {"protocol_sim_wire", {"protocol_base"}},
    {"protocol_messages", {}},
    {"protocol_wire", {"protocol_base", "protocol_messages"}},
    {"daemon_device", {"protocol_base", "protocol_rig"}},
    {"daemon_bus", {"protocol_base", "protocol_rig", "protocol_sim_wire", "daemon_device"}},
    {"daemon_drivers",
     {"protocol_base", "protocol_rig", "daemon_device", "daemon_bus", "daemon_drivers"}},
    {"daemon_drivers_sim_camera",
     {"protocol_base", "protocol_rig", "protocol_sim_wire", "daemon_device", "daemon_bus"}},
    {"daemon_session", {"protocol_base", "protocol_rig", "protocol_plan"}},
    {"daemon_safety", {"protocol_base", "protocol_rig", "daemon_device"}},
    {"daemon_control",
     {"protocol_base", "protocol_rig", "protocol_plan", "daemon_device", "daemon_session",
      "daemon_safety"}},
    {"daemon_service",
     {"protocol_", "daemon_control", "daemon_session", "daemon_safety", "daemon_device"}},
    {"daemon_app", {"protocol_", "daemon_"}},
    {"client",
     {"protocol_base", "protocol_rig", "protocol_plan", "protocol_messages", "protocol_wire",
      "client_"}},
    {"processing_btf", {"protocol_base", "protocol_rig"}},
    {"codecs_decode", {"protocol_base", "processing_btf", "codecs_decode"}},
    {"codecs_encode", {"protocol_base", "processing_btf", "codecs_"}},
    {"codecs_", {"protocol_base", "processing_btf", "codecs_"}},
    {"processing", {"protocol_base", "protocol_rig", "protocol_plan", "processing_", "codecs_"}},
    {"processing_service", {"protocol_", "processing_", "codecs_"}},
    {"processing_app", {"protocol_", "processing_", "codecs_"}},
    {"renderer", {"protocol_base", "processing_btf", "codecs_decode", "renderer_"}},
    {"simulator_plant", {"protocol_base", "protocol_rig", "simulator_plant"}},
    {"simulator_bridge", {"protocol_base", "protocol_sim_wire"}},
    {"simulator_world", {"protocol_base", "protocol_rig", "processing_btf", "simulator_plant"}},
    {"simulator_devices",
     {"protocol_base", "protocol_rig", "protocol_sim_wire", "simulator_plant", "simulator_world",
      "simulator_devices"}},
};

const Prefixes* RuleFor(const std::string& library) {
  const Prefixes* best = nullptr;
  size_t length = 0;
  for (const auto& [prefix, allowed] : kMayLink) {
    if (library.starts_with(prefix) && prefix.size() >= length) {
      best = &allowed;
      length = prefix.size();
    }
  }
  return best;
}

bool Allowed(const Prefixes& rule, const std::string& target) {
  for (const std::string& prefix : rule) {
    if (target.starts_with(prefix)) return true;
  }
  return false;
}

TEST(Architecture, LibrariesLinkOnlyWhatTheDesignPermits) {
  std::ifstream graph(std::string(MESORIG_BUILD_DIR) + "/target_graph.txt");
  std::string line;
  int libraries = 0;
  while (std::getline(graph, line)) {
    std::istringstream words(line);
    std::string library, link;
    words >> library;
    ++libraries;
    const Prefixes* rule = RuleFor(library);
    ASSERT_NE(rule, nullptr) << library << " has no place in the table of DESIGN";
    while (words >> link) {
      if (!link.starts_with("mesorig::")) continue;
      const std::string target = link.substr(9);
      EXPECT_TRUE(Allowed(*rule, target)) << library << " links " << target;
    }
  }
  EXPECT_GT(libraries, 10);
}

// Includes of one top-level folder from another, against the same table at folder level.
TEST(Architecture, SourcesIncludeOnlyWhatTheDesignPermits) {
  const std::map<std::string, Prefixes> may_include = {
      {"protocol", {"protocol/"}},
      {"daemon", {"protocol/", "daemon/"}},
      {"client", {"protocol/", "client/"}},
      {"processing", {"protocol/", "processing/"}},
      {"renderer", {"protocol/base/", "processing/btf/", "processing/codecs/", "renderer/"}},
      {"simulator", {"protocol/", "processing/btf/", "simulator/"}},
  };
  const std::regex include("^\\s*#\\s*include\\s*[<\"]([^>\"]+)[>\"]");
  int files = 0;
  for (const auto& [top, allowed] : may_include) {
    const fs::path folder = fs::path(MESORIG_SOURCE_DIR) / top;
    ASSERT_TRUE(fs::is_directory(folder)) << folder;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc") continue;
      ++files;
      std::ifstream in(entry.path());
      std::string line;
      std::smatch match;
      while (std::getline(in, line)) {
        if (!std::regex_search(line, match, include)) continue;
        const std::string header = match[1];
        const bool ours = may_include.contains(header.substr(0, header.find('/')));
        EXPECT_TRUE(!ours || Allowed(allowed, header)) << entry.path() << " includes " << header;
        const bool no_opencv = top == "daemon" || top == "protocol" || top == "client";
        EXPECT_FALSE(no_opencv && header.starts_with("opencv")) << entry.path();
      }
    }
  }
  EXPECT_GT(files, 50);
}

}  // namespace
