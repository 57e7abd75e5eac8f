#pragma once
// The small rig for long virtual times: slow axes and slow signs of life, so that a day costs
// seconds; its simulator, drivers and sequencer; and the faults that befall it.

#include <condition_variable>
#include <mutex>
#include <random>

#include "tests/daemon/fakes/sim_bench.h"

namespace mesorig::daemon {

Rig MakeSoakRig();

// Injections over `virtual_s` from `begin_s` on: a fault about every `every_s`, and what mends it
// some seconds later.
std::vector<sim_wire::TimedInjection> MakeSoakFaults(std::mt19937& random, double begin_s,
                                                     double virtual_s, double every_s);

class SoakRig {
 public:
  explicit SoakRig(std::vector<sim_wire::TimedInjection> faults);

  ~SoakRig() { bench_.sequencer->OnEvent(nullptr); }

  const Rig& rig() const { return bench_.rig; }
  Sequencer& sequencer() { return *bench_.sequencer; }
  double now_s() const { return Seconds(bench_.end.link->Now()); }
  // Lets the rig live on without a session.
  void Idle(double seconds);
  // A hand at the rig closes what is open and presses reset.
  void CloseChain();
  // What is on, or moves, although it should not; empty: nothing.
  std::string StillOn();
  // The largest difference between what a drive says and where its axis is.
  double PositionError();

  // Waits at most a minute of host time. `count`: of the events of this kind since Forget. False: not
  // that many, or the session ended without them.
  bool Await(SequencerEvent::Kind kind, uint32_t count);
  bool AwaitState(SequencerState state);
  void Forget();
  SequencerEvent end() const;
  uint32_t recoveries() const;

 private:
  void Hear(const SequencerEvent& event);

  mutable std::mutex mutex_;
  std::condition_variable heard_;
  std::map<SequencerEvent::Kind, uint32_t> counts_;
  SequencerEvent end_event_;
  uint32_t recoveries_ = 0;
  SimBench bench_;
};

}  // namespace mesorig::daemon
