#include "protocol/sim_wire/sim_server.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "protocol/base/bytes.h"
#include "protocol/base/log.h"

namespace mesorig::sim_wire {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr int kSendTimeoutMs = 5000;
constexpr std::chrono::seconds kCatchUp{1};  // at a stretch, of devices slower than the wall clock

pid_t PeerProcess(int fd) {
  ucred peer{};
  socklen_t size = sizeof(peer);
  return ::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 ? peer.pid : 0;
}

}  // namespace

struct SimServer::Client {
  Fd fd;
  MessageReader reader;
  Role role = Role::kInjector;
  bool greeted = false;
  bool gone = false;
  HostClock::time_point last_heard = HostClock::now();
  std::string holder;  // what the last sign of life said
};

Status SimDevice::Inject(RigTime, std::string_view text, Outbox&) {
  return InvalidArgument("{} does not know the fault \"{}\"", name(), text);
}

void SimDevice::Plug(RigTime, bool, Outbox&) {}

SimServer::SimServer(Fd listener, std::vector<SimDevice*> devices, SimServerOptions options)
    : listener_(std::move(listener)), devices_(std::move(devices)), options_(std::move(options)) {
  int fds[2];
  if (::pipe(fds) == 0) {
    wake_read_ = Fd(fds[0]);
    wake_write_ = Fd(fds[1]);
  }
}

SimServer::~SimServer() = default;

void SimServer::Stop() {
  stop_ = true;
  const char byte = 0;
  [[maybe_unused]] const ssize_t n = ::write(wake_write_.get(), &byte, 1);
}

void SimServer::RunExclusive(const std::function<void(RigTime now)>& f) {
  MutexLock lock(mutex_);
  if (running_on_) RunOn();
  f(now_);
}

Status SimServer::InjectNow(std::string_view text) {
  MutexLock lock(mutex_);
  const Status status = Inject(text);
  FlushToRig();
  return status;
}

Status SimServer::Run() {
  while (!stop_) {
    std::vector<pollfd> fds = {{listener_.get(), POLLIN, 0}, {wake_read_.get(), POLLIN, 0}};
    for (const auto& client : clients_) fds.push_back({client->fd.get(), POLLIN, 0});
    int timeout_ms = 0;
    {
      MutexLock lock(mutex_);
      timeout_ms = PollTimeoutMs();
    }
    if (::poll(fds.data(), fds.size(), timeout_ms) < 0 && errno != EINTR) {
      return Internal("poll: {}", strerror(errno));
    }
    {
      MutexLock lock(mutex_);
      for (size_t i = 2; i < fds.size(); ++i) {
        if (fds[i].revents != 0) Receive(*clients_[i - 2]);
      }
      RunOn();
      std::erase_if(clients_, [](const auto& client) { return client->gone; });
    }
    if (fds[0].revents != 0) Accept();
  }
  return OkStatus();
}

void SimServer::Accept() {
  Fd fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
  if (!fd.valid()) return;
  clients_.push_back(std::make_unique<Client>());
  clients_.back()->fd = std::move(fd);
}

void SimServer::Receive(Client& client) {
  char buffer[1 << 16];
  const auto size = ReceiveSome(client.fd.get(), buffer, sizeof(buffer));
  if (!size.ok() || *size == 0) return Drop(client, "closed");
  if (const Status status = client.reader.Feed({buffer, *size}); !status.ok()) {
    return Drop(client, Message(status));
  }
  while (!client.gone) {
    auto message = client.reader.Next();
    if (!message) break;
    Serve(client, std::move(*message));
  }
  // What this process spent computing is not the client's silence: its signs of life wait unread.
  client.last_heard = HostClock::now();
}

void SimServer::Drop(Client& client, std::string_view why) {
  if (client.gone) return;
  client.gone = true;
  if (client.greeted && client.role == Role::kRig) {
    Log("link").info("the rig's daemon is gone ({}); time runs on by itself", why);
  }
}

void SimServer::Serve(Client& client, Envelope message) {
  if (!client.greeted && message.type != MessageType::kHello) {
    return Drop(client, "did not say hello");
  }
  const bool to_device =
      message.type == MessageType::kCommand || message.type == MessageType::kQuery;
  if (to_device && (client.role == Role::kInjector || message.device >= devices_.size())) {
    return Drop(client, fmt::format("addressed device {} of {}", message.device, devices_.size()));
  }
  if (to_device && client.role == Role::kRealTime) RunOn();  // to the present
  Outbox out;
  switch (message.type) {
    case MessageType::kHello:
      if (const Status status = Welcomed(client, message.payload); !status.ok()) {
        Reply(client, 0, status);
      }
      return;
    case MessageType::kCommand:
      devices_[message.device]->Command(now_, message.payload, out);
      Collect(message.device, out);
      if (client.role == Role::kRealTime) FlushToRig();
      return;
    case MessageType::kQuery: {
      const auto answer = devices_[message.device]->Query(now_, message.payload, out);
      Collect(message.device, out);
      if (client.role == Role::kRealTime) FlushToRig();
      return Reply(client, message.id, answer);
    }
    case MessageType::kAdvance:
      return Advance(client, message.time);
    case MessageType::kAlive:
      client.holder = message.payload;
      return;
    case MessageType::kInject: {
      const Status status = Inject(message.payload);
      FlushToRig();
      return Reply(client, message.id, status.ok() ? StatusOr<std::string>("") : status);
    }
    default:
      return Drop(client, "sent a message that only simulators send");
  }
}

const SimServer::Client* SimServer::FindRole(Role role) const {
  for (const auto& client : clients_) {
    if (client->greeted && !client->gone && client->role == role) return client.get();
  }
  return nullptr;
}

Status SimServer::MayJoin(Role role) const {
  if (role == Role::kInjector) return OkStatus();
  if (const Client* const rig = FindRole(Role::kRig)) {
    return FailedPrecondition("another daemon drives this simulator (process {})",
                              PeerProcess(rig->fd.get()));
  }
  const Client* const live = role == Role::kRig ? FindRole(Role::kRealTime) : nullptr;
  if (live == nullptr) return OkStatus();
  return FailedPrecondition("this simulator's time passes by the wall clock, for process {}",
                            PeerProcess(live->fd.get()));
}

Status SimServer::Welcomed(Client& client, std::string_view hello) {
  ByteReader in(hello);
  const auto version = in.Get<uint16_t>();
  const auto role = in.Get<uint8_t>();
  if (!in.done() || version != kProtocolVersion || role > static_cast<uint8_t>(kLastRole)) {
    return InvalidArgument("the simulator speaks protocol version {}, not {}", kProtocolVersion,
                           version);
  }
  if (client.greeted) return FailedPrecondition("hello was said before");
  MESORIG_RETURN_IF_ERROR(MayJoin(static_cast<Role>(role)));
  client.role = static_cast<Role>(role);
  client.greeted = true;
  if (client.role != Role::kInjector) had_rig_ = true;
  if (client.role == Role::kRig) {
    deterministic_ = true;
    outputs_.clear();
  }
  if (client.role == Role::kRealTime) RunOn();
  Welcome welcome = options_.welcome;
  welcome.now = now_;
  for (const SimDevice* device : devices_) welcome.devices.push_back(device->name());
  std::string bytes;
  AppendMessage({MessageType::kWelcome, 0, 0, now_, Pack(welcome)}, bytes);
  if (!SendAll(client.fd.get(), bytes, kSendTimeoutMs).ok()) Drop(client, "does not read");
  return OkStatus();
}

Status SimServer::Inject(std::string_view text) {
  const size_t space = std::min(text.find(' '), text.size());
  const std::string_view name = text.substr(0, space);
  const std::string_view rest = text.substr(std::min(space + 1, text.size()));
  constexpr std::string_view kLeap = "leap ";
  Status status = InvalidArgument("no device for \"{}\": say DEVICE FAULT", text);
  const RigTime now = now_;
  if (name == "rig") {
    status = rest.starts_with(kLeap)
                 ? Leap(rest.substr(kLeap.size()))
                 : InvalidArgument("rig: \"{}\" is not: leap SECONDS", rest);
  }
  for (size_t i = 0; i < devices_.size() && !rest.empty(); ++i) {
    if (devices_[i]->name() != name) continue;
    Outbox out;
    status = devices_[i]->Inject(now_, rest, out);
    Collect(i, out);
    break;
  }
  if (options_.on_injection) options_.on_injection(now, text, status);
  return status;
}

// Devices live through the time; the daemon hears of it afterwards, as one that slept.
Status SimServer::Leap(std::string_view seconds) {
  constexpr double kLongest_s = 86400;
  double span_s = 0;
  const auto [end, error] = std::from_chars(seconds.data(), seconds.data() + seconds.size(), span_s);
  if (error != std::errc() || end != seconds.data() + seconds.size() ||
      !(span_s > 0 && span_s <= kLongest_s)) {
    return InvalidArgument("rig: leap \"{}\" is not a number of seconds above 0, to {}", seconds,
                           kLongest_s);
  }
  const RigTime target = now_ + FromSeconds(span_s);
  while (RunNextInstant(target)) continue;
  now_ = std::max(now_, target);
  return OkStatus();
}

void SimServer::Reply(Client& client, uint32_t id, const StatusOr<std::string>& answer) {
  ByteWriter payload;
  payload.Put(static_cast<uint8_t>(answer.ok()                             ? Answer::kOk
                                   : absl::IsUnavailable(answer.status()) ? Answer::kNobody
                                                                          : Answer::kRefused));
  payload.PutRaw(answer.ok() ? std::string_view(*answer) : Message(answer.status()));
  std::string bytes;
  AppendMessage({MessageType::kReply, 0, id, now_, payload.Take()}, bytes);
  if (!SendAll(client.fd.get(), bytes, kSendTimeoutMs).ok()) Drop(client, "does not read");
}

void SimServer::Collect(size_t device, Outbox& out) {
  for (std::string& payload : out.Take()) {
    outputs_.push_back(
        {MessageType::kOutput, static_cast<uint16_t>(device), 0, now_, std::move(payload)});
  }
}

void SimServer::FlushOutputs(std::string& bytes) {
  for (const Envelope& output : outputs_) AppendMessage(output, bytes);
  outputs_.clear();
}

void SimServer::FlushToRig() {
  if (FindRole(Role::kRig) == nullptr && FindRole(Role::kRealTime) == nullptr) return;
  std::string bytes;
  FlushOutputs(bytes);
  if (bytes.empty()) return;
  for (const auto& client : clients_) {
    if (!client->greeted || client->role == Role::kInjector || client->gone) continue;
    if (!SendAll(client->fd.get(), bytes, kSendTimeoutMs).ok()) Drop(*client, "does not read");
  }
}

bool SimServer::RunNextInstant(RigTime limit) {
  RigTime next = kNever;
  for (const SimDevice* device : devices_) next = std::min(next, device->NextEvent());
  const auto& script = options_.script;
  if (script_done_ < script.size()) next = std::min(next, script[script_done_].at);
  if (next == kNever || next > limit) return false;
  now_ = std::max(now_, next);
  for (size_t i = 0; i < devices_.size(); ++i) {
    // A device may have several events at one instant.
    while (devices_[i]->NextEvent() <= now_) {
      Outbox out;
      devices_[i]->RunEvent(now_, out);
      Collect(i, out);
    }
  }
  while (script_done_ < script.size() && script[script_done_].at <= now_) {
    const Status status = Inject(script[script_done_++].text);
    if (!status.ok()) Log("link").warn("script of faults: {}", Message(status));
  }
  return true;
}

void SimServer::Advance(Client& client, RigTime target) {
  if (client.role != Role::kRig) return Drop(client, "does not move time, and tried");
  uint8_t flags = 0;
  // Outputs of commands of this very instant return it without moving time.
  while (outputs_.empty()) {
    if (RunNextInstant(target)) continue;
    if (target == kNever) {
      flags |= kDeadEnd;
    } else {
      now_ = std::max(now_, target);
    }
    break;
  }
  if (deterministic_) flags |= kDeterministic;
  std::string bytes;
  FlushOutputs(bytes);
  AppendMessage({MessageType::kAdvanced, 0, 0, now_, std::string(1, static_cast<char>(flags))},
                bytes);
  if (!SendAll(client.fd.get(), bytes, kSendTimeoutMs).ok()) Drop(client, "does not read");
}

int SimServer::PollTimeoutMs() const {
  if (running_on_) return 5;
  return had_rig_ || !options_.pause_without_client ? 100 : 1000;
}

void SimServer::RunOn() {
  const auto host_now = HostClock::now();
  const Client* const rig = FindRole(Role::kRig);
  const bool live = FindRole(Role::kRealTime) != nullptr;
  const bool silent = rig != nullptr && host_now - rig->last_heard > options_.silence_limit;
  const bool alone =
      rig == nullptr && !live && (had_rig_ || !options_.pause_without_client);
  if (!silent && !alone && !live) {
    running_on_ = false;
    return;
  }
  if (!running_on_) {
    running_on_ = true;
    run_on_host_ = host_now;
    run_on_now_ = now_;
    if (silent) {
      deterministic_ = false;
      Log("link").warn("no sign of life for {} ms (last word: {}); time runs on by itself",
                       options_.silence_limit.count(), rig->holder.empty() ? "none" : rig->holder);
    }
  }
  // (Devices may take their time: the present is where the wall clock is after that.)
  while (HostClock::now() - host_now < kCatchUp) {
    const RigTime target = run_on_now_ + (HostClock::now() - run_on_host_);
    const bool ran = RunNextInstant(target);
    if (live) FlushToRig();
    outputs_.clear();  // nobody else listens
    if (ran) continue;
    now_ = std::max(now_, target);
    return;
  }
}

}  // namespace mesorig::sim_wire
