#pragma once
// One message between daemon and simulator: u32 length of what follows, u8 type, u16 device,
// u32 id, i64 time in ns, payload; little-endian. docs/lockstep.md tells who sends what when.

#include <deque>
#include <optional>
#include <string>
#include <string_view>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::sim_wire {

inline constexpr uint16_t kProtocolVersion = 2;
inline constexpr size_t kMaxPayload = 64u << 20;

enum class MessageType : uint8_t {
  // daemon to simulator
  kHello = 1,    // payload: u16 protocol version, u8 role (Role)
  kCommand = 2,  // a device's command; takes effect at the present instant
  kQuery = 3,    // as a command, answered by kReply with the same id
  kAdvance = 4,  // time: the target; answered by kAdvanced
  kAlive = 5,    // sign of life, every second of host time; payload: who holds time
  kInject = 6,   // payload: text; a fault or an operator's hand; answered by kReply
  // simulator to daemon
  kWelcome = 16,   // payload: Welcome
  kReply = 17,     // payload: u8 Answer, then the answer or an error text
  kOutput = 18,    // a device's output at `time`
  kAdvanced = 19,  // time: now; payload: u8 flags (AdvancedFlags)
};

enum class Role : uint8_t {
  kRig = 0,       // moves time; one at a time
  kInjector = 1,  // a hand at the rig
  kRealTime = 2,  // speaks with devices too; while there is one, time passes by the wall clock
};
inline constexpr Role kLastRole = Role::kRealTime;

enum class Answer : uint8_t {
  kRefused = 0,  // FailedPrecondition at the asker
  kOk = 1,
  kNobody = 2,  // the device is unplugged or did not answer: Unavailable at the asker
};

inline constexpr uint8_t kDeterministic = 1;  // no run-on since the session's Hello
inline constexpr uint8_t kDeadEnd = 2;        // no device will ever do anything by itself

struct Envelope {
  MessageType type{};
  uint16_t device = 0;
  uint32_t id = 0;
  RigTime time{};
  std::string payload;
};

// What the simulator says of itself.
struct Welcome {
  std::string rig_sha256;
  uint64_t seed = 0;
  RigTime now{};
  std::vector<std::string> devices;      // index is the device number, and the order of effects
  std::string modbus_endpoint;           // "127.0.0.1:PORT", or empty
};
std::string Pack(const Welcome& welcome);
StatusOr<Welcome> UnpackWelcome(std::string_view bytes);

// Appends the message's bytes to `out`.
void AppendMessage(const Envelope& envelope, std::string& out);

// Cuts a byte stream into messages. InvalidArgument for a length over kMaxPayload or a header that
// is no message's: the stream is then lost.
class MessageReader {
 public:
  Status Feed(std::string_view bytes);
  std::optional<Envelope> Next();

 private:
  std::string buffer_;
  std::deque<Envelope> ready_;
};

}  // namespace mesorig::sim_wire
