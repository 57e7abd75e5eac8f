#pragma once
// The entries of a drive's object dictionary and expedited SDO transfers on them (CiA 301, 7.2.4).

#include <cstdint>
#include <map>
#include <optional>

#include "protocol/sim_wire/payloads.h"

namespace mesorig::simulator {

enum class SdoAbort : uint32_t {
  kUnknownCommand = 0x05040001,
  kReadOnly = 0x06010002,
  kNoObject = 0x06020000,
  kNoSubIndex = 0x06090011,
  kWrongLength = 0x06070010,
  kValueRange = 0x06090030,
};

class ObjectDictionary {
 public:
  struct Entry {
    uint8_t size = 0;  // bytes: 1, 2 or 4
    bool writable = false;
    int64_t low = 0, high = 0;
    uint32_t value = 0;  // two's complement for signed entries
  };
  void Add(uint16_t index, uint8_t sub, Entry entry) { entries_[Key(index, sub)] = entry; }
  uint32_t Get(uint16_t index, uint8_t sub) const { return entries_.at(Key(index, sub)).value; }
  int32_t GetSigned(uint16_t index, uint8_t sub) const {
    return static_cast<int32_t>(Get(index, sub));
  }
  void Set(uint16_t index, uint8_t sub, uint32_t value) {
    entries_.at(Key(index, sub)).value = value;
  }
  // Answers an SDO request (8 bytes of COB 0x600+id) with the data of COB 0x580+id. `written` gets
  // index << 8 | sub of a successful download.
  sim_wire::CanFrame Serve(const sim_wire::CanFrame& request, uint8_t node,
                           std::optional<uint32_t>& written);

 private:
  static uint32_t Key(uint16_t index, uint8_t sub) { return uint32_t{index} << 8 | sub; }
  bool HasIndex(uint16_t index) const;
  std::map<uint32_t, Entry> entries_;
};

}  // namespace mesorig::simulator
