// libgpiod 1.6.

#include <gpiod.h>

#include <cerrno>
#include <cstring>
#include <map>

#include "daemon/bus/gpio_chip.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {
namespace {

class GpioChipV1 final : public GpioChip {
 public:
  GpioChipV1(std::string name, gpiod_chip* chip) : name_(std::move(name)), chip_(chip) {}
  ~GpioChipV1() override { ::gpiod_chip_close(chip_); }  // releases its lines

  int lines() const override { return static_cast<int>(::gpiod_chip_num_lines(chip_)); }

  StatusOr<int> Find(const std::string& name) override {
    gpiod_line* const handle = ::gpiod_chip_find_line(chip_, name.c_str());
    if (handle != nullptr) return static_cast<int>(::gpiod_line_offset(handle));
    return NotFound("{}: it has no line named \"{}\"", name_, name);
  }
  StatusOr<int> RequestInput(int line, const std::string& consumer) override {
    MESORIG_ASSIGN_OR_RETURN(gpiod_line * const handle, Handle(line));
    if (::gpiod_line_request_both_edges_events(handle, consumer.c_str()) != 0) {
      return Refused(line, handle);
    }
    MutexLock lock(mutex_);
    requested_[line] = handle;
    return ::gpiod_line_event_get_fd(handle);
  }
  Status RequestOutput(int line, bool level, const std::string& consumer) override {
    MESORIG_ASSIGN_OR_RETURN(gpiod_line * const handle, Handle(line));
    if (::gpiod_line_request_output(handle, consumer.c_str(), level ? 1 : 0) != 0) {
      return Refused(line, handle);
    }
    MutexLock lock(mutex_);
    requested_[line] = handle;
    return OkStatus();
  }
  StatusOr<bool> Get(int line) override {
    MutexLock lock(mutex_);
    MESORIG_ASSIGN_OR_RETURN(gpiod_line * const handle, Requested(line));
    const int level = ::gpiod_line_get_value(handle);
    if (level < 0) return Failed(line, "reading");
    return level == 1;
  }
  Status Set(int line, bool level) override {
    MutexLock lock(mutex_);
    MESORIG_ASSIGN_OR_RETURN(gpiod_line * const handle, Requested(line));
    if (::gpiod_line_set_value(handle, level ? 1 : 0) != 0) return Failed(line, "writing");
    return OkStatus();
  }
  StatusOr<bool> TakeEdge(int line) override {
    gpiod_line* handle = nullptr;
    {
      MutexLock lock(mutex_);
      MESORIG_ASSIGN_OR_RETURN(handle, Requested(line));
    }
    gpiod_line_event event{};
    if (::gpiod_line_event_read(handle, &event) != 0) return Failed(line, "reading an edge");
    return event.event_type == GPIOD_LINE_EVENT_RISING_EDGE;
  }

 private:
  StatusOr<gpiod_line*> Handle(int line) {
    if (line < 0 || line >= lines()) {
      return InvalidArgument("{}: line {} is not in [0, {}]", name_, line, lines() - 1);
    }
    gpiod_line* const handle = ::gpiod_chip_get_line(chip_, static_cast<unsigned>(line));
    if (handle == nullptr) return Failed(line, "finding");
    return handle;
  }
  StatusOr<gpiod_line*> Requested(int line) REQUIRES(mutex_) {
    const auto found = requested_.find(line);
    if (found != requested_.end()) return found->second;
    return InvalidArgument("{}: line {} was not asked for", name_, line);
  }
  Status Failed(int line, std::string_view what) {
    return Unavailable("{}: {} line {}: {}", name_, what, line, std::strerror(errno));
  }
  Status Refused(int line, gpiod_line* handle) {
    const int error = errno;
    if (error != EBUSY) return Unavailable("{}: line {}: {}", name_, line, std::strerror(error));
    (void)::gpiod_line_update(handle);
    const char* const holder = ::gpiod_line_consumer(handle);
    return FailedPrecondition("{}: line {} is in use by {}", name_, line,
                              holder == nullptr ? "somebody" : holder);
  }

  const std::string name_;
  gpiod_chip* const chip_;
  Mutex mutex_;
  std::map<int, gpiod_line*> requested_ GUARDED_BY(mutex_);  // the chip's
};

}  // namespace

StatusOr<std::unique_ptr<GpioChip>> GpioChip::Open(const std::string& chip) {
  gpiod_chip* const handle = ::gpiod_chip_open_lookup(chip.c_str());
  if (handle == nullptr) return NotFound("GPIO chip \"{}\": {}", chip, std::strerror(errno));
  return std::make_unique<GpioChipV1>(chip, handle);
}

}  // namespace mesorig::daemon
