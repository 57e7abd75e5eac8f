#include "daemon/drivers/cia402/sdo_client.h"

namespace mesorig::daemon::cia402 {
namespace {

constexpr int kAttempts = 2;
constexpr uint8_t kAbort = 0x80, kUpload = 0x40, kDownloadDone = 0x60;

// Expedited, size indicated: `base` with the number of bytes that hold no data.
uint8_t Command(uint8_t base, int size) { return static_cast<uint8_t>(base | (4 - size) << 2 | 3); }

}  // namespace

SdoClient::SdoClient(RigClock& clock, CanBus& bus, const StopFlag& stop, int node,
                     std::string device, RigTime timeout)
    : clock_(clock),
      bus_(bus),
      stop_(stop),
      node_(node),
      device_(std::move(device)),
      timeout_(timeout) {
  bus_.Subscribe(static_cast<uint16_t>(0x580 + node_), [this](RigTime, const CanFrame& frame) {
    // An answer to a request that was given up names another object: dropped.
    const uint32_t object = GetLittle(frame, 1, 2) << 8 | frame.data[3];
    if (frame.size == 8 && object == expected_) {
      answer_ = frame;
    } else {
      ++counts_.foreign;
    }
  });
}

SdoClient::~SdoClient() { bus_.Unsubscribe(static_cast<uint16_t>(0x580 + node_)); }

SdoCounts SdoClient::counts() const {
  SdoCounts counts;
  clock_.Read([&] { counts = counts_; });
  return counts;
}

Status SdoClient::Write(const Object& object, uint32_t value, Heed heed) {
  CanFrame request;
  request.data[0] = Command(0x20, object.size);
  PutLittle(request, 4, object.size, value);
  MESORIG_ASSIGN_OR_RETURN(const CanFrame answer, Exchange(object, request, heed, "writing"));
  if (answer.data[0] != kDownloadDone) {
    return Unavailable("{}: writing 0x{:04X}:{} ({}): unexpected answer 0x{:02X}", device_,
                       object.index, object.sub, object.name, answer.data[0]);
  }
  return OkStatus();
}

StatusOr<uint32_t> SdoClient::Read(const Object& object, Heed heed) {
  CanFrame request;
  request.data[0] = kUpload;
  MESORIG_ASSIGN_OR_RETURN(const CanFrame answer, Exchange(object, request, heed, "reading"));
  if (answer.data[0] != Command(kUpload, object.size)) {
    return Unavailable("{}: reading 0x{:04X}:{} ({}): unexpected answer 0x{:02X}", device_,
                       object.index, object.sub, object.name, answer.data[0]);
  }
  return GetLittle(answer, 4, object.size);
}

StatusOr<CanFrame> SdoClient::Exchange(const Object& object, CanFrame request, Heed heed,
                                       std::string_view operation) {
  const auto context = [&] {
    return fmt::format("{}: {} 0x{:04X}:{} ({})", device_, operation, object.index, object.sub,
                       object.name);
  };
  request.id = static_cast<uint16_t>(0x600 + node_);
  request.size = 8;
  PutLittle(request, 1, 2, object.index);
  request.data[3] = object.sub;
  clock_.Change([&] {
    expected_ = uint32_t{object.index} << 8 | object.sub;
    answer_.reset();
  });
  const auto answered = [&] { return answer_.has_value(); };
  Status waited;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    if (const Status sent = bus_.Send(request); !sent.ok()) return Annotate(sent, context());
    const RigTime deadline = clock_.Now() + timeout_ / kAttempts;
    waited = heed == Heed::kStop                    ? stop_.Wait(deadline, answered)
             : clock_.WaitUntil(deadline, answered) ? OkStatus()
                                                    : DeadlineExceeded("no answer");
    if (absl::IsCancelled(waited)) return waited;
    if (waited.ok()) break;
    clock_.Change([&] { ++counts_.unanswered; });
  }
  if (!waited.ok()) {
    return DeadlineExceeded("{}: no answer within {} s", context(), Seconds(timeout_));
  }
  CanFrame answer;
  clock_.Change([&] {
    answer = *answer_;
    expected_ = 0;  // a second answer is nobody's
    counts_.aborted += answer.data[0] == kAbort ? 1 : 0;
  });
  if (answer.data[0] == kAbort) {
    return Unavailable("{}: aborted with {}", context(), SdoAbortText(GetLittle(answer, 4, 4)));
  }
  return answer;
}

}  // namespace mesorig::daemon::cia402
