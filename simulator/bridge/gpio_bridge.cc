#include "simulator/bridge/gpio_bridge.h"

#include <filesystem>
#include <fstream>

#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"

namespace mesorig::simulator {
namespace {

namespace fs = std::filesystem;
constexpr const char* kConfig = "/sys/kernel/config/gpio-sim";
constexpr std::chrono::milliseconds kRetry{200};

std::string Word(const fs::path& file) {
  std::string word;
  std::ifstream(file) >> word;
  return word;
}

// The folder of the bank that has the label: KCONFIG/CHIP/BANK.
fs::path FindBank(const std::string& label) {
  std::error_code error;
  for (const auto& chip : fs::directory_iterator(kConfig, error)) {
    for (const auto& bank : fs::directory_iterator(chip, error)) {
      if (bank.is_directory(error) && Word(bank.path() / "label") == label) return bank.path();
    }
  }
  return {};
}

}  // namespace

StatusOr<std::unique_ptr<GpioBridge>> GpioBridge::Open(sim_wire::SimLink& link,
                                                       GpioBridgeOptions options) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t device, link.FindDevice(sim_wire::kLinesDevice));
  std::unique_ptr<GpioBridge> bridge(new GpioBridge(link, device, std::move(options)));
  for (const int line : bridge->options_.inputs) {
    MESORIG_ASSIGN_OR_RETURN(
        const std::string level,
        link.Query(device, sim_wire::PackLineQuery(static_cast<uint16_t>(line))));
    MutexLock lock(bridge->mutex_);
    Input& input = bridge->inputs_[line];
    // (An edge may have come before the answer: the answer is newer or the same.)
    input.due.clear();
    input.level = !level.empty() && level[0] != 0;
  }
  MESORIG_RETURN_IF_ERROR(bridge->FindChip());
  bridge->thread_ = std::thread([bridge = bridge.get()] { bridge->Run(); });
  return bridge;
}

GpioBridge::GpioBridge(sim_wire::SimLink& link, uint16_t device, GpioBridgeOptions options)
    : link_(link), device_(device), options_(std::move(options)) {
  link_.Subscribe(device_, [this](RigTime, const std::string& payload) {
    const auto edge = sim_wire::UnpackLineEdge(payload);
    if (!edge.ok()) return;
    MutexLock lock(mutex_);
    const auto input = inputs_.find(edge->line);
    if (input != inputs_.end()) input->second.due.push_back(edge->level != 0);
  });
}

GpioBridge::~GpioBridge() {
  ending_ = true;
  if (thread_.joinable()) thread_.join();
  link_.Subscribe(device_, [](RigTime, const std::string&) {});
}

Status GpioBridge::FindChip() {
  const fs::path bank = FindBank(options_.label);
  if (bank.empty()) {
    return NotFound("no chip of gpio-sim has the label {} ({})", options_.label, kConfig);
  }
  lines_ = fmt::format("/sys/devices/platform/{}/{}", Word(bank.parent_path() / "dev_name"),
                       Word(bank / "chip_name"));
  std::map<int, bool> levels;
  {
    MutexLock lock(mutex_);
    for (const auto& [line, input] : inputs_) levels[line] = input.level;
  }
  for (const auto& [line, level] : levels) MESORIG_RETURN_IF_ERROR(Pull(line, level));
  for (const int line : options_.outputs) {
    MESORIG_ASSIGN_OR_RETURN(outputs_[line], Value(line));
  }
  return OkStatus();
}

Status GpioBridge::Pull(int line, bool level) const {
  const std::string path = fmt::format("{}/sim_gpio{}/pull", lines_, line);
  std::ofstream file(path);
  file << (level ? "pull-up" : "pull-down") << std::flush;
  return file.good() ? OkStatus() : Unavailable("{}: cannot be written", path);
}

StatusOr<bool> GpioBridge::Value(int line) const {
  const std::string path = fmt::format("{}/sim_gpio{}/value", lines_, line);
  const std::string word = Word(path);
  if (word.empty()) return Unavailable("{}: cannot be read", path);
  return word == "1";
}

void GpioBridge::Run() {
  bool there = true;
  while (!ending_) {
    const Status status = there ? Look() : FindChip();
    if (there && !status.ok()) Log("link").warn("lines: {}", Message(status));
    there = status.ok();
    std::this_thread::sleep_for(there ? kLook : kRetry);
  }
}

Status GpioBridge::Look() {
  for (auto& [line, seen] : outputs_) {
    MESORIG_ASSIGN_OR_RETURN(const bool level, Value(line));
    if (level == std::exchange(seen, level)) continue;
    const Status posted = link_.Post(
        device_, sim_wire::Pack(sim_wire::LineEdge{static_cast<uint16_t>(line), level}));
    if (!posted.ok()) return posted;
  }
  const auto now = std::chrono::steady_clock::now();
  std::map<int, bool> pulls;
  {
    MutexLock lock(mutex_);
    for (auto& [line, input] : inputs_) {
      if (input.due.empty() || now < input.next) continue;
      pulls[line] = input.level = input.due.front();
      input.due.pop_front();
      input.next = now + kHold;
    }
  }
  for (const auto& [line, level] : pulls) MESORIG_RETURN_IF_ERROR(Pull(line, level));
  return OkStatus();
}

}  // namespace mesorig::simulator
