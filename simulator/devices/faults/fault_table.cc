#include "simulator/devices/faults/fault_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "protocol/sim_wire/payloads.h"

namespace mesorig::simulator {
namespace {

using Of = FaultKind::Of;

std::string_view Text(Of of) {
  switch (of) {
    case Of::kAny:
      return "DEVICE";
    case Of::kAxis:
      return "can AXIS";
    case Of::kLamps:
      return "lamps";
    case Of::kNxt:
      return "nxt";
    case Of::kLines:
      return "lines";
    case Of::kCamera:
      return "camera:SERIAL";
    case Of::kRig:
      return "rig";
  }
  return "";
}

// Whether `words` could be this usage: the first word is its own, and there are as many as it has
// places. Names and numbers are the device's to judge.
bool Fits(std::string_view usage, const std::vector<std::string_view>& words) {
  const std::vector<std::string_view> places = FaultWords(usage);
  size_t least = 0;
  for (const std::string_view place : places) least += place.starts_with('[') ? 0 : 1;
  if (words.size() < least || words.size() > places.size()) return false;
  for (size_t i = 0; i < places.size(); ++i) {
    const bool literal =
        places[i].find_first_of("[]|ABCDEFGHIJKLMNOPQRSTUVWXYZ") == std::string_view::npos;
    if (literal && words[i] != places[i]) return false;
    if (places[i].find('|') == std::string_view::npos || places[i].starts_with('[')) continue;
    // One of several: open|close.
    const std::string choices = fmt::format("|{}|", places[i]);
    if (choices.find(fmt::format("|{}|", words[i])) == std::string::npos) return false;
  }
  return true;
}

std::vector<std::string> Devices(const Rig& rig) {
  std::vector<std::string> names = {"can", "lamps", "lines", "rig"};
  if (rig.laser) names.push_back("nxt");
  for (const Axis& axis : rig.axes) names.push_back("can " + axis.name);
  for (const Camera& camera : rig.cameras) names.push_back(sim_wire::CameraDevice(camera.serial));
  return names;
}

}  // namespace

const std::vector<FaultKind>& AllFaults() {
  static const std::vector<FaultKind> faults = {
      {Of::kAny, "drop [N] [in|out]",
       "the next N messages are lost (in: to the device; out: from it)"},
      {Of::kAny, "delay MS [N] [in|out]", "the next N messages come MS milliseconds late"},
      {Of::kAny, "corrupt [N] [in|out]", "a byte of each of the next N messages is damaged"},
      {Of::kAny, "duplicate [N] [in|out]", "the next N messages come twice"},
      {Of::kAny, "disconnect", "its plug is out; axes and cameras are without supply as well"},
      {Of::kAny, "replug [MS]", "its plug is in again, now or in MS milliseconds"},
      {Of::kAxis, "stuck", "the motor does not move, whatever the drive commands"},
      {Of::kAxis, "free", "it moves again"},
      {Of::kAxis, "lose DEG", "the motor loses so many degrees of its steps"},
      {Of::kAxis, "slip DEG", "it slips on its shaft, encoder and motor do not notice: homing does"},
      {Of::kAxis, "hot", "the drive is too hot: a fault that no reset clears"},
      {Of::kAxis, "cool", "it is not any more"},
      {Of::kLamps, "dead LAMP", "its coil is on, it gives no light"},
      {Of::kLamps, "alive LAMP", "a new bulb, which shines when it is switched on next"},
      {Of::kLamps, "heat LAMP DEGREES", "its housing has so many degrees Celsius now"},
      {Of::kLamps, "stuck LAMP", "its relay does not open: it shines whatever its coil says"},
      {Of::kLamps, "exception [N]", "the next N requests are refused (server failure)"},
      {Of::kLamps, "close", "connections are closed; new ones are taken"},
      {Of::kNxt, "mount MOUNT", "the operator hangs the laser there; the door must be open"},
      {Of::kNxt, "switch off|on", "the brick's button"},
      {Of::kNxt, "stuck", "the laser's motor does not turn, whatever the brick says"},
      {Of::kNxt, "free", "it turns again"},
      {Of::kLines, "estop open|close", "the emergency stop"},
      {Of::kLines, "door open|close", "the door"},
      {Of::kLines, "reset", "pressed and let go"},
      {Of::kLines, "weld", "the contactor does not open any more, whatever the chain does"},
      {Of::kLines, "stuck estop|door|power|laser_on",
       "the input says what it says now, whatever happens"},
      {Of::kLines, "free estop|door|power|laser_on", "it follows again"},
      {Of::kCamera, "silent [N]", "the next N triggers give no frame"},
      {Of::kCamera, "torn [N]", "of the next N frames half the rows arrive"},
      {Of::kCamera, "stale [N]", "the next N triggers are answered with an older frame"},
      {Of::kCamera, "wrong_id [N]", "the next N frames name another trigger"},
      {Of::kCamera, "clock SECONDS", "its clock jumps by so much (also back)"},
      {Of::kRig, "leap SECONDS",
       "so much time passes at the rig at once, the daemon hears of it after"},
  };
  return faults;
}

std::vector<std::string_view> FaultWords(std::string_view text) {
  std::vector<std::string_view> words;
  while (!text.empty()) {
    const size_t end = std::min(text.find_first_of(" \t"), text.size());
    if (end > 0) words.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return words;
}

Status FaultNumber(const std::vector<std::string_view>& words, size_t at, uint32_t low,
                   uint32_t high, std::optional<uint32_t> otherwise, uint32_t& number) {
  if (at >= words.size() && otherwise) {
    number = *otherwise;
    return OkStatus();
  }
  const std::string_view text = at < words.size() ? words[at] : std::string_view();
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || number < low || number > high) {
    return InvalidArgument("{}: \"{}\" is not a whole number in [{}, {}]", words[0], text, low,
                           high);
  }
  return OkStatus();
}

Status FaultReal(const std::vector<std::string_view>& words, size_t at, double low, double high,
                 double& number) {
  const std::string_view text = at < words.size() ? words[at] : std::string_view();
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  // (Written so that NaN is refused.)
  if (error != std::errc() || end != text.data() + text.size() ||
      !(number >= low && number <= high)) {
    return InvalidArgument("{}: \"{}\" is not a number in [{}, {}]", words[0], text, low, high);
  }
  return OkStatus();
}

Status CheckFault(const Rig& rig, std::string_view text) {
  std::vector<std::string_view> words = FaultWords(text);
  if (words.size() < 2) return InvalidArgument("\"{}\": say DEVICE FAULT", text);
  const std::vector<std::string> devices = Devices(rig);
  const auto known = [&](std::string_view name) {
    return std::find(devices.begin(), devices.end(), name) != devices.end();
  };
  const std::string device(words[0]);
  if (!known(device)) {
    std::string names;
    for (const std::string& name : devices) names += (names.empty() ? "" : ", ") + name;
    return InvalidArgument("\"{}\": no device \"{}\"; there are {}", text, device, names);
  }
  const bool axis = device == "can" && known(fmt::format("can {}", words[1]));
  words.erase(words.begin(), words.begin() + (axis ? 2 : 1));
  const Of of = axis                           ? Of::kAxis
                : device == "lamps"            ? Of::kLamps
                : device == "nxt"              ? Of::kNxt
                : device == "lines"            ? Of::kLines
                : device == "rig"              ? Of::kRig
                : device.starts_with("camera") ? Of::kCamera
                                               : Of::kAny;
  for (const FaultKind& fault : AllFaults()) {
    const bool here = fault.of == of || (fault.of == Of::kAny && of != Of::kRig);
    if (here && !words.empty() && Fits(fault.usage, words)) return OkStatus();
  }
  return InvalidArgument("\"{}\": {} knows no such fault; `mesorig-sim inject --help` lists them",
                         text, axis ? "an axis" : device);
}

std::string FaultHelp(std::string_view indent) {
  std::string help;
  for (const FaultKind& fault : AllFaults()) {
    help += fmt::format("{}{:<40} {}\n", indent, fmt::format("{} {}", Text(fault.of), fault.usage),
                        fault.meaning);
  }
  return help;
}

}  // namespace mesorig::simulator
