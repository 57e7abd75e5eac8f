#pragma once
// Witnesses: programs of others that see the same interface. What they say is kept in the report's
// folder, beside what was claimed.

#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <thread>

namespace mesorig::hil {

// Its output, stderr too. The command must end.
inline std::string Shell(const std::string& command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(::popen((command + " 2>&1").c_str(), "r"),
                                                   ::pclose);
  EXPECT_NE(pipe, nullptr);
  std::string text;
  std::array<char, 4096> buffer{};
  while (pipe && std::fgets(buffer.data(), buffer.size(), pipe.get()) != nullptr) {
    text += buffer.data();
  }
  std::printf("$ %s\n%s", command.c_str(), text.c_str());
  return text;
}

// Waits for what another process does. False after two minutes: the guest is slow.
inline bool Eventually(const std::function<bool()>& happened) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(120);
  while (!happened()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

// The kernel's list of those who take every frame: our own port has a filter.
inline bool CandumpListens() {
  return Shell("cat /proc/net/can/rcvlist_all").find("raw") != std::string::npos;
}

}  // namespace mesorig::hil
