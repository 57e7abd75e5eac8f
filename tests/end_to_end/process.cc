#include "tests/end_to_end/process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <thread>
#include <utility>

#include "protocol/base/check.h"

namespace mesorig::test {
namespace {

using HostClock = std::chrono::steady_clock;

// stdout and stderr of the child go to `fd`.
pid_t Start(const std::string& program, const std::vector<std::string>& arguments, int fd) {
  std::string path = std::string(MESORIG_BIN_DIR) + "/" + program;
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv = {path.data()};
  for (std::string& argument : copies) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const pid_t pid = ::fork();
  MESORIG_CHECK(pid >= 0);
  if (pid > 0) return pid;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // no process is left behind when the test dies
  ::dup2(fd, STDOUT_FILENO);
  ::dup2(fd, STDERR_FILENO);
  ::execv(path.c_str(), argv.data());
  ::_exit(127);
}

int CodeOf(int status) { return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status); }

}  // namespace

Outcome RunProgram(const std::string& program, const std::vector<std::string>& arguments) {
  int fds[2];
  MESORIG_CHECK(::pipe2(fds, O_CLOEXEC) == 0);
  const pid_t pid = Start(program, arguments, fds[1]);
  ::close(fds[1]);
  Outcome outcome;
  char buffer[4096];
  ssize_t n;
  while ((n = ::read(fds[0], buffer, sizeof(buffer))) > 0) {
    outcome.text.append(buffer, static_cast<size_t>(n));
  }
  ::close(fds[0]);
  int status = 0;
  ::waitpid(pid, &status, 0);
  outcome.code = CodeOf(status);
  return outcome;
}

Service::Service(const std::string& program, const std::vector<std::string>& arguments,
                 std::filesystem::path log)
    : log_(std::move(log)) {
  const int fd = ::open(log_.c_str(), O_CREAT | O_WRONLY | O_APPEND | O_CLOEXEC, 0644);
  pid_ = Start(program, arguments, fd);
  ::close(fd);
}

Service::~Service() {
  if (pid_ > 0) End(SIGTERM);
}

bool Service::Running() {
  if (pid_ <= 0) return false;
  siginfo_t info{};
  return ::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
         info.si_pid == 0;
}

int Service::End(int signal) {
  const pid_t pid = std::exchange(pid_, -1);
  if (pid <= 0) return -1;
  ::kill(pid, signal);
  const auto limit = HostClock::now() + std::chrono::seconds(20);
  int status = 0;
  while (::waitpid(pid, &status, WNOHANG) == 0) {
    if (HostClock::now() > limit) {
      ::kill(pid, SIGKILL);
      ::waitpid(pid, &status, 0);
      return -1;
    }
    PollPause();
  }
  return CodeOf(status);
}

std::string Service::Log() const {
  std::ostringstream text;
  text << std::ifstream(log_).rdbuf();
  return text.str();
}

void PollPause() { std::this_thread::sleep_for(std::chrono::milliseconds(2)); }

bool AwaitFile(const std::filesystem::path& path) {
  const auto limit = HostClock::now() + std::chrono::seconds(60);
  while (!std::filesystem::exists(path)) {
    if (HostClock::now() > limit) return false;
    PollPause();
  }
  return true;
}

TemporaryFolder::TemporaryFolder() {
  char name[] = "/tmp/mesorig-XXXXXX";
  MESORIG_CHECK(::mkdtemp(name) != nullptr);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace mesorig::test
