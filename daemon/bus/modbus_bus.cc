#include "daemon/bus/modbus_bus.h"

#include <absl/strings/numbers.h>
#include <modbus/modbus.h>

#include <sys/select.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>

#include "daemon/bus/device_claim.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr uint32_t kByteTimeout_us = 500'000;

// An exception that the slave answered; the connection is good.
bool IsSlaveException(int error) { return error >= EMBXILFUN && error <= EMBXGTAR; }

uint64_t ModbusCounts::* CountOf(int error) {
  if (IsSlaveException(error)) return &ModbusCounts::refused;
  if (error == ETIMEDOUT) return &ModbusCounts::unanswered;
  if (error >= EMBBADCRC && error <= EMBBADSLAVE) return &ModbusCounts::damaged;
  return &ModbusCounts::broken;
}

// libmodbus waits by select(), whose sets end at FD_SETSIZE.
int ConnectContext(modbus_t* context) {
  if (modbus_connect(context) < 0) return -1;
  if (modbus_get_socket(context) >= FD_SETSIZE) {
    modbus_close(context);
    errno = EMFILE;
    return -1;
  }
  modbus_flush(context);
  return 0;
}

bool AnyOn(const std::vector<uint8_t>& coils) {
  return std::any_of(coils.begin(), coils.end(), [](uint8_t coil) { return coil != 0; });
}

}  // namespace

void ModbusBus::ContextDeleter::operator()(_modbus* context) const {
  modbus_close(context);
  modbus_free(context);
}

StatusOr<ModbusBus::Context> ModbusBus::TcpContext(std::string_view endpoint) {
  const size_t colon = endpoint.rfind(':');
  int port = 0;
  if (colon == endpoint.npos || colon == 0 ||
      !absl::SimpleAtoi({endpoint.data() + colon + 1, endpoint.size() - colon - 1}, &port) ||
      port < 1 || port > 65535) {
    return InvalidArgument("Modbus endpoint \"{}\" is not HOST:PORT with a port in [1, 65535]",
                           endpoint);
  }
  return Context(modbus_new_tcp(std::string(endpoint.substr(0, colon)).c_str(), port));
}

StatusOr<std::unique_ptr<ModbusBus>> ModbusBus::Connect(RigClock& clock, std::string_view endpoint,
                                                        ModbusBusOptions options) {
  MESORIG_ASSIGN_OR_RETURN(Context context, TcpContext(endpoint));
  return Begin(clock, std::string(endpoint), std::move(context), UniqueFd(), options);
}

StatusOr<std::unique_ptr<ModbusBus>> ModbusBus::Open(RigClock& clock, const Buses::Modbus& where,
                                                     ModbusBusOptions options) {
  if (where.rtu.empty()) {
    MESORIG_ASSIGN_OR_RETURN(UniqueFd claim, ClaimDevice("Modbus " + where.endpoint()));
    MESORIG_ASSIGN_OR_RETURN(Context context, TcpContext(where.tcp));
    return Begin(clock, where.endpoint(), std::move(context), std::move(claim), options);
  }
  std::error_code error;  // (a link of /dev/serial/by-id is the device that it leads to)
  const std::string device = std::filesystem::weakly_canonical(where.rtu, error).string();
  MESORIG_ASSIGN_OR_RETURN(UniqueFd claim,
                           ClaimDevice("Modbus rtu:" + (error ? where.rtu : device)));
  constexpr int kDataBits = 8;
  Context context(
      modbus_new_rtu(where.rtu.c_str(), where.baud, where.parity, kDataBits, where.stop_bits));
  return Begin(clock, where.endpoint(), std::move(context), std::move(claim), options);
}

StatusOr<std::unique_ptr<ModbusBus>> ModbusBus::Begin(RigClock& clock, std::string endpoint,
                                                      Context context, UniqueFd claim,
                                                      ModbusBusOptions options) {
  if (context == nullptr) {
    return InvalidArgument("Modbus endpoint \"{}\": {}", endpoint, modbus_strerror(errno));
  }
  const auto timeout_us = static_cast<uint32_t>(
      std::chrono::duration_cast<std::chrono::microseconds>(options.response_timeout).count());
  modbus_set_response_timeout(context.get(), timeout_us / 1'000'000, timeout_us % 1'000'000);
  // An answer that breaks off.
  modbus_set_byte_timeout(context.get(), 0, std::min(timeout_us, kByteTimeout_us));
  if (modbus_set_slave(context.get(), options.unit) < 0) {
    return InvalidArgument("Modbus unit {} is not in [1, 247]", options.unit);
  }
  if (ConnectContext(context.get()) < 0) {
    return Unavailable("Modbus {}: {}", endpoint, modbus_strerror(errno));
  }
  return std::unique_ptr<ModbusBus>(new ModbusBus(clock, std::move(endpoint), std::move(context),
                                                  std::move(claim), options));
}

ModbusBus::ModbusBus(RigClock& clock, std::string endpoint, Context context, UniqueFd claim,
                     ModbusBusOptions options)
    : clock_(clock),
      endpoint_(std::move(endpoint)),
      claim_(std::move(claim)),
      options_(options),
      context_(std::move(context)),
      thread_(clock, "modbus", [this] { Run(); }) {}

ModbusBus::~ModbusBus() {
  clock_.Change([&] { closing_ = true; });
}

ModbusCounts ModbusBus::counts() const {
  ModbusCounts counts;
  clock_.Read([&] { counts = counts_; });
  return counts;
}

Status ModbusBus::Failed(std::string_view request) {
  const int error = errno;
  const std::string text = fmt::format("{}: {}", request, modbus_strerror(error));
  clock_.Change([&] { ++(counts_.*CountOf(error)); });
  // Aborted marks what the slave itself refused: connecting again would not help.
  return IsSlaveException(error) ? absl::AbortedError(text) : absl::UnavailableError(text);
}

Status ModbusBus::WriteCoilsNow(modbus_t* context, int first, const std::vector<uint8_t>& values) {
  const int count = static_cast<int>(values.size());
  if (modbus_write_bits(context, first, count, values.data()) < 0) {
    return Failed(fmt::format("writing coils {}..{}", first, first + count - 1));
  }
  std::vector<uint8_t> read(values.size());
  if (modbus_read_bits(context, first, count, read.data()) != count) {
    return Failed(fmt::format("reading coils {}..{} back", first, first + count - 1));
  }
  for (int i = 0; i < count; ++i) {
    if ((read[i] != 0) == (values[i] != 0)) continue;
    clock_.Change([&] { ++counts_.unheeded; });
    return Unavailable("writing coils {}..{}: coil {} reads {}, {} was written", first,
                       first + count - 1, first + i, read[i] != 0 ? "on" : "off",
                       values[i] != 0 ? "on" : "off");
  }
  return OkStatus();
}

Status ModbusBus::WriteCoils(int first, std::vector<uint8_t> values) {
  auto job = std::make_shared<Job>();
  job->writes = true;
  job->lights = AnyOn(values);
  job->work = [this, first, values = std::move(values)](modbus_t* context) {
    return WriteCoilsNow(context, first, values);
  };
  return Enqueue(job);
}

StatusOr<std::vector<uint16_t>> ModbusBus::ReadInputRegisters(int first, int count) {
  return ReadRegisters(first, count, false);
}

StatusOr<std::vector<uint16_t>> ModbusBus::LookAtInputRegisters(int first, int count) {
  return ReadRegisters(first, count, true);
}

StatusOr<std::vector<uint16_t>> ModbusBus::ReadRegisters(int first, int count, bool looks) {
  auto job = std::make_shared<Job>();
  job->looks = looks;
  auto values = std::make_shared<std::vector<uint16_t>>(count);  // outlives a caller that is gone
  job->work = [this, first, count, values](modbus_t* context) {
    if (modbus_read_input_registers(context, first, count, values->data()) != count) {
      return Failed(fmt::format("reading input registers {}..{}", first, first + count - 1));
    }
    return OkStatus();
  };
  MESORIG_RETURN_IF_ERROR(Enqueue(job));
  return std::move(*values);
}

Status ModbusBus::Enqueue(const std::shared_ptr<Job>& job) {
  clock_.Change([&] { jobs_.push_back(job); });
  clock_.WaitUntil(kNever, [&] { return job->done; });
  return job->result;
}

Status ModbusBus::WriteCoilsAtOnce(int first, std::vector<uint8_t> values) {
  auto job = std::make_shared<Job>();
  job->writes = job->at_once = true;
  job->lights = AnyOn(values);
  job->work = [this, first, values = std::move(values)](modbus_t* context) {
    return WriteCoilsNow(context, first, values);
  };
  std::future<void> finished = job->finished.get_future();
  clock_.Change([&] {
    std::erase_if(jobs_, [](const auto& waiting) {
      if (!waiting->writes || waiting->at_once) return false;
      waiting->result = Cancelled("overtaken by a switch-off");
      waiting->done = true;
      waiting->finished.set_value();
      return true;
    });
    jobs_.push_front(job);
  });
  // One request may be on the wire, and each may time out, connect again and time out again.
  const auto limit = options_.response_timeout * 6;
  if (finished.wait_for(limit) != std::future_status::ready) {
    return DeadlineExceeded("Modbus {}: switch-off not done within {} ms", endpoint_,
                            limit.count());
  }
  return job->result;
}

std::shared_ptr<ModbusBus::Job> ModbusBus::TakeJob() {
  std::shared_ptr<Job> job;
  clock_.Change([&] {
    if (jobs_.empty()) return;
    job = jobs_.front();
    jobs_.pop_front();
  });
  return job;
}

void ModbusBus::Finish(const std::shared_ptr<Job>& job, Status result) {
  clock_.Change([&] {
    job->result = std::move(result);
    job->done = true;
  });
  job->finished.set_value();
}

bool ModbusBus::LeftToItsTimeout() const {
  const bool forgotten = last_telegram_ - last_request_ > options_.keep_alive_limit;
  return options_.keep_alive == kNever || (may_be_on_ && (write_failed_ || forgotten));
}

void ModbusBus::Run() {
  last_telegram_ = last_request_ = clock_.Now();
  for (;;) {
    const RigTime due =
        LeftToItsTimeout() ? kNever : last_telegram_ + options_.keep_alive;
    clock_.WaitUntil(due, [&] { return closing_ || !jobs_.empty(); });
    if (const auto job = TakeJob()) {
      if (job->looks && options_.keep_alive != kNever && LeftToItsTimeout()) {
        Finish(job, Unavailable("Modbus {}: left to its timeout", endpoint_));
        continue;
      }
      last_telegram_ = clock_.Now();
      if (!job->looks) last_request_ = last_telegram_;
      const Status result = Execute(job->work);
      if (job->writes) {
        write_failed_ = !result.ok();
        may_be_on_ = write_failed_ || job->lights;
      }
      Finish(job, Annotate(result, fmt::format("Modbus {}", endpoint_)));
      continue;
    }
    bool closing = false;
    clock_.Read([&] { closing = closing_; });
    if (closing) return;
    last_telegram_ = clock_.Now();
    KeepAlive();
  }
}

Status ModbusBus::EnsureConnected() {
  if (connected_) return OkStatus();
  if (ConnectContext(context_.get()) < 0) return Failed("connecting");
  connected_ = true;
  clock_.Change([&] { ++counts_.connections; });
  return OkStatus();
}

// Every request is idempotent: one that failed on a lost connection is sent once more on a new one.
Status ModbusBus::Execute(const std::function<Status(_modbus*)>& work) {
  Status status;
  for (int attempt = 0; attempt < 2; ++attempt) {
    status = EnsureConnected();
    if (!status.ok()) return status;
    status = work(context_.get());
    if (status.ok()) return status;
    if (absl::IsAborted(status)) return absl::UnavailableError(status.message());
    modbus_close(context_.get());  // a late answer must not be taken for the next one's
    connected_ = false;
  }
  return status;
}

void ModbusBus::KeepAlive() {
  const Status status = Execute([this](modbus_t* context) {
    uint16_t value = 0;
    return modbus_read_input_registers(context, 0, 1, &value) == 1 ? OkStatus()
                                                                   : Failed("keep-alive read");
  });
  if (!status.ok() && !keep_alive_failed_) {
    Log("bus").warn("Modbus {}: {}", endpoint_, Message(status));
  }
  keep_alive_failed_ = !status.ok();
}

}  // namespace mesorig::daemon
