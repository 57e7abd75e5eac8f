#include "daemon/control/plan_run.h"

#include <algorithm>

#include "daemon/control/metering.h"
#include "daemon/control/operator_visit.h"
#include "daemon/control/picture.h"

namespace mesorig::daemon {
namespace {

constexpr int kShotAttempts = 3;
constexpr int kPasses = 3;
constexpr double kReferenceLimit = 0.05;

}  // namespace

PlanRun::PlanRun(const RunContext& context, ReferenceCheck reference)
    : context_(context),
      stance_(context),
      cameras_(context),
      power_(context, stance_, cameras_),
      book_(context),
      sweeps_(context, stance_, cameras_, book_),
      reference_(reference) {}

// What the session says when it will take frames again once the disk does.
bool PlanRun::DiskTakesNothing(const Status& status) const {
  return (absl::IsUnavailable(status) || absl::IsResourceExhausted(status)) &&
         !context_.session.Storage().ok();
}

RunResult PlanRun::Go() {
  end_.reset();
  book_.TrySession();
  Status status = SafeStep();  // before anything is switched on
  if (status.ok()) status = AllPasses();
  if (status.ok() && !end_) return {};
  if (book_.session_broken()) {
    end_ = DiskTakesNothing(status) ? RunEnd::kStorage : RunEnd::kSession;
  }
  return {end_.value_or(RunEnd::kFailed), status};
}

// Frames that turn out damaged on the disk are taken again.
Status PlanRun::AllPasses() {
  bool up = false;
  for (int pass = 0; pass < kPasses; ++pass) {
    if (book_.ShotsOwed() > 0) {
      if (!up) MESORIG_RETURN_IF_ERROR(Prepare());
      up = true;
      MESORIG_RETURN_IF_ERROR(Walk());
      if (end_) return OkStatus();
    }
    Status written = context_.session.Flush();
    if (written.ok()) {
      const auto damaged = context_.session.DropDamaged();
      written = damaged.status();
      if (damaged.ok() && *damaged > 0) {
        context_.on_note(fmt::format("{} frames are damaged on the disk", *damaged));
      }
    }
    if (!written.ok()) {
      end_ = DiskTakesNothing(written) ? RunEnd::kStorage : RunEnd::kSession;
      return written;
    }
    book_.Recount();
    if (book_.ShotsOwed() == 0) return Close(up);
  }
  end_ = RunEnd::kSession;
  return DataLoss("{} shots miss frames still, after {} passes over the plan", book_.ShotsOwed(),
                  kPasses);
}

Status PlanRun::Close(bool up) {
  if (up) MESORIG_RETURN_IF_ERROR(power_.Down());
  const Step& last = context_.plan.steps.back();  // (a plan without steps is none)
  if (last.kind != StepKind::kPrompt || &last == answered_) return OkStatus();
  MESORIG_RETURN_IF_ERROR(book_.Record(JournalKind::kPrompt, -1, 0, last.text));
  MESORIG_RETURN_IF_ERROR(AskAtRest(context_, last.text, ""));
  answered_ = &last;
  return book_.Record(JournalKind::kContinued, -1, 0, last.text);
}

Status PlanRun::Prepare() {
  const RigTime start = context_.clock.Now();
  // A kill may have moved the axes of a session that is resumed.
  const bool all = reference_.wanted && !homed_all_;
  Status status = power_.Up(all ? HomeWhich::kAll : HomeWhich::kUnreferenced);
  if (status.ok()) {
    homed_all_ = true;
    // A laser unit that was off has lost its zero: the mount is asked for again.
    if (mount_ >= 0 && absl::IsUnavailable(context_.devices.laser->Read().status())) mount_ = -1;
    if (!failure_.empty()) status = book_.Record(JournalKind::kRecovered, -1, 0, failure_);
    failure_.clear();
  }
  if (status.ok() && reference_.wanted) status = CheckReference();
  preparation_s_ += Seconds(context_.clock.Now() - start);
  return status;
}

void PlanRun::Fold(const Step& step, Place& place) {
  switch (step.kind) {
    case StepKind::kMoveAxes:
      place.stance.axis_rad = step.axis_rad;
      place.stance.settle_s = step.settle_s;
      return;
    case StepKind::kLamp:
      place.stance.lamp = step.lamp;
      return;
    case StepKind::kMount:
      place.mount = step.sweep.mount;
      return;
    case StepKind::kPrompt:
      place.prompt = &step;
      return;
    case StepKind::kShot:
    case StepKind::kSweep:
    case StepKind::kMeter:
      return;
  }
}

bool PlanRun::Wants(const Step& step) const {
  if (step.kind != StepKind::kMeter) return book_.OwesAnything(step);
  if (context_.session.MeteredExposure(step.meter)) return false;
  return std::any_of(context_.plan.steps.begin(), context_.plan.steps.end(), [&](const Step& shot) {
    return shot.meter == step.meter && book_.OwesAnything(shot);
  });
}

Status PlanRun::Walk() {
  Place place;
  for (size_t i = 0; i < context_.plan.steps.size(); ++i) {
    const Step& step = context_.plan.steps[i];
    Fold(step, place);
    if (!Wants(step)) continue;
    MESORIG_RETURN_IF_ERROR(SafeStep());
    if (end_) return OkStatus();
    if (NeedsVisit(step, place)) {
      MESORIG_RETURN_IF_ERROR(Visit(step, place));
      MESORIG_RETURN_IF_ERROR(SafeStep());
      if (end_) return OkStatus();
    }
    MESORIG_RETURN_IF_ERROR(TakeStep(i, place));
  }
  return OkStatus();
}

// Between shots: here a run may pause.
Status PlanRun::SafeStep() {
  context_.safety.Alive();
  MESORIG_RETURN_IF_ERROR(context_.chain.Check());
  context_.board.SetChain(context_.chain.levels());
  MESORIG_RETURN_IF_ERROR(context_.devices.stop->Check());
  if (context_.machine.order() == RunOrder::kPause) end_ = RunEnd::kPause;
  if (const Status storage = context_.session.Storage(); !end_ && !storage.ok()) {
    end_ = RunEnd::kStorage;
    return storage;
  }
  if (!end_ && homed_all_ && context_.sweeps()) return context_.devices.laser->KeepAlive();
  return OkStatus();
}

bool PlanRun::NeedsVisit(const Step& step, const Place& place) const {
  if (place.prompt != nullptr && place.prompt != answered_) return true;
  return step.kind == StepKind::kSweep && place.mount != mount_;
}

Status PlanRun::Visit(const Step& step, const Place& place) {
  if (place.prompt != nullptr && place.prompt != answered_) {
    MESORIG_RETURN_IF_ERROR(book_.Record(JournalKind::kPrompt, -1, 0, place.prompt->text));
    MESORIG_RETURN_IF_ERROR(VisitRig(context_, power_, cameras_, place.prompt->text, ""));
    answered_ = place.prompt;
    MESORIG_RETURN_IF_ERROR(book_.Record(JournalKind::kContinued, -1, 0, place.prompt->text));
  }
  if (step.kind != StepKind::kSweep || place.mount == mount_) return OkStatus();
  if (!context_.has_laser()) {
    end_ = RunEnd::kRefused;
    return FailedPrecondition("plan {}: the rig has no laser unit", context_.plan.name);
  }
  const std::string& name = context_.rig.laser->mounts[place.mount].name;
  mount_ = -1;
  MESORIG_RETURN_IF_ERROR(book_.Record(JournalKind::kPrompt, place.mount, 0, name));
  MESORIG_RETURN_IF_ERROR(VisitRig(
      context_, power_, cameras_,
      fmt::format("Mount the laser at \"{}\" and line its stripe up with the turntable's centre. "
                  "Then close the door and press reset.",
                  name),
      name));
  MESORIG_RETURN_IF_ERROR(context_.devices.laser->Open());
  MESORIG_RETURN_IF_ERROR(context_.devices.laser->MarkZero());
  mount_ = place.mount;
  return book_.Record(JournalKind::kContinued, place.mount, 0, name);
}

Status PlanRun::TakeStep(size_t index, const Place& place) {
  const Step& step = context_.plan.steps[index];
  if (step.kind == StepKind::kShot) return TakeShot(index, place);
  if (step.kind == StepKind::kMeter) {
    MESORIG_RETURN_IF_ERROR(stance_.Reach(place.stance));
    return Meter(context_, cameras_, book_, step);
  }
  if (step.sweep.mount != mount_) {
    end_ = RunEnd::kRefused;
    return FailedPrecondition("plan {}: sweep {} is of mount {}, the laser is at {}",
                              context_.plan.name, step.sweep.index, step.sweep.mount, mount_);
  }
  return sweeps_.Take(step, place.stance);
}

StatusOr<double> PlanRun::ExposureOf(const Step& step) const {
  if (step.meter < 0) return step.exposure_s;
  const auto metered = context_.session.MeteredExposure(step.meter);
  if (metered) return *metered;
  return InvalidArgument("plan {}: shot {} takes the exposure of metering {}, which never ran",
                         context_.plan.name, step.shot, step.meter);
}

Status PlanRun::TakeShot(size_t index, const Place& place) {
  const Step& step = context_.plan.steps[index];
  MESORIG_ASSIGN_OR_RETURN(const double exposure_s, ExposureOf(step));
  MESORIG_RETURN_IF_ERROR(cameras_.Configure(step.cameras, exposure_s, {}, step.repeat));
  std::vector<int> pending = book_.Owed(step);
  MESORIG_RETURN_IF_ERROR(stance_.Begin(place.stance));
  MESORIG_RETURN_IF_ERROR(cameras_.WarmUp(pending));
  Status missing;
  for (int attempt = 0; attempt < kShotAttempts; ++attempt) {
    MESORIG_RETURN_IF_ERROR(ShootOnce(index, place, exposure_s, pending, missing));
    if (pending.empty()) {
      book_.ShotDone();
      return OkStatus();
    }
    context_.on_note(
        fmt::format("shot {}, attempt {}: {}", step.shot, attempt + 1, Message(missing)));
  }
  return Unavailable("shot {}: no frame after {} triggers: {}", step.shot, kShotAttempts,
                     Message(missing));
}

Status PlanRun::ShootOnce(size_t index, const Place& place, double exposure_s,
                          std::vector<int>& cameras, Status& missing) {
  const Step& step = context_.plan.steps[index];
  MESORIG_RETURN_IF_ERROR(stance_.Reach(place.stance));
  MESORIG_ASSIGN_OR_RETURN(auto levels, stance_.ReadLevels());
  MESORIG_RETURN_IF_ERROR(stance_.CheckLit(levels));
  MESORIG_RETURN_IF_ERROR(stance_.CheckHolds());
  book_.SetReadBack(stance_.ReadAxes(), levels);
  MESORIG_RETURN_IF_ERROR(cameras_.Trigger(cameras));
  const RigTime deadline = cameras_.Deadline(cameras);
  const Status exposed =
      context_.devices.stop->Wait(cameras_.ExposureEnd(cameras), [] { return false; });
  if (absl::IsCancelled(exposed)) return exposed;
  MESORIG_RETURN_IF_ERROR(stance_.CheckHolds());  // it stood through the exposure, and shone
  MESORIG_ASSIGN_OR_RETURN(levels, stance_.ReadLevels());
  MESORIG_RETURN_IF_ERROR(stance_.CheckLit(levels));
  // From here on the rig is on its way to the next shot, while the cameras read out.
  const Status approach = ApproachNext(index, place);
  const auto take = [&](int camera, const CapturedFrame& frame) {
    const Status kept = book_.Append(
        book_.MakeRecord(step, exposure_s, cameras_.region(camera), frame, camera), frame);
    return kept.ok() ? book_.Judge(step, place.stance.lamp, camera, frame) : kept;
  };
  MESORIG_RETURN_IF_ERROR(cameras_.Collect(deadline, cameras, missing, take));
  return approach;
}

Status PlanRun::ApproachNext(size_t index, Place place) {
  if (context_.machine.order() != RunOrder::kNone) return OkStatus();
  for (size_t i = index + 1; i < context_.plan.steps.size(); ++i) {
    const Step& step = context_.plan.steps[i];
    Fold(step, place);
    if (!Wants(step)) continue;
    return NeedsVisit(step, place) ? OkStatus() : stance_.Begin(place.stance);
  }
  return OkStatus();
}

// The rig and the sample are still what they were: the last frame, taken again, looks the same.
Status PlanRun::CheckReference() {
  MESORIG_ASSIGN_OR_RETURN(const auto reference, context_.session.Reference());
  Place place;
  for (const Step& step : context_.plan.steps) {
    if (!reference) break;
    Fold(step, place);
    if (step.kind != StepKind::kShot || step.shot != reference->record.shot) continue;
    if (step.purpose != Purpose::kData) break;  // the operator's hands would be needed
    MESORIG_RETURN_IF_ERROR(ShootReference(step, place, *reference));
    reference_.wanted = false;
    return OkStatus();
  }
  reference_.wanted = false;
  context_.on_note("resumed without a reference: no frame of a lamp was there to compare with");
  return OkStatus();
}

Status PlanRun::ShootReference(const Step& step, const Place& place, const StoredFrame& reference) {
  const int camera = reference.record.camera;
  const mesorig::Camera& description = context_.rig.cameras[camera];
  std::vector<int> pending = {camera};
  MESORIG_RETURN_IF_ERROR(
      cameras_.Configure(pending, reference.record.exposure_s, {}, step.repeat));
  MESORIG_RETURN_IF_ERROR(stance_.Begin(place.stance));
  MESORIG_RETURN_IF_ERROR(cameras_.WarmUp(pending));
  MESORIG_RETURN_IF_ERROR(stance_.Reach(place.stance));
  Status missing;
  StatusOr<double> difference = 0.0;
  for (int attempt = 0; attempt < kShotAttempts && !pending.empty(); ++attempt) {
    MESORIG_RETURN_IF_ERROR(cameras_.Trigger(pending));
    MESORIG_RETURN_IF_ERROR(cameras_.Collect(
        cameras_.Deadline(pending), pending, missing, [&](int, const CapturedFrame& frame) {
          difference = RelativeDifference(description, *reference.pixels, *frame.pixels);
          return difference.status();
        }));
  }
  if (!pending.empty()) return missing;
  MESORIG_RETURN_IF_ERROR(book_.Record(JournalKind::kReference, camera, *difference,
                                       fmt::format("shot {}", step.shot)));
  if (*difference < kReferenceLimit) return OkStatus();
  const Status other = FailedPrecondition(
      "reference frame (shot {}, camera {}): it differs from the one on the disk by {:.1f} %, "
      "permitted is below {:.0f} %: is it the same sample, and does it lie as it did?",
      step.shot, description.name, 100 * *difference, 100 * kReferenceLimit);
  if (reference_.accept_any) {
    context_.on_note(fmt::format("accepted by the operator: {}", Message(other)));
    return OkStatus();
  }
  end_ = RunEnd::kRefused;
  return other;
}

}  // namespace mesorig::daemon
