#pragma once
// Internal to daemon/control: manual control's thread and what it is told. manual_control.cc has
// the fence and the orders, of any thread; manual_motion.cc what its own thread does with them.

#include <deque>
#include <optional>
#include <utility>

#include "daemon/control/manual_control.h"
#include "daemon/device/rig_thread.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

enum class ManualKind { kJog, kMove, kHome, kLamp, kLaser };

// What somebody asked for, until the manual thread has done it.
struct ManualOrder {
  ManualKind kind{};
  uint64_t token = 0, stops = 0;
  int index = -1;    // axis or lamp
  double value = 0;  // rad, rad/s, s
  std::shared_ptr<std::promise<Status>> done = std::make_shared<std::promise<Status>>();
};

class ManualControlImpl final : public ManualControl {
 public:
  ManualControlImpl(RigClock& clock, const Rig& rig, ManualDevices devices)
      : clock_(clock),
        rig_(rig),
        devices_(std::move(devices)),
        touched_(devices_.axes.size()),
        axis_read_(devices_.axes.size()),
        axis_commanded_(devices_.axes.size()),
        thread_(clock, "manual control", [this] { Loop(); }) {
    if (devices_.safety == nullptr) return;
    stops_heard_ = devices_.safety->OnStop([this](std::string_view why) { Stop(why); });
    trips_heard_ = devices_.safety->OnTrip([this](std::string_view why) { Stop(why); });
  }
  ~ManualControlImpl() override {
    clock_.Change([&] { ending_ = true; });
  }

  void Admit(uint64_t token) override;
  void Close(uint64_t newest, std::string_view why) override;
  Status AwaitRest(double host_s) override;
  void Stop(std::string_view reason) override;
  Status Jog(uint64_t token, int axis, double rate_rad_s) override;
  std::future<Status> MoveTo(uint64_t token, int axis, double target_rad) override;
  std::future<Status> Home(uint64_t token, int axis) override;
  std::future<Status> SetLamp(uint64_t token, int lamp) override;
  std::future<Status> TestLaser(uint64_t token, double seconds) override;
  ManualStatus GetStatus() const override;
  void OnNote(std::function<void(const std::string&)> listener) override {
    const MutexLock lock(listener_mutex_);
    listener_ = std::move(listener);
  }

 private:
  struct JogHold {
    int axis = -1;
    double rate_rad_s = 0;
    RigTime until{};
  };

  // Under the clock's lock.
  Status CheckTokenInsideChange(uint64_t token) const;
  Status CheckOrderInsideChange(const ManualOrder& order) const;
  void EndAllInsideChange(std::string_view why);
  bool LitInsideChange() const { return lamp_commanded_ && lamp_commanded_->value > 0; }
  bool WorksInsideChange() const;  // something is on by hand, or ordered
  std::future<Status> Give(ManualOrder order, Status valid);
  Status CheckAxis(int axis) const;

  // Of the manual thread.
  void Loop();
  Status Serve(const ManualOrder& order);
  bool LeftOn() const;
  void SetDoing(std::string doing);
  void Tell(const std::string& note);
  // Just before each command to a device: the order is still to be carried out.
  Status Admitted(const ManualOrder& order);
  Status PowerUp(const ManualOrder& order);
  Status RunMove(const ManualOrder& order);
  Status RunHome(const ManualOrder& order);
  Status RunJog(const ManualOrder& order);
  Status StartJog(const ManualOrder& order, double rate_rad_s);
  Status SwitchLamp(const ManualOrder& order);
  Status ShineLaser(const ManualOrder& order);
  Status AwaitSlices(const std::function<Status(RigTime)>& await, RigTime deadline);
  void StopAxis(int axis);
  void NoteAxis(int axis);
  void NoteCommanded(std::optional<Reading>& slot, Reading reading);
  void MakeSafe();

  RigClock& clock_;
  const Rig& rig_;
  const ManualDevices devices_;
  std::vector<bool> touched_;  // axes that got torque; of the manual thread

  // Guarded by the clock's lock:
  bool open_ = false, off_wanted_ = false, at_rest_ = true, ending_ = false;
  uint64_t newest_ = 0, stops_ = 0;
  std::string stopped_why_;  // the last stop's
  bool stop_untold_ = false;  // it ended something, and the note is not out
  std::deque<ManualOrder> orders_;
  std::string doing_;
  JogHold jog_;
  Status jog_failure_;  // of the newest lease's last jog, for its next call
  RigTime jog_failed_at_{};
  std::vector<std::optional<Reading>> axis_read_, axis_commanded_;
  std::optional<Reading> lamp_commanded_, laser_commanded_;

  mutable Mutex rest_mutex_;
  CondVar rested_;
  mutable Mutex listener_mutex_;
  std::function<void(const std::string&)> listener_ GUARDED_BY(listener_mutex_);
  RigThread thread_;
  Listening stops_heard_, trips_heard_;
};

}  // namespace mesorig::daemon
