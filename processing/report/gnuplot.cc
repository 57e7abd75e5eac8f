#include "processing/report/gnuplot.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "protocol/base/file_writer.h"

namespace mesorig::report {
namespace {

// A folder of its own, removed with the object.
class TemporaryFolder {
 public:
  static StatusOr<TemporaryFolder> Create() {
    std::error_code error;
    std::string name = (std::filesystem::temp_directory_path(error) / "mesorig-plot-XXXXXX").string();
    if (error || ::mkdtemp(name.data()) == nullptr) {
      return Unavailable("cannot create {}: {}", name, std::strerror(errno));
    }
    return TemporaryFolder(name);
  }
  TemporaryFolder(TemporaryFolder&& other) noexcept : path(std::exchange(other.path, {})) {}
  TemporaryFolder& operator=(TemporaryFolder&&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    if (!path.empty()) std::filesystem::remove_all(path, ignored);
  }
  std::filesystem::path path;

 private:
  explicit TemporaryFolder(std::filesystem::path p) : path(std::move(p)) {}
};

// The first line of what gnuplot complained about.
std::string Complaint(const std::filesystem::path& log) {
  const StatusOr<std::string> text = ReadFile(log);
  if (!text.ok()) return "";
  for (size_t at = 0; at < text->size();) {
    const size_t end = std::min(text->find('\n', at), text->size());
    const std::string line = text->substr(at, end - at);
    if (line.find_first_not_of(" ^\t") != std::string::npos) return line;
    at = end + 1;
  }
  return "";
}

Status Run(const std::filesystem::path& folder) {
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "log.txt",
                                     O_WRONLY | O_CREAT | O_TRUNC, 0644);
  ::posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  std::array<const char*, 3> arguments = {"gnuplot", "script.gp", nullptr};
  pid_t child = 0;
  const int error = ::posix_spawnp(&child, "gnuplot", &actions, nullptr,
                                   const_cast<char* const*>(arguments.data()), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) return FailedPrecondition("gnuplot is not installed");
  if (error != 0) return Unavailable("cannot start gnuplot: {}", std::strerror(error));
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return OkStatus();
  return Unavailable("gnuplot failed: {}", Complaint(folder / "log.txt"));
}

}  // namespace

std::string DataText(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\n' || c == '\t' || c == '\\') {
      quoted += ' ';
    } else if (static_cast<unsigned char>(c) >= 0x20) {
      quoted += c;
    }
  }
  return quoted + "\"";
}

Status Plot(std::string_view script, std::string_view data, const std::filesystem::path& png) {
  MESORIG_ASSIGN_OR_RETURN(const TemporaryFolder folder, TemporaryFolder::Create());
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(folder.path / "script.gp", script));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(folder.path / "data.txt", data));
  MESORIG_RETURN_IF_ERROR(Run(folder.path));
  MESORIG_ASSIGN_OR_RETURN(const std::string picture, ReadFile(folder.path / "plot.png"));
  return WriteFileAtomically(png, picture);
}

}  // namespace mesorig::report
