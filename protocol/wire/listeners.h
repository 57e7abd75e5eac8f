#pragma once
// Sockets that this program accepts on itself, to see who comes before anything is read: the uid
// and groups of a local peer, how many are there already. One thread for all of them.

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig::wire {

struct LocalPeer {
  uid_t uid = 0;
  gid_t gid = 0;
  pid_t pid = 0;
  std::vector<gid_t> groups;  // supplementary ones, when it connected
};

// "anna" of the password file, else "uid 1000".
std::string UserName(uid_t uid);
// NotFound names the group.
StatusOr<gid_t> GroupNamed(const std::string& name);

struct Connection {
  int listener_fd = -1;
  int fd = -1;       // the taker's, non-blocking
  std::string from;  // "uid 1000", "10.0.0.7:51234"
  std::optional<LocalPeer> local;
};

struct ListenerLimits {
  size_t connections = 512;           // of all listeners together
  size_t connections_from_one = 256;  // of one uid, of one address
};

// Listeners are added, then Start; Stop closes them and joins the thread. Connections that were
// handed out live on. Add and Start on one thread.
class Listeners {
 public:
  // Owns connection.fd from then on. On the thread of the listeners: never waits.
  using Take = std::function<void(Connection&& connection)>;
  explicit Listeners(ListenerLimits limits = {});
  ~Listeners();

  // A socket that has `mode` and `group` from its first moment. Replaces a stale one.
  Status AddUnix(const std::filesystem::path& path, mode_t mode, std::optional<gid_t> group,
                 Take take);
  // Where it listens: port 0 takes a free one. InvalidArgument for what is no HOST:PORT.
  StatusOr<std::string> AddTcp(const std::string& host_port, Take take);
  void Start();
  void Stop();

 private:
  struct Listener {
    int fd;
    bool local;
    Take take;
  };
  // A connection lives as long as its descriptor means the same socket.
  struct Open {
    int fd;
    ino_t inode;
    std::string who;  // uid or address
  };
  void Run();
  void Accept(const Listener& listener);
  // Logs at most one refusal a second.
  void Refuse(const Connection& connection, std::string_view reason);
  // Empty: one more may come.
  std::string WhyNot(const std::string& who);

  const ListenerLimits limits_;
  std::vector<Listener> listeners_;
  std::vector<Open> open_;                      // of the thread
  std::chrono::steady_clock::time_point told_;  // when a refusal was last logged
  int untold_ = 0;                              // refusals since
  int wake_[2] = {-1, -1};                      // closed to end the thread
  std::thread thread_;
};

}  // namespace mesorig::wire
