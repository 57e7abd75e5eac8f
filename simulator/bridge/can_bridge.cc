#include "simulator/bridge/can_bridge.h"

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>

#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"

namespace mesorig::simulator {
namespace {

constexpr int kLook_ms = 100;

}  // namespace

StatusOr<std::unique_ptr<CanBridge>> CanBridge::Open(sim_wire::SimLink& link,
                                                     const std::string& interface) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t device, link.FindDevice(sim_wire::kCanDevice));
  const unsigned index = ::if_nametoindex(interface.c_str());
  if (index == 0) return NotFound("CAN {}: there is no such interface", interface);
  UniqueFd socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
  const can_filter data{0, CAN_EFF_FLAG | CAN_RTR_FLAG};
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  if (socket.get() < 0 ||
      ::setsockopt(socket.get(), SOL_CAN_RAW, CAN_RAW_FILTER, &data, sizeof(data)) != 0 ||
      ::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    return Unavailable("CAN {}: {}", interface, std::strerror(errno));
  }
  return std::unique_ptr<CanBridge>(new CanBridge(link, device, std::move(socket)));
}

CanBridge::CanBridge(sim_wire::SimLink& link, uint16_t device, UniqueFd socket)
    : link_(link), device_(device), socket_(std::move(socket)) {
  link_.Subscribe(device_, [this](RigTime, const std::string& payload) {
    const auto frame = sim_wire::UnpackCanFrame(payload);
    if (!frame.ok()) return;
    can_frame out{};
    out.can_id = frame->id;
    out.can_dlc = frame->size;
    std::memcpy(out.data, frame->data.data(), frame->size);
    // (What an interface that is down does not take is lost, as on a cable.)
    (void)!::write(socket_.get(), &out, sizeof(out));
  });
  reader_ = std::thread([this] { Read(); });
}

CanBridge::~CanBridge() {
  ending_ = true;
  reader_.join();
  link_.Subscribe(device_, [](RigTime, const std::string&) {});
}

void CanBridge::Read() {
  while (!ending_) {
    pollfd ready{socket_.get(), POLLIN, 0};
    if (::poll(&ready, 1, kLook_ms) <= 0) continue;
    can_frame in{};
    const ssize_t got = ::read(socket_.get(), &in, sizeof(in));
    if (got < 0) {  // down: it may come up again
      std::this_thread::sleep_for(std::chrono::milliseconds(kLook_ms));
      continue;
    }
    if (got != sizeof(in) || in.can_id > CAN_SFF_MASK || in.can_dlc > CAN_MAX_DLEN) continue;
    sim_wire::CanFrame frame{static_cast<uint16_t>(in.can_id), in.can_dlc, {}};
    std::memcpy(frame.data.data(), in.data, in.can_dlc);
    const Status posted = link_.Post(device_, sim_wire::Pack(frame));
    if (!posted.ok()) Log("link").warn("CAN: {}", Message(posted));
  }
}

}  // namespace mesorig::simulator
