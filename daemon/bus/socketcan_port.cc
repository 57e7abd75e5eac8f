#include "daemon/bus/socketcan_port.h"

#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>

#include "daemon/bus/device_claim.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kBetweenTries{1};

// Of the interface, through any socket. Null: there is none of that name.
std::optional<ifreq> Ask(const std::string& interface, unsigned long what) {
  const UniqueFd fd(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW));
  ifreq request{};
  interface.copy(request.ifr_name, IFNAMSIZ - 1);
  if (fd.get() < 0 || ::ioctl(fd.get(), what, &request) != 0) return std::nullopt;
  return request;
}

void Set(int fd, int level, int name, const void* value, socklen_t size) {
  (void)::setsockopt(fd, level, name, value, size);
}

}  // namespace

std::string_view Text(CanTrouble trouble) {
  switch (trouble) {
    case CanTrouble::kNone:
      return "takes part";
    case CanTrouble::kNoise:
      return "disturbed";
    case CanTrouble::kWarning:
      return "many errors";
    case CanTrouble::kPassive:
      return "error-passive: nobody acknowledges";
    case CanTrouble::kOverflow:
      return "frames were lost in the controller";
    case CanTrouble::kBusOff:
      return "bus-off";
  }
  return "unknown";
}

CanTrouble TroubleOf(const can_frame& frame) {
  const canid_t id = frame.can_id;
  const uint8_t controller = (id & CAN_ERR_CRTL) != 0 ? frame.data[1] : uint8_t{0};
  if ((id & CAN_ERR_BUSOFF) != 0) return CanTrouble::kBusOff;
  if ((controller & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0) {
    return CanTrouble::kOverflow;
  }
  if ((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0 ||
      (id & CAN_ERR_ACK) != 0) {
    return CanTrouble::kPassive;
  }
  if ((controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
    return CanTrouble::kWarning;
  }
  if ((id & CAN_ERR_RESTARTED) != 0 || (controller & CAN_ERR_CRTL_ACTIVE) != 0) {
    return CanTrouble::kNone;
  }
  return CanTrouble::kNoise;
}

StatusOr<CanFrame> FromKernel(const can_frame& frame) {
  if ((frame.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_ERR_FLAG)) != 0 ||
      frame.can_id > CAN_SFF_MASK || frame.can_dlc > CAN_MAX_DLEN) {
    return InvalidArgument("CAN: identifier 0x{:X} with {} bytes is no data frame of 11 bits",
                           frame.can_id, frame.can_dlc);
  }
  CanFrame out{static_cast<uint16_t>(frame.can_id), frame.can_dlc, {}};
  std::memcpy(out.data.data(), frame.data, frame.can_dlc);
  return out;
}

StatusOr<std::unique_ptr<SocketCanPort>> SocketCanPort::Open(RigClock& clock,
                                                             const std::string& interface) {
  if (interface.empty() || interface.size() >= IFNAMSIZ) {
    return InvalidArgument("CAN: \"{}\" is no name of an interface (1 to {} bytes)", interface,
                           IFNAMSIZ - 1);
  }
  const auto kind = Ask(interface, SIOCGIFHWADDR);
  if (!kind) {
    return NotFound("CAN {}: {}", interface,
                    ::if_nametoindex(interface.c_str()) == 0 ? "there is no such interface"
                                                             : std::strerror(errno));
  }
  if (kind->ifr_hwaddr.sa_family != ARPHRD_CAN) {
    return FailedPrecondition("{} is no CAN interface", interface);
  }
  MESORIG_ASSIGN_OR_RETURN(UniqueFd claim, ClaimDevice("CAN " + interface));
  std::unique_ptr<SocketCanPort> port(new SocketCanPort(clock, interface, std::move(claim)));
  if (const Status connected = port->Connect(); !connected.ok()) {
    port->Lose(std::string(Message(connected)));
  }
  port->reader_ = std::thread([port = port.get()] { port->Run(); });
  return port;
}

SocketCanPort::SocketCanPort(RigClock& clock, std::string interface, UniqueFd claim)
    : clock_(clock),
      interface_(std::move(interface)),
      claim_(std::move(claim)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

SocketCanPort::~SocketCanPort() {
  {
    MutexLock lock(mutex_);
    ending_ = true;
  }
  const uint64_t one = 1;
  (void)!::write(wake_.get(), &one, sizeof(one));
  if (reader_.joinable()) reader_.join();
}

bool SocketCanPort::IsUp() const {
  const auto flags = Ask(interface_, SIOCGIFFLAGS);
  return flags && (flags->ifr_flags & IFF_UP) != 0;
}

Status SocketCanPort::Connect() {
  auto fd = std::make_shared<UniqueFd>(
      ::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
  const unsigned index = ::if_nametoindex(interface_.c_str());
  if (fd->get() < 0 || index == 0) return Unavailable("CAN {}: the interface is gone", interface_);
  if (!IsUp()) return Unavailable("CAN {}: the interface is down", interface_);
  // Data frames with 11-bit identifiers, and every error; what we send others may see.
  const can_filter data{0, CAN_EFF_FLAG | CAN_RTR_FLAG};
  const can_err_mask_t errors = CAN_ERR_MASK;
  const int count_lost = 1;
  Set(fd->get(), SOL_CAN_RAW, CAN_RAW_FILTER, &data, sizeof(data));
  Set(fd->get(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof(errors));
  Set(fd->get(), SOL_SOCKET, SO_RXQ_OVFL, &count_lost, sizeof(count_lost));
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  if (::bind(fd->get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Unavailable("CAN {}: {}", interface_, std::strerror(errno));
  }
  MutexLock lock(mutex_);
  figures_.trouble = CanTrouble::kNone;
  socket_ = std::move(fd);
  lost_.clear();
  return OkStatus();
}

void SocketCanPort::Lose(std::string why) {
  MutexLock lock(mutex_);
  if (lost_ != why) Log("bus").error("{}", why);
  socket_.reset();
  lost_ = std::move(why);
}

Status SocketCanPort::Health() const {
  MutexLock lock(mutex_);
  if (socket_ == nullptr) return Unavailable("{}", lost_);
  if (figures_.trouble == CanTrouble::kBusOff) {
    return Unavailable("CAN {}: the controller is bus-off", interface_);
  }
  return OkStatus();
}

CanPortFigures SocketCanPort::figures() const {
  MutexLock lock(mutex_);
  return figures_;
}

void SocketCanPort::OnFrame(std::function<void(RigTime, const CanFrame&)> handler) {
  clock_.Change([&] { handler_ = std::move(handler); });
}

Status SocketCanPort::Send(const CanFrame& frame) {
  if (frame.id > CAN_SFF_MASK || frame.size > CAN_MAX_DLEN) {
    return InvalidArgument("CAN {}: identifier 0x{:X} with {} bytes", interface_, frame.id, frame.size);
  }
  MESORIG_RETURN_IF_ERROR(Health());
  std::shared_ptr<UniqueFd> fd;
  {
    MutexLock lock(mutex_);
    fd = socket_;
  }
  if (fd == nullptr) return Health();
  can_frame out{};
  out.can_id = frame.id;
  out.can_dlc = frame.size;
  std::memcpy(out.data, frame.data.data(), frame.size);
  const auto deadline = HostClock::now() + kSendLimit;
  while (::write(fd->get(), &out, sizeof(out)) != sizeof(out)) {
    const int error = errno;
    // (A full queue of the interface cannot be polled for.)
    const bool full = error == ENOBUFS || error == EAGAIN || error == EINTR;
    if (!full) {
      return Unavailable("CAN {}: sending: {}", interface_, std::strerror(error));
    }
    if (HostClock::now() > deadline) {
      return Unavailable("CAN {}: takes nothing for {} ms: nobody acknowledges", interface_,
                         kSendLimit.count());
    }
    std::this_thread::sleep_for(kBetweenTries);
  }
  MutexLock lock(mutex_);
  ++figures_.sent;
  return OkStatus();
}

bool SocketCanPort::Receive(int fd) {
  can_frame frame{};
  iovec into{&frame, sizeof(frame)};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(uint32_t))];
  msghdr message{};
  message.msg_iov = &into;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  const ssize_t got = ::recvmsg(fd, &message, MSG_DONTWAIT);
  if (got < 0) {
    if (errno == EAGAIN || errno == EINTR) return false;
    Lose(errno == ENETDOWN ? fmt::format("CAN {}: the interface is down", interface_)
                           : fmt::format("CAN {}: {}", interface_, std::strerror(errno)));
    return false;
  }
  std::optional<CanFrame> data;
  {
    MutexLock lock(mutex_);
    for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
      uint32_t lost = 0;
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
      std::memcpy(&lost, CMSG_DATA(c), sizeof(lost));
      figures_.lost = lost;
    }
    if (got == sizeof(frame) && (frame.can_id & CAN_ERR_FLAG) != 0) {
      const CanTrouble trouble = TroubleOf(frame);
      ++figures_.error_frames;
      figures_.bus_off += trouble == CanTrouble::kBusOff;
      if (trouble != figures_.trouble) {
        Log("bus").warn("CAN {}: {}", interface_, Text(trouble));
      }
      // Noise changes nothing of what the controller is.
      if (trouble != CanTrouble::kNoise) figures_.trouble = trouble;
      return true;
    }
    auto read = got == sizeof(frame) ? FromKernel(frame) : InvalidArgument("{} bytes", got);
    ++(read.ok() ? figures_.received : figures_.foreign);
    if (read.ok()) data = *read;
  }
  if (data) {
    const RigTime now = clock_.Now();
    clock_.Change([&] {
      if (handler_) handler_(now, *data);
    });
  }
  return true;
}

void SocketCanPort::Run() {
  for (;;) {
    std::shared_ptr<UniqueFd> fd;
    {
      MutexLock lock(mutex_);
      if (ending_) return;
      fd = socket_;
    }
    pollfd polls[2] = {{wake_.get(), POLLIN, 0}, {fd ? fd->get() : -1, POLLIN, 0}};
    ::poll(polls, 2, static_cast<int>(kRetry.count()));
    if (fd != nullptr) {
      while (Receive(fd->get())) {
      }
      // (An adapter that is unplugged says nothing.)
      if (!IsUp()) Lose(fmt::format("CAN {}: the interface is down or gone", interface_));
      continue;
    }
    if (Connect().ok()) {
      MutexLock lock(mutex_);
      ++figures_.reconnects;
      Log("bus").info("CAN {}: back", interface_);
    }
  }
}

}  // namespace mesorig::daemon
