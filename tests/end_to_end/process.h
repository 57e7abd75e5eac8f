#pragma once
// Programs of the build as child processes, for tests that run the chain as a user does.

#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

namespace mesorig::test {

struct Outcome {
  int code = -1;     // exit status; 128 + signal when killed
  std::string text;  // stdout and stderr together
};

// Runs a program of the build to its end.
Outcome RunProgram(const std::string& program, const std::vector<std::string>& arguments);

// A program that keeps running; its output goes to a log file. Ended with SIGTERM, by its id, when
// the object goes.
class Service {
 public:
  Service(const std::string& program, const std::vector<std::string>& arguments,
          std::filesystem::path log);
  ~Service();
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;
  pid_t pid() const { return pid_; }
  bool Running();
  // Waits for its end after a signal; exit status, or -1 when it does not end in 20 s of host time.
  int End(int signal);
  std::string Log() const;

 private:
  pid_t pid_;
  std::filesystem::path log_;
};

// Between two looks at another process: the cores are the programs'.
void PollPause();

// Waits at most 60 s of host time for a file to appear.
bool AwaitFile(const std::filesystem::path& path);

// A folder of its own, removed at the end; its path is short enough for sockets.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace mesorig::test
