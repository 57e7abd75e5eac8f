#include "protocol/sim_wire/sim_link.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>

#include "protocol/base/bytes.h"
#include "protocol/base/log.h"

namespace mesorig::sim_wire {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr int kSendTimeoutMs = 10000;
constexpr int kHurry = 1000;
constexpr auto kPaceStep = std::chrono::milliseconds(5);

// Reads from a fresh connection until its first message.
StatusOr<Envelope> ReadFirst(int fd, MessageReader& reader, std::chrono::milliseconds limit) {
  const auto deadline = HostClock::now() + limit;
  char buffer[4096];
  for (;;) {
    if (auto message = reader.Next()) return *message;
    pollfd readable{fd, POLLIN, 0};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - HostClock::now());
    if (left.count() <= 0 || ::poll(&readable, 1, static_cast<int>(left.count())) == 0) {
      return DeadlineExceeded("the simulator says nothing within {} ms", limit.count());
    }
    MESORIG_ASSIGN_OR_RETURN(const size_t size, ReceiveSome(fd, buffer, sizeof(buffer)));
    if (size == 0) return Unavailable("the simulator closed the connection");
    MESORIG_RETURN_IF_ERROR(reader.Feed({buffer, size}));
  }
}

}  // namespace

StatusOr<std::unique_ptr<SimLink>> SimLink::Connect(std::string_view endpoint,
                                                    SimLinkOptions options) {
  constexpr std::string_view kPrefix = "unix:";
  if (!endpoint.starts_with(kPrefix)) {
    return InvalidArgument("simulator endpoint \"{}\" is not unix:PATH", endpoint);
  }
  MESORIG_ASSIGN_OR_RETURN(Fd fd, sim_wire::Connect(endpoint.substr(kPrefix.size())));
  std::string hello;
  const Role role = options.live == nullptr ? Role::kRig : Role::kRealTime;
  AppendMessage({MessageType::kHello, 0, 0, {},
                 ByteWriter().Put(kProtocolVersion).Put(static_cast<uint8_t>(role)).Take()},
                hello);
  MESORIG_RETURN_IF_ERROR(SendAll(fd.get(), hello, kSendTimeoutMs));
  MessageReader reader;
  MESORIG_ASSIGN_OR_RETURN(const Envelope first, ReadFirst(fd.get(), reader, options.query_timeout));
  if (first.type == MessageType::kReply && !first.payload.empty()) {
    return FailedPrecondition("{}", std::string_view(first.payload).substr(1));
  }
  MESORIG_ASSIGN_OR_RETURN(Welcome welcome, UnpackWelcome(first.payload));
  return std::unique_ptr<SimLink>(new SimLink(std::move(fd), std::move(welcome), options));
}

SimLink::SimLink(Fd fd, Welcome welcome, SimLinkOptions options)
    : fd_(std::move(fd)), welcome_(std::move(welcome)), options_(options), now_(welcome_.now) {
  reader_thread_ = std::thread([this] { ReadLoop(); });
  host_thread_ = std::thread([this] { HostLoop(); });
}

SimLink::~SimLink() {
  {
    std::lock_guard lock(mutex_);
    closing_ = true;
    host_wake_.notify_all();
  }
  ::shutdown(fd_.get(), SHUT_RDWR);
  reader_thread_.join();
  host_thread_.join();
}

StatusOr<uint16_t> SimLink::FindDevice(std::string_view name) const {
  const auto& devices = welcome_.devices;
  const auto found = std::find(devices.begin(), devices.end(), name);
  if (found == devices.end()) {
    return NotFound("the simulator has no device \"{}\": do daemon and simulator use the same rig?",
                    name);
  }
  return static_cast<uint16_t>(found - devices.begin());
}

void SimLink::Subscribe(uint16_t device, Handler handler) {
  std::lock_guard lock(mutex_);
  handlers_[device] = std::move(handler);
}

Status SimLink::health() const {
  std::lock_guard lock(mutex_);
  return broken_;
}

Status SimLink::Post(uint16_t device, std::string payload) {
  std::unique_lock lock(mutex_);
  if (!broken_.ok()) return broken_;
  posted_.push_back({device, std::move(payload)});
  if (options_.live != nullptr) {
    std::string bytes;
    TakePostedLocked(std::nullopt, bytes);
    Send(bytes);
  } else {
    OnChangeLocked(lock);
  }
  return OkStatus();
}

StatusOr<std::string> SimLink::Query(uint16_t device, std::string payload) {
  std::unique_lock lock(mutex_);
  if (!broken_.ok()) return broken_;
  const uint32_t id = next_query_++;
  std::string bytes;
  TakePostedLocked(device, bytes);
  AppendMessage({MessageType::kQuery, device, id, now_, std::move(payload)}, bytes);
  PendingQuery& query = queries_[id];
  Send(bytes);
  const bool answered = query_done_.wait_for(lock, options_.query_timeout,
                                             [&] { return query.done || !broken_.ok(); });
  StatusOr<std::string> answer = query.done ? std::move(query.answer)
                                 : answered ? StatusOr<std::string>(broken_)
                                            : DeadlineExceeded("{}: no answer to a query within {} ms",
                                                               welcome_.devices[device],
                                                               options_.query_timeout.count());
  queries_.erase(id);
  return answer;
}

RigTime SimLink::NowLocked() const {
  return broken_.ok() ? now_ : now_ + (HostClock::now() - broken_at_) * pace_;
}

void SimLink::Hurry() {
  std::lock_guard lock(mutex_);
  if (!broken_.ok()) {
    now_ = NowLocked();
    broken_at_ = HostClock::now();
  }
  pace_ = kHurry;
  for (Entry* entry : WaitingLocked()) entry->wake.notify_all();
}

void SimLink::TakePostedLocked(std::optional<uint16_t> device, std::string& bytes) {
  // Device order, then order of posting: threads of one instant may post in any order.
  std::stable_sort(posted_.begin(), posted_.end(),
                   [](const Posted& a, const Posted& b) { return a.device < b.device; });
  std::erase_if(posted_, [&](Posted& posted) {
    if (device && posted.device != *device) return false;
    AppendMessage({MessageType::kCommand, posted.device, 0, now_, std::move(posted.payload)}, bytes);
    return true;
  });
}

void SimLink::OnChangeLocked(std::unique_lock<std::mutex>&) {
  if (options_.live != nullptr || !broken_.ok() || advancing_ || !QuiescentLocked()) return;
  if (dead_end_ && posted_.empty() && EarliestDeadlineLocked() == kNever) return;
  if (PaceLocked() == Pace::kRealTime) {
    pace_due_ = true;
    host_wake_.notify_all();
    return;
  }
  SendAdvanceLocked();
}

void SimLink::SendAdvanceLocked() {
  RigTime target = EarliestDeadlineLocked();
  if (PaceLocked() == Pace::kRealTime) {
    const auto host_now = HostClock::now();
    const auto passed = std::min<std::chrono::nanoseconds>(host_now - pace_host_, kPaceStep * 4);
    pace_host_ = host_now;
    target = std::min(target, now_ + passed);
  }
  std::string bytes;
  TakePostedLocked(std::nullopt, bytes);
  AppendMessage({MessageType::kAdvance, 0, 0, target, {}}, bytes);
  advancing_ = true;
  Send(bytes);
}

void SimLink::BlockLocked(std::unique_lock<std::mutex>& lock, Entry& entry) {
  while (entry.waiting) {
    if (broken_.ok() || entry.deadline == kNever) {
      entry.wake.wait(lock);
      continue;
    }
    // The simulator is gone: the system's pace.
    const auto left = std::max(entry.deadline - NowLocked(), RigTime(0)) / pace_;
    entry.wake.wait_for(lock, std::min<std::chrono::nanoseconds>(left, std::chrono::seconds(1)));
    if (NowLocked() >= entry.deadline) entry.waiting = false;
  }
}

void SimLink::ReadLoop() {
  std::string buffer(1 << 20, '\0');
  for (;;) {
    const auto size = ReceiveSome(fd_.get(), buffer.data(), buffer.size());
    if (!size.ok() || *size == 0) return Break(Unavailable("the simulator is gone"));
    if (const Status status = reader_.Feed({buffer.data(), *size}); !status.ok()) {
      return Break(Annotate(status, "the simulator sent garbage"));
    }
    while (auto message = reader_.Next()) Handle(std::move(*message));
  }
}

void SimLink::Handle(Envelope message) {
  std::unique_lock lock(mutex_);
  switch (message.type) {
    case MessageType::kOutput: {
      // Time stands still until kAdvanced, so its readers wake at the right instant.
      now_ = std::max(now_, message.time);
      const auto handler = handlers_.find(message.device);
      if (options_.live != nullptr) {
        if (handler == handlers_.end()) return;
        const RigTime now = options_.live->Now();
        options_.live->Change([&] { handler->second(now, std::move(message.payload)); });
        return;
      }
      if (handler != handlers_.end()) handler->second(message.time, std::move(message.payload));
      if (!advancing_) {  // somebody's hand at the rig, outside any advance
        WakeReadyLocked();
        OnChangeLocked(lock);
      }
      return;
    }
    case MessageType::kReply: {
      const auto query = queries_.find(message.id);
      if (query == queries_.end() || message.payload.empty()) return;  // timed out meanwhile
      const std::string_view text = std::string_view(message.payload).substr(1);
      query->second.done = true;
      const auto how = static_cast<Answer>(message.payload[0]);
      query->second.answer = how == Answer::kOk        ? StatusOr<std::string>(std::string(text))
                             : how == Answer::kRefused ? FailedPrecondition("{}", text)
                                                       : Unavailable("{}", text);
      query_done_.notify_all();
      return;
    }
    case MessageType::kAdvanced: {
      now_ = std::max(now_, message.time);
      advancing_ = false;
      const uint8_t flags = message.payload.empty() ? 0 : static_cast<uint8_t>(message.payload[0]);
      if ((flags & kDeterministic) == 0) deterministic_ = false;
      dead_end_ = (flags & kDeadEnd) != 0;
      WakeReadyLocked();
      OnChangeLocked(lock);
      return;
    }
    default:
      return;
  }
}

void SimLink::HostLoop() {
  std::unique_lock lock(mutex_);
  auto next_alive = HostClock::now();
  while (!closing_) {
    if (!broken_.ok()) {
      host_wake_.wait(lock);
      continue;
    }
    if (HostClock::now() >= next_alive) {
      next_alive = HostClock::now() + options_.alive_period;
      const bool active = ActiveLocked();
      lock.unlock();
      std::string holders;
      for (const Runner& runner : Runners()) {
        if (!active || runner.running < options_.watchdog) continue;
        const double seconds = std::chrono::duration<double>(runner.running).count();
        holders += fmt::format("{}{} for {:.1f} s", holders.empty() ? "" : ", ", runner.name, seconds);
      }
      if (!holders.empty()) Log("link").warn("virtual time is held by {}", holders);
      std::string bytes;
      AppendMessage({MessageType::kAlive, 0, 0, {}, holders}, bytes);
      Send(bytes);
      lock.lock();
      continue;
    }
    if (pace_due_) {
      host_wake_.wait_for(lock, kPaceStep);
      if (!advancing_ && QuiescentLocked() && !closing_) {
        pace_due_ = false;
        SendAdvanceLocked();
      } else if (!QuiescentLocked()) {
        pace_due_ = false;
      }
      continue;
    }
    pace_host_ = HostClock::now();
    host_wake_.wait_until(lock, next_alive);
  }
}

void SimLink::Send(std::string_view bytes) {
  std::lock_guard lock(send_mutex_);
  // A failure shows as the end of the stream in ReadLoop.
  if (!SendAll(fd_.get(), bytes, kSendTimeoutMs).ok()) ::shutdown(fd_.get(), SHUT_RDWR);
}

void SimLink::Break(const Status& why) {
  std::unique_lock lock(mutex_);
  broken_ = why;
  broken_at_ = HostClock::now();
  advancing_ = false;
  if (!closing_) Log("link").error("{}", Message(why));
  query_done_.notify_all();
  for (Entry* entry : WaitingLocked()) entry->wake.notify_all();
}

}  // namespace mesorig::sim_wire
