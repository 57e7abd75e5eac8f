#include "daemon/bus/gpio_line_port.h"

#include <poll.h>
#include <sys/eventfd.h>

#include <algorithm>

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;

// A chip whose lines are called by the numbers of the rig file.
class NamedChip final : public GpioChip {
 public:
  NamedChip(std::unique_ptr<GpioChip> chip, std::map<int, int> there)
      : chip_(std::move(chip)), there_(std::move(there)) {}
  int lines() const override { return chip_->lines(); }
  StatusOr<int> Find(const std::string& name) override { return chip_->Find(name); }
  StatusOr<int> RequestInput(int line, const std::string& consumer) override {
    return chip_->RequestInput(There(line), consumer);
  }
  Status RequestOutput(int line, bool level, const std::string& consumer) override {
    return chip_->RequestOutput(There(line), level, consumer);
  }
  StatusOr<bool> Get(int line) override { return chip_->Get(There(line)); }
  Status Set(int line, bool level) override { return chip_->Set(There(line), level); }
  StatusOr<bool> TakeEdge(int line) override { return chip_->TakeEdge(There(line)); }

 private:
  int There(int line) const {
    const auto found = there_.find(line);
    return found == there_.end() ? line : found->second;
  }
  const std::unique_ptr<GpioChip> chip_;
  const std::map<int, int> there_;
};

StatusOr<std::shared_ptr<GpioChip>> OpenNamed(const GpioLineOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(std::unique_ptr<GpioChip> chip, GpioChip::Open(options.chip));
  std::map<int, int> there;
  for (const auto& [line, name] : options.names) {
    MESORIG_ASSIGN_OR_RETURN(there[line], chip->Find(name));
  }
  return std::make_shared<NamedChip>(std::move(chip), std::move(there));
}

}  // namespace

StatusOr<std::unique_ptr<GpioLinePort>> GpioLinePort::Open(RigClock& clock,
                                                           GpioLineOptions options) {
  std::unique_ptr<GpioLinePort> port(new GpioLinePort(clock, std::move(options)));
  MESORIG_ASSIGN_OR_RETURN(Opened opened, port->OpenChip());
  port->reader_ = std::thread(
      [port = port.get(), opened = std::move(opened)]() mutable { port->Run(std::move(opened)); });
  return port;
}

GpioLinePort::GpioLinePort(RigClock& clock, GpioLineOptions options)
    : clock_(clock),
      options_(std::move(options)),
      wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  for (const int line : options_.outputs) outputs_[line] = {};
}

GpioLinePort::~GpioLinePort() {
  {
    MutexLock lock(mutex_);
    ending_ = true;
  }
  Wake();
  if (reader_.joinable()) reader_.join();
}

void GpioLinePort::Wake() {
  const uint64_t one = 1;
  (void)!::write(wake_.get(), &one, sizeof(one));
}

StatusOr<GpioLinePort::Opened> GpioLinePort::OpenChip() {
  Opened opened;
  MESORIG_ASSIGN_OR_RETURN(opened.chip, OpenNamed(options_));
  std::map<int, Output> outputs;
  {
    MutexLock lock(mutex_);
    outputs = outputs_;
  }
  for (const auto& [line, output] : outputs) {
    MESORIG_RETURN_IF_ERROR(opened.chip->RequestOutput(line, output.told, options_.consumer));
  }
  for (const int line : options_.inputs) {
    Input& input = opened.inputs[line];
    MESORIG_ASSIGN_OR_RETURN(input.fd, opened.chip->RequestInput(line, options_.consumer));
    MESORIG_ASSIGN_OR_RETURN(input.told, opened.chip->Get(line));
  }
  MutexLock lock(mutex_);
  chip_ = opened.chip;
  return opened;
}

StatusOr<std::shared_ptr<GpioChip>> GpioLinePort::Chip() const {
  MutexLock lock(mutex_);
  if (chip_ != nullptr) return chip_;
  return Unavailable("GPIO chip {} is gone", options_.chip);
}

StatusOr<bool> GpioLinePort::Read(int line) {
  MESORIG_ASSIGN_OR_RETURN(const auto chip, Chip());
  return chip->Get(line);
}

Status GpioLinePort::Write(int line, bool level) {
  MESORIG_ASSIGN_OR_RETURN(const auto chip, Chip());
  MutexLock lock(mutex_);
  const auto found = outputs_.find(line);
  if (found == outputs_.end()) {
    return InvalidArgument("{}: line {} is no output", options_.chip, line);
  }
  Output& output = found->second;
  const auto now = HostClock::now();
  if (!level && output.told && now < output.rose + options_.shortest_pulse) {
    output.falls_at = output.rose + options_.shortest_pulse;
    output.told = false;
    Wake();
    return OkStatus();
  }
  if (level && output.falls_at != HostTime::max()) {
    MESORIG_RETURN_IF_ERROR(chip->Set(line, false));  // a rise is a rise
  }
  MESORIG_RETURN_IF_ERROR(chip->Set(line, level));
  if (level && !output.told) output.rose = now;
  if (level) output.falls_at = HostTime::max();
  output.told = level;
  return OkStatus();
}

StatusOr<GpioLinePort::HostTime> GpioLinePort::Fall(GpioChip& chip) {
  HostTime next = HostTime::max();
  const auto now = HostClock::now();
  MutexLock lock(mutex_);
  for (auto& [line, output] : outputs_) {
    if (output.falls_at <= now) {
      MESORIG_RETURN_IF_ERROR(chip.Set(line, false));
      output.falls_at = HostTime::max();
    }
    next = std::min(next, output.falls_at);
  }
  return next;
}

void GpioLinePort::OnEdge(std::function<void(int line, bool level, RigTime when)> handler) {
  clock_.Change([&] { handler_ = std::move(handler); });
}

void GpioLinePort::Tell(int line, Input& input, bool level) {
  input.told = level;
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    if (handler_) handler_(line, level, now);
  });
}

Status GpioLinePort::Edge(GpioChip& chip, int line, Input& input) {
  MESORIG_ASSIGN_OR_RETURN(const bool level, chip.TakeEdge(line));
  if (!level) {
    input.closes_at = HostTime::max();
    if (input.told) Tell(line, input, false);
  } else if (!input.told) {
    input.closes_at = HostClock::now() + options_.debounce;
  }
  return OkStatus();
}

// An edge that was lost shows here as well: the level decides.
Status GpioLinePort::Settle(GpioChip& chip, int line, Input& input) {
  MESORIG_ASSIGN_OR_RETURN(const bool level, chip.Get(line));
  const auto now = HostClock::now();
  if (!level) {
    input.closes_at = HostTime::max();
    if (input.told) Tell(line, input, false);
  } else if (!input.told && input.closes_at == HostTime::max()) {
    input.closes_at = now + options_.debounce;
  } else if (!input.told && now >= input.closes_at) {
    input.closes_at = HostTime::max();
    Tell(line, input, true);
  }
  return OkStatus();
}

Status GpioLinePort::Look(Opened& opened) {
  std::vector<pollfd> polls = {{wake_.get(), POLLIN, 0}};
  MESORIG_ASSIGN_OR_RETURN(HostTime until, Fall(*opened.chip));
  until = std::min(until, HostClock::now() + kRetry);
  for (const auto& [line, input] : opened.inputs) {
    polls.push_back({input.fd, POLLIN, 0});
    until = std::min(until, input.closes_at);
  }
  const auto wait = std::chrono::ceil<std::chrono::milliseconds>(until - HostClock::now());
  ::poll(polls.data(), polls.size(), static_cast<int>(std::max<int64_t>(wait.count(), 0)));
  uint64_t woken = 0;
  (void)!::read(wake_.get(), &woken, sizeof(woken));
  size_t i = 0;
  for (auto& [line, input] : opened.inputs) {
    const short events = polls[++i].revents;
    if ((events & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
      return Unavailable("{}: line {} is gone", options_.chip, line);
    }
    MESORIG_RETURN_IF_ERROR((events & POLLIN) != 0 ? Edge(*opened.chip, line, input)
                                                   : Settle(*opened.chip, line, input));
  }
  return OkStatus();
}

bool GpioLinePort::Reopen(Opened& opened) {
  auto again = OpenChip();
  if (!again.ok()) return false;
  // What was told last stays told: differences are edges.
  for (auto& [line, input] : again->inputs) {
    const bool told = opened.inputs[line].told;
    const bool level = std::exchange(input.told, told);
    if (told && !level) Tell(line, input, false);
  }
  opened = *std::move(again);
  return true;
}

void GpioLinePort::Run(Opened opened) {
  for (;;) {
    {
      MutexLock lock(mutex_);
      if (ending_) return;
    }
    if (opened.chip != nullptr) {
      const Status seen = Look(opened);
      if (seen.ok()) continue;
      Log("bus").error("GPIO: {}", Message(seen));
      opened.chip = nullptr;
      MutexLock lock(mutex_);
      chip_ = nullptr;
      for (auto& [line, output] : outputs_) output.falls_at = HostTime::max();
    }
    pollfd wake{wake_.get(), POLLIN, 0};
    ::poll(&wake, 1, static_cast<int>(kRetry.count()));
    if (Reopen(opened)) Log("bus").info("GPIO chip {} is back", options_.chip);
  }
}

}  // namespace mesorig::daemon
