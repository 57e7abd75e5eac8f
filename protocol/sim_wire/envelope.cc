#include "protocol/sim_wire/envelope.h"

#include "protocol/base/bytes.h"

namespace mesorig::sim_wire {
namespace {

constexpr size_t kHeader = 1 + 2 + 4 + 8;

bool IsKnown(uint8_t type) { return (type >= 1 && type <= 6) || (type >= 16 && type <= 19); }

}  // namespace

std::string Pack(const Welcome& welcome) {
  ByteWriter out;
  out.Put(kProtocolVersion).PutString(welcome.rig_sha256).Put(welcome.seed);
  out.Put<int64_t>(welcome.now.count()).Put(static_cast<uint16_t>(welcome.devices.size()));
  for (const std::string& device : welcome.devices) out.PutString(device);
  out.PutString(welcome.modbus_endpoint);
  return out.Take();
}

StatusOr<Welcome> UnpackWelcome(std::string_view bytes) {
  ByteReader in(bytes);
  const auto version = in.Get<uint16_t>();
  if (in.ok() && version != kProtocolVersion) {
    return FailedPrecondition("the simulator speaks protocol version {}, this program {}", version,
                              kProtocolVersion);
  }
  Welcome welcome;
  welcome.rig_sha256 = in.GetString();
  welcome.seed = in.Get<uint64_t>();
  welcome.now = RigTime(in.Get<int64_t>());
  const auto count = in.Get<uint16_t>();
  for (uint16_t i = 0; i < count && in.ok(); ++i) welcome.devices.emplace_back(in.GetString());
  welcome.modbus_endpoint = in.GetString();
  if (!in.done()) return InvalidArgument("the simulator's welcome is not understood");
  return welcome;
}

void AppendMessage(const Envelope& envelope, std::string& out) {
  ByteWriter header;
  header.Put(static_cast<uint32_t>(kHeader + envelope.payload.size()))
      .Put(static_cast<uint8_t>(envelope.type))
      .Put(envelope.device)
      .Put(envelope.id)
      .Put<int64_t>(envelope.time.count());
  out += header.bytes();
  out += envelope.payload;
}

Status MessageReader::Feed(std::string_view bytes) {
  buffer_.append(bytes);
  size_t at = 0;
  while (buffer_.size() - at >= 4) {
    ByteReader in(std::string_view(buffer_).substr(at));
    const size_t length = in.Get<uint32_t>();
    if (length < kHeader || length > kHeader + kMaxPayload) {
      return InvalidArgument("a message of {} bytes, permitted is {} to {}", length, kHeader,
                             kHeader + kMaxPayload);
    }
    if (in.remaining() < length) break;
    Envelope envelope;
    const auto type = in.Get<uint8_t>();
    if (!IsKnown(type)) return InvalidArgument("a message of unknown type {}", type);
    envelope.type = static_cast<MessageType>(type);
    envelope.device = in.Get<uint16_t>();
    envelope.id = in.Get<uint32_t>();
    envelope.time = RigTime(in.Get<int64_t>());
    envelope.payload = in.GetRaw(length - kHeader);
    ready_.push_back(std::move(envelope));
    at += 4 + length;
  }
  buffer_.erase(0, at);
  return OkStatus();
}

std::optional<Envelope> MessageReader::Next() {
  if (ready_.empty()) return std::nullopt;
  Envelope envelope = std::move(ready_.front());
  ready_.pop_front();
  return envelope;
}

}  // namespace mesorig::sim_wire
