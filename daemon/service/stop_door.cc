#include "daemon/service/stop_door.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "protocol/base/log.h"
#include "protocol/wire/stop_line.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kLook{250};  // for guests that say nothing

// Whoever does not take it loses it.
void Answer(int fd, std::string_view text) {
  (void)::send(fd, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  ::close(fd);
}

void Wake(int fd) {
  const uint64_t one = 1;
  (void)!::write(fd, &one, sizeof(one));
}

}  // namespace

StatusOr<std::unique_ptr<StopDoor>> StopDoor::Open(const std::filesystem::path& socket,
                                                   StopDoorOptions options, Stop stop) {
  std::vector<gid_t> groups;
  for (const std::string& name : options.groups) {
    MESORIG_ASSIGN_OR_RETURN(const gid_t group, wire::GroupNamed(name));
    groups.push_back(group);
  }
  std::unique_ptr<StopDoor> door(new StopDoor(socket, std::move(options), std::move(stop)));
  door->groups_ = std::move(groups);
  // Several groups cannot own one file: everybody may knock, the kernel tells who it is.
  const mode_t mode = door->groups_.empty() ? 0600 : 0666;
  MESORIG_RETURN_IF_ERROR(door->listeners_.AddUnix(
      socket, mode, std::nullopt,
      [door = door.get()](auto&& connection) { door->Take(std::move(connection)); }));
  door->reader_ = std::thread([door = door.get()] { door->Read(); });
  door->stopper_ = std::thread([door = door.get()] { door->CarryOut(); });
  door->listeners_.Start();
  return door;
}

StopDoor::StopDoor(std::filesystem::path socket, StopDoorOptions options, Stop stop)
    : socket_(std::move(socket)),
      options_(std::move(options)),
      stop_(std::move(stop)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

StopDoor::~StopDoor() {
  listeners_.Stop();
  std::error_code ignored;
  std::filesystem::remove(socket_, ignored);
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    changed_.notify_all();
  }
  Wake(wake_);
  if (reader_.joinable()) reader_.join();
  if (stopper_.joinable()) stopper_.join();
  for (const Guest& guest : arrivals_) ::close(guest.fd);
  for (const Waiting& waiting : waiting_) ::close(waiting.fd);
  ::close(wake_);
}

bool StopDoor::Welcome(const wire::LocalPeer& peer) const {
  if (peer.uid == ::geteuid() || peer.uid == 0) return true;
  return std::any_of(groups_.begin(), groups_.end(), [&](gid_t group) {
    return peer.gid == group ||
           std::find(peer.groups.begin(), peer.groups.end(), group) != peer.groups.end();
  });
}

void StopDoor::Take(wire::Connection&& connection) {
  if (!connection.local || !Welcome(*connection.local)) {
    Log("access").warn("{}: stop refused: of no role's group", connection.from);
    return Answer(connection.fd, "error you are of no group that may stop\n");
  }
  {
    const std::lock_guard lock(mutex_);
    arrivals_.push_back(
        {connection.fd, wire::UserName(connection.local->uid), "", HostClock::now()});
  }
  Wake(wake_);
}

void StopDoor::Read() {
  std::vector<Guest> guests;  // oldest first
  std::vector<pollfd> polls;
  for (;;) {
    polls.assign(1, {wake_, POLLIN, 0});
    for (const Guest& guest : guests) polls.push_back({guest.fd, POLLIN, 0});
    ::poll(polls.data(), polls.size(), static_cast<int>(kLook.count()));
    const auto now = HostClock::now();
    size_t i = 0;
    std::erase_if(guests, [&](Guest& guest) {
      if (polls[++i].revents != 0) return !Hear(guest);
      if (now - guest.since < options_.patience) return false;
      Answer(guest.fd, "error nothing was said\n");
      return true;
    });
    uint64_t woken = 0;
    (void)!::read(wake_, &woken, sizeof(woken));
    const std::lock_guard lock(mutex_);
    if (ending_) break;
    for (Guest& guest : arrivals_) {
      if (guests.size() == options_.connections) {
        Answer(guests.front().fd, "error others came\n");
        guests.erase(guests.begin());
      }
      guests.push_back(std::move(guest));
    }
    arrivals_.clear();
  }
  for (const Guest& guest : guests) ::close(guest.fd);
}

bool StopDoor::Hear(Guest& guest) {
  char buffer[wire::kMaxStopLine];
  const size_t room = wire::kMaxStopLine - guest.line.size();
  const ssize_t got = ::recv(guest.fd, buffer, room, MSG_DONTWAIT);
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return true;
  if (got <= 0) {
    ::close(guest.fd);
    return false;
  }
  guest.line.append(buffer, static_cast<size_t>(got));
  const size_t end = guest.line.find('\n');
  if (end == std::string::npos && guest.line.size() < wire::kMaxStopLine) return true;
  auto reason = wire::ReadStopLine(std::string_view(guest.line).substr(0, end));
  if (!reason.ok()) {
    Answer(guest.fd, fmt::format("error {}\n", Message(reason.status())));
    return false;
  }
  const std::lock_guard lock(mutex_);
  waiting_.push_back({guest.fd, {*std::move(reason), std::move(guest.who)}});
  changed_.notify_all();
  return false;
}

void StopDoor::CarryOut() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return ending_ || !waiting_.empty(); });
    if (waiting_.empty()) return;  // who asked before the end gets it
    const std::vector<Waiting> waiting = std::exchange(waiting_, {});
    lock.unlock();
    std::vector<Order> orders;
    for (const Waiting& one : waiting) orders.push_back(one.order);
    const Status off = stop_(orders);
    std::string text = off.ok() ? "ok" : fmt::format("error {}", Message(off));
    std::replace(text.begin(), text.end(), '\n', ' ');
    text += '\n';
    for (const Waiting& one : waiting) Answer(one.fd, text);
    lock.lock();
  }
}

}  // namespace mesorig::daemon
