#pragma once
// One simulated NXT brick for USB/IP (`usbip attach -r 127.0.0.1 -b 1-1` brings it into the kernel,
// where libusb finds it): a server on a port of the loopback interface, one client at a time.

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "protocol/base/mutex.h"
#include "protocol/base/status.h"
#include "protocol/base/unique_fd.h"
#include "simulator/bridge/nxt_usb.h"

namespace mesorig::simulator {

class UsbipServer {
 public:
  // `out` gets each packet of the OUT endpoint, at most 64 bytes, on the server's thread. port 0:
  // any (port()). Unavailable: the port is taken.
  static StatusOr<std::unique_ptr<UsbipServer>> Open(int port, std::string serial,
                                                     std::function<void(std::string)> out);
  ~UsbipServer();
  int port() const { return port_; }
  // A packet for the IN endpoint; waits there until the host asks for it. Any thread. The oldest of
  // more than kMostWaiting is lost, as is what waits when a client leaves.
  void Deliver(std::string packet) EXCLUDES(mutex_);

  static constexpr size_t kMostWaiting = 16;

 private:
  UsbipServer(UniqueFd listener, int port, std::string serial,
              std::function<void(std::string)> out);
  void Accept();
  // Until the client leaves, or says what it must not.
  void Serve(int client);
  Status AnswerRequest(int client, bool& attached);
  Status AnswerUrb(int client);
  void Submit(const usbip::Urb& urb, std::string data) EXCLUDES(mutex_);
  void Unlink(const usbip::Urb& urb) EXCLUDES(mutex_);
  // Hands waiting packets to waiting URBs.
  void Match() REQUIRES(mutex_);
  void Send(const std::string& message) REQUIRES(mutex_);
  // Exactly `size` bytes; Cancelled at the end, or when the client has left.
  StatusOr<std::string> Read(int client, size_t size);

  const UniqueFd listener_;
  const int port_;
  NxtUsb device_;  // of the thread
  const std::function<void(std::string)> out_;
  std::atomic<bool> ending_{false};
  Mutex mutex_;
  int client_ GUARDED_BY(mutex_) = -1;              // attached
  std::deque<usbip::Urb> urbs_ GUARDED_BY(mutex_);  // of the IN endpoint, without a packet yet
  std::deque<std::string> packets_ GUARDED_BY(mutex_);
  std::thread thread_;
};

}  // namespace mesorig::simulator
