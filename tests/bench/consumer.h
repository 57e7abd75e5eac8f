#pragma once
// The other process: reads all cameras of a session over the Frames service, a channel a camera, as
// mesorig-processd does, or raw bytes from sockets. Begun before this process has threads.

#include <sys/types.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "protocol/base/status.h"

namespace grpc {
class Server;
}
namespace mesorig::daemon {
class FramesService;
struct Books;
}  // namespace mesorig::daemon

namespace mesorig::bench {

// What `program consume ENDPOINT SESSION LATE_MS` does: reads to the end and prints one line of
// JSON: frames, late (arrived more than LATE_MS after their trigger), worst_ms, bytes, wall_s (of
// the first frame to the last), cpu_s.
int Consume(const std::string& endpoint, const std::string& session_id, double late_ms);
// `program drain FD...`: reads the sockets to their ends.
int Drain(const std::vector<int>& sockets);

// A child that runs this program with other arguments; what it prints is its result.
class Child {
 public:
  static Child Start(const std::vector<std::string>& arguments, const std::vector<int>& keep_open);
  nlohmann::json Result();  // waits for its end

 private:
  pid_t pid_ = -1;
  int output_ = -1;
};

// The Frames service on a socket in `folder`.
class FramesServer {
 public:
  FramesServer(const std::filesystem::path& folder, daemon::Books& books);
  ~FramesServer();
  const std::string& endpoint() const { return endpoint_; }

 private:
  std::string endpoint_;
  std::unique_ptr<daemon::FramesService> service_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace mesorig::bench
