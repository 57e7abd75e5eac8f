#include "simulator/devices/faults/message_faults.h"

#include <algorithm>

#include "simulator/devices/faults/fault_table.h"

namespace mesorig::simulator {
namespace {

constexpr uint32_t kMaxMessages = 1'000'000, kMaxMs = 86'400'000;

}  // namespace

void Damage(std::string& message, uint32_t nth) {
  if (message.empty()) return;
  // Golden ratio: spreads over the message. The pattern changes any number by more than 90.
  message[(nth * 0x9E3779B1u >> 8) % message.size()] ^= static_cast<char>(0xA5);
}

std::optional<Status> MessageFaults::Inject(RigTime now, std::string_view text) {
  std::vector<std::string_view> words = FaultWords(text);
  if (words.empty()) return std::nullopt;
  const std::string_view fault = words[0];
  const bool known = fault == "drop" || fault == "delay" || fault == "corrupt" ||
                     fault == "duplicate" || fault == "disconnect" || fault == "replug";
  if (!known) return std::nullopt;
  Way way = Way::kOut;
  if (words.back() == "in" || words.back() == "out") {
    way = words.back() == "in" ? Way::kIn : Way::kOut;
    words.pop_back();
  }
  const size_t most = fault == "disconnect" ? 1 : fault == "delay" ? 3 : 2;
  if (words.size() > most) return InvalidArgument("{}: \"{}\" is too much", fault, words[most]);
  uint32_t number = 0, ms = 0;
  Counts& counts = of(way);
  if (fault == "disconnect") {
    replug_at_ = kNever;
    SetPlugged(false, now);
  } else if (fault == "replug") {
    MESORIG_RETURN_IF_ERROR(FaultNumber(words, 1, 0, kMaxMs, 0u, ms));
    replug_at_ = ms == 0 ? kNever : now + std::chrono::milliseconds(ms);
    if (ms == 0) SetPlugged(true, now);
  } else if (fault == "delay") {
    MESORIG_RETURN_IF_ERROR(FaultNumber(words, 1, 1, kMaxMs, std::nullopt, ms));
    MESORIG_RETURN_IF_ERROR(FaultNumber(words, 2, 1, kMaxMessages, 1u, number));
    counts.delay = number;
    counts.by = std::chrono::milliseconds(ms);
  } else {
    MESORIG_RETURN_IF_ERROR(FaultNumber(words, 1, 0, kMaxMessages, 1u, number));
    (fault == "drop"      ? counts.drop
     : fault == "corrupt" ? counts.corrupt
                          : counts.duplicate) = number;
  }
  return OkStatus();
}

void MessageFaults::SetPlugged(bool plugged, RigTime now) {
  if (plugged == plugged_) return;
  plugged_ = plugged;
  late_.clear();
  if (on_plug_) on_plug_(plugged, now);
}

std::vector<std::string> MessageFaults::Pass(Way way, RigTime now, std::string message) {
  std::vector<std::string> passed;
  if (!plugged_) return passed;
  Counts& counts = of(way);
  if (counts.drop > 0) {
    --counts.drop;
    return passed;
  }
  if (counts.delay > 0) {
    --counts.delay;
    Late late{way, now + counts.by, std::move(message)};
    const auto after = std::find_if(late_.begin(), late_.end(),
                                    [&](const Late& other) { return other.due > late.due; });
    late_.insert(after, std::move(late));
    return passed;
  }
  if (counts.corrupt > 0) {
    --counts.corrupt;
    Damage(message, damaged_++);
  } else if (counts.duplicate > 0) {
    --counts.duplicate;
    passed.push_back(message);
  }
  passed.push_back(std::move(message));
  return passed;
}

RigTime MessageFaults::NextEvent() const {
  return late_.empty() ? replug_at_ : std::min(replug_at_, late_.front().due);
}

std::vector<MessageFaults::Late> MessageFaults::RunEvent(RigTime now) {
  std::vector<Late> arrived;
  while (!late_.empty() && late_.front().due <= now) {
    arrived.push_back(std::move(late_.front()));
    late_.pop_front();
  }
  if (now >= replug_at_) {
    replug_at_ = kNever;
    SetPlugged(true, now);
  }
  return arrived;
}

}  // namespace mesorig::simulator
