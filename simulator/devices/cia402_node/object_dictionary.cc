#include "simulator/devices/cia402_node/object_dictionary.h"

namespace mesorig::simulator {
namespace {

using sim_wire::CanFrame;

uint32_t Little(const CanFrame& frame, int at, int bytes) {
  uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= uint32_t{frame.data[at + i]} << (8 * i);
  return value;
}

void PutLittle(CanFrame& frame, int at, int bytes, uint32_t value) {
  for (int i = 0; i < bytes; ++i) frame.data[at + i] = static_cast<uint8_t>(value >> (8 * i));
}

// Sign-extends for the range check of entries whose low bound is negative.
int64_t Interpret(const ObjectDictionary::Entry& entry, uint32_t value) {
  if (entry.low >= 0) return value;
  const int shift = 32 - 8 * entry.size;
  return static_cast<int32_t>(value << shift) >> shift;
}

}  // namespace

bool ObjectDictionary::HasIndex(uint16_t index) const {
  const auto it = entries_.lower_bound(Key(index, 0));
  return it != entries_.end() && it->first >> 8 == index;
}

CanFrame ObjectDictionary::Serve(const CanFrame& request, uint8_t node,
                                 std::optional<uint32_t>& written) {
  CanFrame reply{static_cast<uint16_t>(0x580 + node), 8, {}};
  const auto index = static_cast<uint16_t>(Little(request, 1, 2));
  const uint8_t sub = request.data[3], command = request.data[0];
  PutLittle(reply, 1, 2, index);
  reply.data[3] = sub;
  const auto abort = [&](SdoAbort code) {
    reply.data[0] = 0x80;
    PutLittle(reply, 4, 4, static_cast<uint32_t>(code));
    return reply;
  };
  const auto it = entries_.find(Key(index, sub));
  const bool upload = command == 0x40;
  const bool download = (command & 0xF3) == 0x23;  // expedited, size indicated
  if (request.size != 8 || (!upload && !download)) return abort(SdoAbort::kUnknownCommand);
  if (it == entries_.end()) {
    return abort(HasIndex(index) ? SdoAbort::kNoSubIndex : SdoAbort::kNoObject);
  }
  Entry& entry = it->second;
  if (upload) {
    reply.data[0] = static_cast<uint8_t>(0x43 | (4 - entry.size) << 2);
    PutLittle(reply, 4, entry.size, entry.value);
    return reply;
  }
  const int size = 4 - ((command >> 2) & 3);
  if (!entry.writable) return abort(SdoAbort::kReadOnly);
  if (size != entry.size) return abort(SdoAbort::kWrongLength);
  const uint32_t value = Little(request, 4, size);
  const int64_t number = Interpret(entry, value);
  if (number < entry.low || number > entry.high) return abort(SdoAbort::kValueRange);
  entry.value = static_cast<uint32_t>(number);
  written = it->first;
  reply.data[0] = 0x60;
  return reply;
}

}  // namespace mesorig::simulator
