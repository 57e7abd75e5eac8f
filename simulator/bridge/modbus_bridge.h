#pragma once
// The simulated lamp bank on a serial line: a pseudo-terminal whose requests (Modbus RTU) are carried
// to the slave's TCP connection, as Modbus gateways do. What the slave does not answer, and what comes
// damaged, is not answered.

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "protocol/base/status.h"
#include "protocol/base/unique_fd.h"
#include "simulator/bridge/rtu_framer.h"

namespace mesorig::simulator {

class ModbusBridge {
 public:
  // `link` becomes a symbolic link to the terminal, for as long as the object lives: closing hangs it
  // up. `slave`: "127.0.0.1:PORT". Unavailable: no terminal, no link.
  static StatusOr<std::unique_ptr<ModbusBridge>> Open(const std::string& link,
                                                      const std::string& slave);
  ~ModbusBridge();

 private:
  ModbusBridge(std::string link, int port, UniqueFd terminal);
  void Serve();
  void Answer(const std::string& request);
  // What the slave answers, without the header; empty: nothing in time.
  std::string Ask(const std::string& request);
  bool ConnectSlave();

  const std::string link_;
  const int port_;
  const UniqueFd terminal_;
  UniqueFd slave_;  // of the thread
  uint16_t transaction_ = 0;
  RtuFramer framer_;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace mesorig::simulator
