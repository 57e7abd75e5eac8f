#include "daemon/bus/libusb_port.h"

#include <libusb-1.0/libusb.h>
#include <pthread.h>

#include <optional>

#include "daemon/bus/device_claim.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr int kLook_ms = 100;

}  // namespace

StatusOr<std::unique_ptr<LibusbPort>> LibusbPort::Open(RigClock& clock, UsbKind kind,
                                                       const std::string& serial) {
  if (serial.empty()) return InvalidArgument("USB: a serial number is needed");
  MESORIG_ASSIGN_OR_RETURN(
      UniqueFd claim,
      ClaimDevice(fmt::format("USB {:04x}:{:04x} {}", kind.vendor, kind.product, serial)));
  std::unique_ptr<LibusbPort> port(
      new LibusbPort(clock, std::move(kind), serial, std::move(claim)));
  MESORIG_RETURN_IF_ERROR(port->Start());
  return port;
}

LibusbPort::LibusbPort(RigClock& clock, UsbKind kind, std::string serial, UniqueFd claim)
    : clock_(clock),
      kind_(std::move(kind)),
      serial_(std::move(serial)),
      name_(fmt::format("USB {} {}", kind_.what, serial_)),
      claim_(std::move(claim)) {}

LibusbPort::~LibusbPort() {
  ending_ = true;
  if (events_.joinable()) events_.join();
  if (transfer_ != nullptr) libusb_free_transfer(transfer_);
  {
    MutexLock lock(mutex_);
    handle_.reset();
  }
  if (context_ != nullptr) libusb_exit(context_);
}

Status LibusbPort::Named(std::string_view what, int error) const {
  return Unavailable("{}: {}: {}", name_, what, libusb_strerror(error));
}

Status LibusbPort::Start() {
  transfer_ = libusb_alloc_transfer(0);
  if (transfer_ == nullptr) return Unavailable("{}: no memory for a transfer", name_);
  if (const Status connected = Connect(); !connected.ok()) {
    Lose(std::string(Message(connected)));
  }
  changed_ = false;
  events_ = std::thread([this] {
    ::pthread_setname_np(::pthread_self(), "usb");
    Run();
  });
  return OkStatus();
}

Status LibusbPort::Renew() {
  if (!last_.expired()) return Unavailable("{}: a packet is still on its way", name_);
  if (context_ != nullptr) libusb_exit(std::exchange(context_, nullptr));
  if (const int error = libusb_init(&context_); error != 0) {
    context_ = nullptr;
    return Named("libusb", error);
  }
  const auto came = [](libusb_context*, libusb_device*, libusb_hotplug_event, void* port) {
    static_cast<LibusbPort*>(port)->changed_ = true;
    return 0;
  };
  (void)libusb_hotplug_register_callback(context_, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED, 0,
                                         kind_.vendor, kind_.product, LIBUSB_HOTPLUG_MATCH_ANY,
                                         came, this, nullptr);
  return OkStatus();
}

void LibusbPort::Run() {
  auto next_try = HostClock::now() + kRetry;
  while (!ending_) {
    HandleEvents();
    if (reading_) continue;
    if (!broken_.empty()) Lose(std::exchange(broken_, {}));
    if (!changed_ && HostClock::now() < next_try) continue;
    changed_ = false;
    next_try = HostClock::now() + kRetry;
    if (const Status connected = Connect(); !connected.ok()) {
      Lose(std::string(Message(connected)));
      continue;
    }
    MutexLock lock(mutex_);
    ++figures_.reconnects;
    Log("bus").info("{}: there", name_);
  }
  if (reading_) (void)libusb_cancel_transfer(transfer_);
  while (reading_) HandleEvents();
}

void LibusbPort::HandleEvents() {
  if (context_ == nullptr) {
    std::this_thread::sleep_for(std::chrono::milliseconds(kLook_ms));
    return;
  }
  timeval look{0, kLook_ms * 1000};
  (void)libusb_handle_events_timeout_completed(context_, &look, nullptr);
}

std::string LibusbPort::SerialOf(libusb_device_handle* handle) {
  libusb_device_descriptor descriptor{};
  unsigned char text[256] = {};
  if (libusb_get_device_descriptor(libusb_get_device(handle), &descriptor) != 0 ||
      descriptor.iSerialNumber == 0) {
    return {};
  }
  const int size =
      libusb_get_string_descriptor_ascii(handle, descriptor.iSerialNumber, text, sizeof(text) - 1);
  return size <= 0 ? std::string()
                   : std::string(reinterpret_cast<char*>(text), static_cast<size_t>(size));
}

StatusOr<LibusbPort::Handle> LibusbPort::Find() {
  libusb_device** devices = nullptr;
  const ssize_t count = libusb_get_device_list(context_, &devices);
  if (count < 0) return Named("listing devices", static_cast<int>(count));
  Handle found;
  std::string others;
  for (ssize_t k = 0; k < count && found == nullptr; ++k) {
    libusb_device_descriptor descriptor{};
    if (libusb_get_device_descriptor(devices[k], &descriptor) != 0 ||
        descriptor.idVendor != kind_.vendor || descriptor.idProduct != kind_.product) {
      continue;
    }
    libusb_device_handle* opened = nullptr;
    const int error = libusb_open(devices[k], &opened);
    const Handle handle(error == 0 ? opened : nullptr, [](libusb_device_handle* open) {
      if (open != nullptr) libusb_close(open);
    });
    const std::string serial = error == 0 ? SerialOf(opened) : libusb_strerror(error);
    if (error == 0 && serial == serial_) {
      found = handle;
    } else {
      others += fmt::format("{}\"{}\"", others.empty() ? "" : ", ", serial);
    }
  }
  libusb_free_device_list(devices, 1);
  if (found != nullptr) return found;
  return Unavailable("{}: not there{}", name_,
                     others.empty() ? "" : fmt::format("; others of its kind: {}", others));
}

Status LibusbPort::CheckEndpoints(libusb_device_handle* handle) const {
  libusb_config_descriptor* configuration = nullptr;
  const int error = libusb_get_active_config_descriptor(libusb_get_device(handle), &configuration);
  if (error != 0) return Named("reading its configuration", error);
  int right = 0;
  if (configuration->bNumInterfaces > 0 && configuration->interface[0].num_altsetting > 0) {
    const libusb_interface_descriptor& first = configuration->interface[0].altsetting[0];
    for (int k = 0; k < first.bNumEndpoints; ++k) {
      const libusb_endpoint_descriptor& endpoint = first.endpoint[k];
      const bool bulk = (endpoint.bmAttributes & 3) == LIBUSB_TRANSFER_TYPE_BULK &&
                        endpoint.wMaxPacketSize <= kPacketBytes;
      right +=
          bulk && (endpoint.bEndpointAddress == kind_.out || endpoint.bEndpointAddress == kind_.in);
    }
  }
  libusb_free_config_descriptor(configuration);
  if (right == 2) return OkStatus();
  return Unavailable("{}: it has no bulk endpoints 0x{:02X} and 0x{:02X} of at most {} bytes",
                     name_, kind_.out, kind_.in, kPacketBytes);
}

Status LibusbPort::Connect() {
  MESORIG_RETURN_IF_ERROR(Renew());
  MESORIG_ASSIGN_OR_RETURN(const Handle handle, Find());
  int configuration = 0;
  int error = libusb_get_configuration(handle.get(), &configuration);
  if (error == 0 && configuration == 0) error = libusb_set_configuration(handle.get(), 1);
  if (error != 0) return Named("configuring it", error);
  MESORIG_RETURN_IF_ERROR(CheckEndpoints(handle.get()));
  (void)libusb_set_auto_detach_kernel_driver(handle.get(), 1);
  error = libusb_claim_interface(handle.get(), 0);
  if (error != 0) return Named("claiming it", error);
  if (std::exchange(stalled_, false)) (void)libusb_clear_halt(handle.get(), kind_.in);
  return BeginReading(handle);
}

Status LibusbPort::BeginReading(const Handle& handle) {
  const auto done = [](libusb_transfer* transfer) {
    static_cast<LibusbPort*>(transfer->user_data)->OnTransfer();
  };
  libusb_fill_bulk_transfer(transfer_, handle.get(), kind_.in, packet_.data(),
                            static_cast<int>(packet_.size()), done, this, 0);
  if (const int error = libusb_submit_transfer(transfer_); error != 0)
    return Named("reading", error);
  reading_ = true;
  MutexLock lock(mutex_);
  handle_ = handle;
  last_ = handle;
  lost_.clear();
  return OkStatus();
}

void LibusbPort::OnTransfer() {
  reading_ = false;
  switch (transfer_->status) {
    case LIBUSB_TRANSFER_COMPLETED: {
      std::string packet(reinterpret_cast<char*>(packet_.data()),
                         static_cast<size_t>(transfer_->actual_length));
      const int error = libusb_submit_transfer(transfer_);
      reading_ = error == 0;
      if (!reading_) broken_ = std::string(Message(Named("reading", error)));
      {
        MutexLock lock(mutex_);
        ++figures_.received;
      }
      const RigTime now = clock_.Now();
      clock_.Change([&] {
        if (handler_) handler_(now, std::move(packet));
      });
      return;
    }
    case LIBUSB_TRANSFER_NO_DEVICE:
      broken_ = fmt::format("{}: it was unplugged", name_);
      return;
    case LIBUSB_TRANSFER_CANCELLED:
      broken_ = fmt::format("{}: closed", name_);
      return;
    case LIBUSB_TRANSFER_STALL:
      stalled_ = true;
      broken_ = fmt::format("{}: its IN endpoint stalled", name_);
      return;
    case LIBUSB_TRANSFER_OVERFLOW:
      broken_ = fmt::format("{}: a packet of more than {} bytes", name_, kPacketBytes);
      return;
    default:
      broken_ = fmt::format("{}: reading failed", name_);
      return;
  }
}

void LibusbPort::Lose(std::string why) {
  Handle closing;  // without the lock
  MutexLock lock(mutex_);
  if (lost_ != why) Log("bus").error("{}", why);
  closing.swap(handle_);
  lost_ = std::move(why);
}

Status LibusbPort::Write(std::string_view packet) {
  if (packet.empty() || packet.size() > kPacketBytes) {
    return InvalidArgument("{}: a packet of {} bytes, 1 to {} are taken", name_, packet.size(),
                           kPacketBytes);
  }
  Handle handle;
  {
    MutexLock lock(mutex_);
    if (handle_ == nullptr) return Unavailable("{}", lost_);
    handle = handle_;
  }
  std::string out(packet);
  int sent = 0;
  const int error = libusb_bulk_transfer(
      handle.get(), kind_.out, reinterpret_cast<unsigned char*>(out.data()),
      static_cast<int>(out.size()), &sent, static_cast<unsigned>(kSendLimit.count()));
  if (error != 0) return Named("sending", error);
  if (sent != static_cast<int>(out.size())) {
    return Unavailable("{}: took {} of {} bytes", name_, sent, out.size());
  }
  MutexLock lock(mutex_);
  ++figures_.sent;
  return OkStatus();
}

void LibusbPort::OnPacket(std::function<void(RigTime, std::string packet)> handler) {
  clock_.Change([&] { handler_ = std::move(handler); });
}

Status LibusbPort::Health() const {
  MutexLock lock(mutex_);
  return handle_ == nullptr ? Unavailable("{}", lost_) : OkStatus();
}

UsbPortFigures LibusbPort::figures() const {
  MutexLock lock(mutex_);
  return figures_;
}

}  // namespace mesorig::daemon
