#include "protocol/base/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "protocol/base/unique_fd.h"

namespace mesorig {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr size_t kMaxOutput = 4096;
constexpr int kLookMs = 50;

struct Pipes {
  UniqueFd input, output;              // ours
  UniqueFd child_input, child_output;  // the child's
};

Status Open(Pipes& pipes) {
  int in[2], out[2];
  // A socket, for MSG_NOSIGNAL.
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, in) != 0) {
    return Unavailable("socketpair: {}", std::strerror(errno));
  }
  pipes.input = UniqueFd(in[0]);
  pipes.child_input = UniqueFd(in[1]);
  if (::pipe2(out, O_CLOEXEC) != 0) return Unavailable("pipe: {}", std::strerror(errno));
  pipes.output = UniqueFd(out[0]);
  pipes.child_output = UniqueFd(out[1]);
  ::fcntl(pipes.input.get(), F_SETFL, O_NONBLOCK);
  ::fcntl(pipes.output.get(), F_SETFL, O_NONBLOCK);
  return OkStatus();
}

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

StatusOr<pid_t> Spawn(const ChildCommand& command, const Pipes& pipes) {
  posix_spawn_file_actions_t files;
  ::posix_spawn_file_actions_init(&files);
  ::posix_spawn_file_actions_adddup2(&files, pipes.child_input.get(), 0);
  ::posix_spawn_file_actions_adddup2(&files, pipes.child_output.get(), 1);
  ::posix_spawn_file_actions_adddup2(&files, pipes.child_output.get(), 2);
  ::posix_spawn_file_actions_addclosefrom_np(&files, 3);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  sigset_t none, defaults;
  sigemptyset(&none);
  sigemptyset(&defaults);
  sigaddset(&defaults, SIGPIPE);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(&attributes, static_cast<int16_t>(POSIX_SPAWN_SETSIGMASK |
                                                               POSIX_SPAWN_SETSIGDEF |
                                                               POSIX_SPAWN_SETPGROUP));
  std::vector<std::string> argv = command.argv;
  std::vector<std::string> added = command.environment;
  std::vector<char*> environment = Pointers(added);
  environment.pop_back();
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view text(*variable);
    const auto hides = [&](const std::string& other) {
      return text.substr(0, text.find('=')) == std::string_view(other).substr(0, other.find('='));
    };
    if (std::none_of(added.begin(), added.end(), hides)) environment.push_back(*variable);
  }
  environment.push_back(nullptr);
  pid_t pid = -1;
  const int error = ::posix_spawnp(&pid, argv[0].c_str(), &files, &attributes,
                                   Pointers(argv).data(), environment.data());
  ::posix_spawn_file_actions_destroy(&files);
  ::posix_spawnattr_destroy(&attributes);
  if (error == ENOENT) return NotFound("{}: there is no such program", command.argv[0]);
  if (error != 0) {
    return InvalidArgument("{}: cannot be started: {}", command.argv[0], std::strerror(error));
  }
  return pid;
}

// Writes what the child takes, reads what it says; at most kLookMs.
void Exchange(Pipes& pipes, std::string_view& input, std::string& output) {
  if (input.empty()) pipes.input.Close();
  pollfd fds[] = {{pipes.output.get(), POLLIN, 0}, {pipes.input.get(), POLLOUT, 0}};
  ::poll(fds, 2, kLookMs);
  if (fds[0].revents != 0) {
    char buffer[4096];
    const ssize_t n = ::read(pipes.output.get(), buffer, sizeof(buffer));
    if (n > 0) {
      const size_t room = kMaxOutput - std::min(kMaxOutput, output.size());
      output.append(buffer, std::min(room, static_cast<size_t>(n)));
    } else if (n == 0 || errno != EAGAIN) {
      pipes.output.Close();
    }
  }
  if (fds[1].revents != 0) {
    const ssize_t n = ::send(pipes.input.get(), input.data(), input.size(), MSG_NOSIGNAL);
    if (n > 0) {
      input.remove_prefix(static_cast<size_t>(n));
    } else if (errno != EAGAIN) {
      input = {};  // it does not want more
    }
  }
}

void Kill(pid_t pid) {
  ::kill(-pid, SIGKILL);
  ::kill(pid, SIGKILL);
  ::waitpid(pid, nullptr, 0);
}

}  // namespace

StatusOr<ChildOutcome> RunChild(const ChildCommand& command, const std::atomic<bool>* cancel) {
  if (command.argv.empty() || command.argv[0].empty()) {
    return InvalidArgument("a command without a program");
  }
  const auto deadline = HostClock::now() + command.limit;
  Pipes pipes;
  MESORIG_RETURN_IF_ERROR(Open(pipes));
  MESORIG_ASSIGN_OR_RETURN(const pid_t pid, Spawn(command, pipes));
  pipes.child_input.Close();
  pipes.child_output.Close();
  ChildOutcome outcome;
  std::string_view input = command.input;
  for (;;) {
    Exchange(pipes, input, outcome.output);
    int status = 0;
    // What it left running keeps the pipe open: its own end counts.
    if (::waitpid(pid, &status, WNOHANG) == pid) {
      if (pipes.output.get() >= 0) Exchange(pipes, input, outcome.output);
      outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      return outcome;
    }
    if (cancel != nullptr && *cancel) {
      Kill(pid);
      return Cancelled("{}: not waited for", command.argv[0]);
    }
    if (HostClock::now() < deadline) continue;
    Kill(pid);
    return DeadlineExceeded("{}: took more than {} ms and was ended", command.argv[0],
                            command.limit.count());
  }
}

}  // namespace mesorig
