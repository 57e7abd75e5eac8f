#pragma once
// The sequencer's states and what may be asked in which: the only place that says what is permitted
// (docs/running.md holds the same table).

#include <array>
#include <cstdint>
#include <string_view>

namespace mesorig::daemon {

enum class SequencerState : uint8_t {
  kIdle,
  kArmed,     // a plan is checked and its session journaled; waits for start
  kRunning,   // shots are taken
  kPausing,   // at the next safe step, or at once; on the way off
  kPaused,    // everything is off; goes on with continue, or when the disk takes frames again
  kWaiting,   // for the operator at the rig; everything is off
  kStopping,  // on the way to rest
  kFault,     // something failed, which the message names; everything is off
};
inline constexpr int kSequencerStates = 8;

enum class SequencerCommand : uint8_t {
  kArm,
  kStart,
  kRun,
  kPause,
  kPauseNow,
  kContinue,
  kAbort,
  kStop,
  kAcknowledge,
  kReset,
  kResume,
};
inline constexpr int kSequencerCommands = 11;

inline constexpr std::array<std::string_view, kSequencerCommands> kCommandNames = {
    "arm",   "start", "run",         "pause", "pause --now", "continue",
    "abort", "stop",  "acknowledge", "reset", "resume"};

struct StateRow {
  std::string_view name;
  bool off;  // lamps, laser and torque are off as long as the state stands
  std::array<bool, kSequencerCommands> allowed;  // in the order of SequencerCommand
};

inline constexpr std::array<StateRow, kSequencerStates> kStateTable = {{
    // clang-format off
    //                  arm start run pause now cont abort stop ack reset resume
    {"idle",     true,  {1,   0,    1,  0,    0,  0,   0,    1,   0,  0,    1}},
    {"armed",    true,  {0,   1,    0,  0,    0,  0,   1,    1,   0,  0,    0}},
    {"running",  false, {0,   0,    0,  1,    1,  0,   1,    1,   0,  0,    0}},
    {"pausing",  false, {0,   0,    0,  0,    1,  0,   1,    1,   0,  0,    0}},
    {"paused",   true,  {0,   0,    0,  0,    0,  1,   1,    1,   0,  0,    0}},
    {"waiting",  true,  {0,   0,    0,  0,    0,  0,   1,    1,   1,  0,    0}},
    {"stopping", false, {0,   0,    0,  0,    0,  0,   0,    1,   0,  0,    0}},
    {"fault",    true,  {1,   0,    1,  0,    0,  0,   0,    1,   0,  1,    1}},
    // clang-format on
}};

constexpr const StateRow& RowOf(SequencerState state) {
  return kStateTable[static_cast<size_t>(state)];
}
constexpr bool Allowed(SequencerState state, SequencerCommand command) {
  return RowOf(state).allowed[static_cast<size_t>(command)];
}
// A session is being written.
constexpr bool InSession(SequencerState state) {
  return state != SequencerState::kIdle && state != SequencerState::kFault;
}

}  // namespace mesorig::daemon
