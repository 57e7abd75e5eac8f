#pragma once
// The safety thread: watches the rig by level, says whether anything may be energised, and takes
// the energy away itself. It is no client of the sequencer: whoever moves, lights or shines (plans,
// manual control) does so through axes(), lamps() and gate(), which refuse while it says no, and
// hears of a trip or a stop by its StopFlag. Rules, limits and measured times: docs/safety.md.
//
// Two threads. The watch is a rig thread: every kPoll_s of rig time (kCalmPoll_s while nothing is
// energised) it reads chain, contactor, laser and axes, every kLampPoll_s lamps and their
// temperatures (every kCalmLampPoll_s once all lamps have been seen dark); edges of lines wake it at once. The stop thread lives on the host clock: it carries
// out StopNow, and finds a member of the rig clock that hangs while the rig is energised. Neither
// takes a lock but the clock's (held for moments by anybody) and their own; neither touches disk,
// database or clients.

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "daemon/device/axis.h"
#include "daemon/device/digital_lines.h"
#include "daemon/device/lamp_bank.h"
#include "daemon/device/rig_thread.h"
#include "daemon/device/stop_flag.h"
#include "daemon/safety/interlock_chain.h"
#include "daemon/safety/lamp_hours.h"
#include "daemon/safety/laser_gate.h"
#include "daemon/safety/listeners.h"
#include "daemon/safety/persists.h"
#include "daemon/safety/safety_logic.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// What the safety thread acts on: all of a rig. `lines` may be null: then nothing may be energised.
struct SafetyDevices {
  std::vector<Axis*> axes;
  LampBank* lamps = nullptr;
  DigitalLines* lines = nullptr;
};

// A snapshot: everything in it was read back, and says when.
struct SafetyState {
  bool may_energise = false;
  std::string why_not;            // empty: it may
  bool tripped = false;           // latched; what follows is of the first cause since the last reset
  bool needs_reset_at_rig = false;
  std::string reason;
  RigTime tripped_at{};
  uint16_t causes = 0;            // bits of TripCause
  uint64_t trips = 0, stops = 0;  // since the daemon began

  InterlockChain::Levels chain;
  bool has_power_line = false, power = false;  // the contactor; false also when it cannot be read
  bool laser_on = false;
  RigTime lines_read_at{};
  std::vector<double> lamp_level, housing_c;  // per Rig::lamps; housing_c empty: the bank has none
  RigTime lamps_read_at{};
  std::vector<AxisReading> axes;
  std::vector<double> lamp_hours;  // per Rig::lamps
  bool energised = false;          // torque, a lamp or the laser is asked for or read back as on
};

struct SafetyOptions {
  // Host time: a member of the rig clock that runs for so long without waiting hangs.
  std::chrono::milliseconds host_hang{10000};
};

// Thread-safe. Borrows everything.
class Safety {
 public:
  static constexpr double kPoll_s = 0.1, kCalmPoll_s = 0.5, kLampPoll_s = 1, kCalmLampPoll_s = 10,
                          kOffRetry_s = 5;
  // Whoever has energised the rig and is not heard of for so long hangs. Each call of axes(),
  // lamps() and gate() is heard; one that waits, until its deadline.
  static constexpr double kAlive_s = 10;  // rig time, beside the rig's settling and exposure times

  Safety(RigClock& clock, const Rig& rig, SafetyDevices devices, StopFlag& stop,
         SafetyOptions options = {});
  ~Safety();

  // Reads the chain. FailedPrecondition: which line is open, or what is latched and how it is
  // cleared ("press reset (line 2) at the rig").
  Status MayEnergise();
  // The same from what is known already: no I/O.
  Status Permit() const;
  // A person at a console has seen what tripped: clears what a console may clear and what is gone,
  // after reading everything once more. FailedPrecondition: as MayEnergise, from then on.
  Status Reset();

  // Everything off, now: gate shut, axes quick-stopped, lamps off. From anybody, any thread, in any
  // state; waits for nothing that a plan, lease, audit, database or pool may hold. Returns when the
  // lamps are off (their error otherwise), the axes are told and the OnStop listeners have heard.
  Status StopNow(std::string_view reason);
  // Called by each StopNow, before anything is switched off, on the stop thread: takes no lock but
  // the clock's, and makes whoever energises stop.
  Listening OnStop(std::function<void(std::string_view reason)> hear) {
    return on_stop_.Add(std::move(hear));
  }
  // Called once for each trip, on the watch, after the energy is gone: returns quickly, and does
  // not wait on the rig clock.
  Listening OnTrip(std::function<void(std::string_view reason)> hear) {
    return on_trip_.Add(std::move(hear));
  }
  uint64_t stops() const;  // a manual motion that began before the last one has ended

  // "I am at work": for whoever energised the rig and calls no device for a while.
  void Alive() { AliveUntil(clock_.Now()); }
  void AliveUntil(RigTime until);
  // For the system's watchdog: OK while both threads go round and nobody holds the rig's time.
  // Unavailable names who hangs, and for how long.
  Status Health() const;
  SafetyState state() const;

  // The devices as they may be used. The gate is null in a rig without a laser.
  const std::vector<Axis*>& axes() const { return guarded_axes_; }
  LampBank* lamps() const { return guarded_lamps_.get(); }
  LaserGate* gate() { return gate_.get(); }
  InterlockChain& chain() { return chain_; }
  // Lamp-hours are kept in this file from now on (lamp_hours.h). Errors of the file.
  Status KeepLampHours(const std::filesystem::path& file);

 private:
  friend class AxisGuard;
  friend class LampGuard;
  struct Order {
    std::string reason;
    std::promise<Status> done;
  };

  // The watch.
  void Watch();
  void Poll(bool lamps_too);
  void PollLines(RigTime now);
  void PollAxes(RigTime now);
  void PollLamps(RigTime now);
  void PutOut();
  void TellTrips();
  Status DeEnergise();  // also the stop thread's
  // The logic, under the clock's lock.
  void StepInsideChange(bool reset_edge, bool console_reset);
  bool EnergisedInsideChange() const;
  std::string CauseInsideChange(TripCause cause) const;
  Status PermitInsideChange() const;
  void PollNow();
  // Of the guards.
  Status MayAsk() const;  // Permit, and no stop is being carried out
  void AskTorque(size_t axis, bool on);
  void AskLight(int lamp);  // index into Rig::lamps; -1: none
  void OweDarkness();       // it was asked for, and could not be had
  Status MayMove();         // beside Permit: the laser is dark
  Status MayShine();        // beside Permit: no axis moves
  // The stop thread.
  void ServeStops();
  void LookForHang();
  void CarryOut(const std::vector<std::shared_ptr<Order>>& orders);

  RigClock& clock_;
  const Rig& rig_;
  const SafetyDevices devices_;
  StopFlag& stop_;
  const SafetyOptions options_;
  const RigTime alive_limit_;
  LampHours hours_;

  // Guarded by the clock's lock:
  SafetyLogic logic_;
  SafetyInputs flags_;  // what is stuck, hot, lost, hung
  SafetyOutputs outputs_;
  SafetyState seen_;
  std::vector<bool> torque_asked_;
  int lamp_asked_ = -1;  // index into Rig::lamps
  bool hangs_ = false, ending_ = false;
  int stopping_ = 0;  // orders that are being carried out
  bool act_ = false;  // the watch is wanted at once
  uint64_t polls_wanted_ = 0;
  RigTime alive_until_{}, dark_at_{};  // when light that went off must be gone
  bool dark_seen_ = false;             // it was read back as gone, after that
  bool off_owed_ = false;              // somebody asked for darkness, and the bank did not take it
  std::string hang_, heat_, light_;
  std::string off_trouble_;  // what the lamp bank said to the last switch-off
  std::vector<std::string> untold_;  // trips
  Persists power_lost_, contactor_stuck_, motion_stuck_, laser_stuck_;

  SafetyListeners on_stop_, on_trip_;
  RigTime lamps_due_{};  // of the watch, while something may glow
  RigTime calm_lamps_due_{}, off_due_{};
  std::atomic<uint64_t> polls_done_{0};
  std::unique_ptr<LaserGate> gate_;
  std::vector<std::unique_ptr<Axis>> axis_guards_;
  std::vector<Axis*> guarded_axes_;
  std::unique_ptr<LampBank> guarded_lamps_;
  InterlockChain chain_;

  // Of the stop thread, on the host clock.
  mutable std::mutex stop_mutex_;
  std::condition_variable stop_wake_, polled_;
  std::vector<std::shared_ptr<Order>> orders_;
  bool stop_ending_ = false;
  std::chrono::steady_clock::time_point stop_round_;
  std::string runner_;     // who ran at the last look, and for how many looks in a row
  int runner_looks_ = 0;
  std::thread stop_thread_;
  std::unique_ptr<RigThread> watch_;  // begins when everything else is made
};

}  // namespace mesorig::daemon
