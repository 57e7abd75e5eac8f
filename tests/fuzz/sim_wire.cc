// The stream between daemon and simulator: first byte how it is cut into reads, the rest the
// stream. Whatever comes out of it is tried as every payload; what unpacks packs to the same bytes.

#include "protocol/sim_wire/envelope.h"
#include "protocol/sim_wire/payloads.h"
#include "tests/fuzz/fuzz_target.h"

namespace mesorig::sim_wire {
namespace {

// Refused with InvalidArgument, or `also`.
template <typename Value>
void CheckSame(const StatusOr<Value>& value, std::string_view bytes,
               absl::StatusCode also = absl::StatusCode::kInvalidArgument) {
  if (value.ok()) {
    MESORIG_CHECK(Pack(*value) == bytes);
  } else {
    MESORIG_CHECK(absl::IsInvalidArgument(value.status()) || value.status().code() == also);
  }
}

void TryPayloads(std::string_view bytes) {
  CheckSame(UnpackWelcome(bytes), bytes, absl::StatusCode::kFailedPrecondition);  // version
  CheckSame(UnpackCanFrame(bytes), bytes);
  CheckSame(UnpackLineEdge(bytes), bytes);
  CheckSame(UnpackCameraAccess(bytes), bytes);
  CheckSame(UnpackCameraTrigger(bytes), bytes);
  CheckSame(UnpackCameraFrame(bytes), bytes, absl::StatusCode::kDataLoss);  // torn
  if (const auto line = UnpackLineQuery(bytes); line.ok()) {
    MESORIG_CHECK(PackLineQuery(*line) == bytes);
  }
  if (const auto value = UnpackRegisterValue(bytes); value.ok()) {
    MESORIG_CHECK(PackRegisterValue(*value) == bytes);
  }
}

}  // namespace
}  // namespace mesorig::sim_wire

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  if (size == 0) return 0;
  const size_t cut = data[0] + size_t{1};
  std::string_view stream = fuzz::View(data, size).substr(1);
  sim_wire::TryPayloads(stream);
  sim_wire::MessageReader reader;
  for (; !stream.empty(); stream.remove_prefix(std::min(cut, stream.size()))) {
    if (!reader.Feed(stream.substr(0, cut)).ok()) break;
    while (const auto envelope = reader.Next()) {
      MESORIG_CHECK(envelope->payload.size() <= sim_wire::kMaxPayload);
      sim_wire::TryPayloads(envelope->payload);
    }
  }
  return 0;
}
