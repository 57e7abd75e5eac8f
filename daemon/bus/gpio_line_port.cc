#include "daemon/bus/gpio_line_port.h"

#include <poll.h>
#include <sys/eventfd.h>

#include <algorithm>

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;

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
  for (const int line : options_.outputs) written_[line] = false;
}

GpioLinePort::~GpioLinePort() {
  {
    MutexLock lock(mutex_);
    ending_ = true;
  }
  const uint64_t one = 1;
  (void)!::write(wake_.get(), &one, sizeof(one));
  if (reader_.joinable()) reader_.join();
}

StatusOr<GpioLinePort::Opened> GpioLinePort::OpenChip() {
  Opened opened;
  MESORIG_ASSIGN_OR_RETURN(opened.chip, GpioChip::Open(options_.chip));
  std::map<int, bool> written;
  {
    MutexLock lock(mutex_);
    written = written_;
  }
  for (const auto& [line, level] : written) {
    MESORIG_RETURN_IF_ERROR(opened.chip->RequestOutput(line, level, options_.consumer));
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
  MESORIG_RETURN_IF_ERROR(chip->Set(line, level));
  MutexLock lock(mutex_);
  written_[line] = level;
  return OkStatus();
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
  HostTime until = HostClock::now() + kRetry;
  for (const auto& [line, input] : opened.inputs) {
    polls.push_back({input.fd, POLLIN, 0});
    until = std::min(until, input.closes_at);
  }
  const auto wait = std::chrono::ceil<std::chrono::milliseconds>(until - HostClock::now());
  ::poll(polls.data(), polls.size(), static_cast<int>(std::max<int64_t>(wait.count(), 0)));
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
    }
    pollfd wake{wake_.get(), POLLIN, 0};
    ::poll(&wake, 1, static_cast<int>(kRetry.count()));
    if (Reopen(opened)) Log("bus").info("GPIO chip {} is back", options_.chip);
  }
}

}  // namespace mesorig::daemon
