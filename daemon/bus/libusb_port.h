#pragma once
// A device with two bulk endpoints by libusb 1.0, found by its serial number.
//
// Lost and found: a device that is unplugged, or was not there at first, is opened when it comes
// (hot-plug, and looked for every kRetry); meanwhile Write is Unavailable, with the reason. One
// process has a device: a second one is refused with the first one's pid.

#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "daemon/bus/usb_port.h"
#include "protocol/base/mutex.h"
#include "protocol/base/unique_fd.h"

struct libusb_context;
struct libusb_device;
struct libusb_device_handle;
struct libusb_transfer;

namespace mesorig::daemon {

struct UsbKind {
  std::string what;  // "NXT brick", for messages
  uint16_t vendor = 0, product = 0;
  uint8_t out = 0, in = 0;  // endpoints, bulk, of interface 0
};

struct UsbPortFigures {
  uint64_t sent = 0, received = 0;  // packets
  uint64_t reconnects = 0;
};

class LibusbPort final : public UsbPort {
 public:
  // FailedPrecondition: another process has it. A device that is not there is no error: it may
  // come.
  static StatusOr<std::unique_ptr<LibusbPort>> Open(RigClock& clock, UsbKind kind,
                                                    const std::string& serial);
  ~LibusbPort() override;

  // InvalidArgument for more than kPacketBytes. Unavailable: it is not there, was unplugged, or
  // took nothing for kSendLimit.
  Status Write(std::string_view packet) override;
  void OnPacket(std::function<void(RigTime, std::string packet)> handler) override;

  // OK: there, and ours. Any thread.
  Status Health() const EXCLUDES(mutex_);
  UsbPortFigures figures() const EXCLUDES(mutex_);

  static constexpr size_t kPacketBytes = 64;
  static constexpr std::chrono::milliseconds kRetry{500}, kSendLimit{500};

 private:
  using Handle = std::shared_ptr<libusb_device_handle>;

  LibusbPort(RigClock& clock, UsbKind kind, std::string serial, UniqueFd claim);
  Status Start();
  void Run();
  void HandleEvents();
  // A new context, which sees what is plugged in now: without udev (a container, a small system)
  // one that is there hears of nothing that comes later.
  Status Renew() EXCLUDES(mutex_);
  // Looks for the device, and begins to read it.
  Status Connect() EXCLUDES(mutex_);
  StatusOr<Handle> Find();
  // The serial number of an open device; empty: it has none.
  static std::string SerialOf(libusb_device_handle* handle);
  Status CheckEndpoints(libusb_device_handle* handle) const;
  Status BeginReading(const Handle& handle);
  void Lose(std::string why) EXCLUDES(mutex_);
  void OnTransfer();  // of the event thread
  Status Named(std::string_view what, int error) const;

  RigClock& clock_;
  const UsbKind kind_;
  const std::string serial_, name_;
  const UniqueFd claim_;
  libusb_context* context_ = nullptr;
  std::function<void(RigTime, std::string)> handler_;  // guarded by the clock's lock
  mutable Mutex mutex_;
  Handle handle_ GUARDED_BY(mutex_);     // null: it is not there
  std::string lost_ GUARDED_BY(mutex_);  // why
  UsbPortFigures figures_ GUARDED_BY(mutex_);
  std::atomic<bool> ending_{false};
  std::weak_ptr<libusb_device_handle> last_;  // of context_
  // Of the event thread.
  libusb_transfer* transfer_ = nullptr;
  std::array<unsigned char, kPacketBytes> packet_{};
  bool reading_ = false;
  std::string broken_;  // why reading ended
  bool stalled_ = false;
  bool changed_ = true;  // something of its kind came
  std::thread events_;
};

}  // namespace mesorig::daemon
