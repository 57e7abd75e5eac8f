#pragma once
// The daemon's own channel for stop (protocol/wire/stop_line.h): a socket and threads that belong
// to nothing else, so that no lease, audit log, database, pool of calls or flood of them is in its
// way. Who may watch may stop: the daemon's user, root, and the members of every group that opens a
// socket of a role.

#include <sys/types.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "protocol/wire/listeners.h"

namespace mesorig::daemon {

struct StopDoorOptions {
  std::vector<std::string> groups;
  size_t connections = 64;  // that have not said stop yet; the oldest makes room for one more
  std::chrono::milliseconds patience{2000};  // for the line, host time
};

// Thread-safe.
class StopDoor {
 public:
  struct Order {
    std::string reason;  // may be empty
    std::string who;     // user name
  };
  // Switches everything off, once for all who asked meanwhile. On a thread that does only this.
  using Stop = std::function<Status(const std::vector<Order>& orders)>;

  // NotFound: a group; FailedPrecondition: the socket.
  static StatusOr<std::unique_ptr<StopDoor>> Open(const std::filesystem::path& socket,
                                                  StopDoorOptions options, Stop stop);
  ~StopDoor();  // removes the socket

 private:
  struct Guest {
    int fd;
    std::string who, line;
    std::chrono::steady_clock::time_point since;
  };
  struct Waiting {
    int fd;
    Order order;
  };

  StopDoor(std::filesystem::path socket, StopDoorOptions options, Stop stop);
  bool Welcome(const wire::LocalPeer& peer) const;
  void Take(wire::Connection&& connection);  // on the listener's thread
  void Read();                               // the reader's thread
  // False: the guest has gone, or waits for its answer.
  bool Hear(Guest& guest);
  void CarryOut();  // the stopping thread

  const std::filesystem::path socket_;
  const StopDoorOptions options_;
  const Stop stop_;
  std::vector<gid_t> groups_;
  int wake_ = -1;  // eventfd
  std::mutex mutex_;
  std::condition_variable changed_;
  bool ending_ = false;           // guarded by mutex_
  std::vector<Guest> arrivals_;   // guarded by mutex_
  std::vector<Waiting> waiting_;  // guarded by mutex_
  std::thread reader_, stopper_;
  wire::Listeners listeners_;  // ends first
};

}  // namespace mesorig::daemon
