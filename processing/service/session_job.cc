#include "processing/service/session_job.h"

#include <grpcpp/grpcpp.h>

#include <set>
#include <utility>

#include "protocol/base/digest.h"
#include "protocol/base/log.h"
#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::service {
namespace {

constexpr auto kRetry = std::chrono::milliseconds(100);
constexpr double kAnswer_s = 10;  // for calls that answer at once

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// The cameras that the plan uses, ascending.
std::vector<int> CamerasOf(const CompiledPlan& plan) {
  std::set<int> cameras;
  for (const Step& step : plan.steps) cameras.insert(step.cameras.begin(), step.cameras.end());
  return {cameras.begin(), cameras.end()};
}

// That the header belongs to these pixels and to this camera of the rig.
Status CheckFrame(const Rig& rig, int camera, uint64_t cursor, const v1::Frame& frame) {
  const v1::FrameHeader& header = frame.header();
  const Camera& expected = rig.cameras[static_cast<size_t>(camera)];
  if (header.camera() != static_cast<uint32_t>(camera)) {
    return DataLoss("a frame of camera {} in the stream of {}", header.camera(), expected.name);
  }
  const std::string name =
      fmt::format("{}, shot {}, sequence {}", expected.name, header.shot(), header.sequence());
  if (header.sequence() <= cursor) return DataLoss("{}: came after sequence {}", name, cursor);
  // Of a sweep's region its builder knows the plan.
  const bool whole = header.has_laser() ||
                     (header.width() == static_cast<uint32_t>(expected.width) &&
                      header.height() == static_cast<uint32_t>(expected.height));
  if (!whole || header.bits() != static_cast<uint32_t>(expected.bits)) {
    return DataLoss("{}: {} x {} pixels of {} bits, the rig says {} x {} of {}", name,
                    header.width(), header.height(), header.bits(), expected.width,
                    expected.height, expected.bits);
  }
  const std::string digest = FrameDigest(frame.pixels());
  if (digest != header.digest()) {
    return DataLoss("{}: its {} bytes have the digest {}, the ledger says {}", name,
                    frame.pixels().size(), digest, header.digest());
  }
  return OkStatus();
}

class SlotGuard {
 public:
  explicit SlotGuard(ComputeSlots& slots) : slots_(slots) { slots_.acquire(); }
  ~SlotGuard() { slots_.release(); }
  SlotGuard(const SlotGuard&) = delete;
  SlotGuard& operator=(const SlotGuard&) = delete;

 private:
  ComputeSlots& slots_;
};

StatusOr<std::unique_ptr<v1::Frames::Stub>> ConnectFrames(const JobOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(const std::string endpoint,
                           wire::LocalEndpoint(options.runtime_dir, wire::kDaemonName,
                                               wire::kProcessingRole));
  return v1::Frames::NewStub(wire::MakeChannel(endpoint));
}

// Whether the other side went away, rather than said no.
bool WentAway(const Status& status) {
  return absl::IsUnavailable(status) || absl::IsCancelled(status) ||
         absl::IsDeadlineExceeded(status);
}

}  // namespace

SessionJob::SessionJob(std::string session_id, JobOptions options, ComputeSlots& slots,
                       std::function<void()> on_change)
    : session_id_(std::move(session_id)),
      options_(std::move(options)),
      slots_(slots),
      on_change_(std::move(on_change)) {
  state_.set_session_id(session_id_);
  thread_ = std::thread([this] { Run(); });
}

SessionJob::~SessionJob() {
  stop_.Stop();
  thread_.join();
}

v1::ProductsReply SessionJob::Snapshot() const {
  MutexLock lock(mutex_);
  v1::ProductsReply reply = state_;
  reply.set_frames_received(received_);
  reply.set_processing_s(busy_s_);
  if (first_frame_ && !reply.done() && !failed_) reply.set_wall_s(SecondsSince(*first_frame_));
  return reply;
}

bool SessionJob::finished() const {
  MutexLock lock(mutex_);
  return failed_ || state_.done();
}

bool SessionJob::failed() const {
  MutexLock lock(mutex_);
  return failed_;
}

uint32_t SessionJob::start() const {
  MutexLock lock(mutex_);
  return start_;
}

void SessionJob::Run() {
  const Status status = Process();
  session_products_.reset();  // with its work file
  if (!status.ok()) Fail(status);
  on_change_();
}

void SessionJob::Fail(const Status& status) {
  std::error_code ignored;  // only if nothing is in it
  std::filesystem::remove(options_.products_dir / session_id_, ignored);
  Log("processing").error("session {}: {}", session_id_, Message(status));
  MutexLock lock(mutex_);
  failed_ = true;
  state_.set_error(std::string(Message(status)));
  if (first_frame_) state_.set_wall_s(SecondsSince(*first_frame_));
}

Status SessionJob::Process() {
  MESORIG_RETURN_IF_ERROR(CheckSessionId(session_id_));
  MESORIG_ASSIGN_OR_RETURN(const v1::SessionReply session, AskSession());
  if (session.ended() && !session.complete()) {
    return FailedPrecondition("the session ended incomplete");
  }
  MESORIG_ASSIGN_OR_RETURN(rig_, ParseRig(session.rig_toml(), "rig of the session"));
  MESORIG_ASSIGN_OR_RETURN(CompiledPlan plan, UnpackPlan(session.plan_bin(), rig_));
  const std::filesystem::path folder = options_.products_dir / session_id_;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return InvalidArgument("cannot create {}: {}", folder.string(), error.message());
  MESORIG_RETURN_IF_ERROR(BeginProducts(folder, session.starts()));
  const std::vector<int> cameras = CamerasOf(plan);
  {
    MutexLock lock(mutex_);
    state_.set_frames_expected(plan.frames);
  }
  Log("processing").info("session {}: {} frames of {} cameras", session_id_, plan.frames, cameras.size());
  MESORIG_ASSIGN_OR_RETURN(session_products_, SessionProducts::Create(rig_, plan, folder));
  ReleaseSweeps();  // of an earlier run
  MESORIG_RETURN_IF_ERROR(ReadAllCameras(cameras));
  MESORIG_ASSIGN_OR_RETURN(const v1::SessionReply complete, AwaitComplete());
  const uint32_t start = complete.starts();
  {
    MutexLock lock(mutex_);
    start_ = start;
  }
  MESORIG_RETURN_IF_ERROR(BeginProducts(folder, start));
  ReleaseSweeps();
  return Pack(complete.audit_head());
}

StatusOr<v1::SessionReply> SessionJob::AskSession() {
  const auto start = Clock::now();
  for (;;) {
    v1::SessionReply reply;
    Status status;
    if (auto stub = ConnectFrames(options_); stub.ok()) {
      Call call(stop_, kAnswer_s);
      v1::SessionRequest request;
      request.set_session_id(session_id_);
      status = wire::FromGrpc((*stub)->GetSession(call.context(), request, &reply));
    } else {
      status = stub.status();
    }
    if (status.ok()) return reply;
    if (!WentAway(status) || SecondsSince(start) > options_.patience_s) return status;
    if (!stop_.SleepFor(kRetry)) return Cancelled("stopped");
  }
}

Status SessionJob::ReadAllCameras(const std::vector<int>& cameras) {
  std::vector<Status> results(cameras.size());
  std::vector<std::thread> readers;
  for (size_t k = 0; k < cameras.size(); ++k) {
    readers.emplace_back([this, &results, &cameras, k] {
      results[k] = ReadCamera(cameras[k]);
      if (!results[k].ok()) stop_.Stop();  // the others need not go on
    });
  }
  for (std::thread& reader : readers) reader.join();
  Status first;
  for (const Status& result : results) {  // what was cancelled is not the cause
    if (!result.ok() && (first.ok() || absl::IsCancelled(first))) first = result;
  }
  MESORIG_RETURN_IF_ERROR(first);
  return session_products_->CheckWhole();
}

void SessionJob::ReleaseSweeps() {
  std::vector<uint32_t> sweeps = session_products_->TakeReleasable();
  {
    MutexLock lock(mutex_);
    to_release_.insert(to_release_.end(), sweeps.begin(), sweeps.end());
    sweeps = std::exchange(to_release_, {});
  }
  for (const uint32_t sweep : sweeps) {
    v1::ReleaseSweepRequest request;
    request.set_session_id(session_id_);
    request.set_sweep(sweep);
    v1::ReleaseSweepReply reply;
    Status status;
    if (auto stub = ConnectFrames(options_); stub.ok()) {
      Call call(stop_, kAnswer_s);
      status = wire::FromGrpc((*stub)->ReleaseSweep(call.context(), request, &reply));
    } else {
      status = stub.status();
    }
    if (status.ok()) {
      Log("processing").info("session {}: sweep {} released, {} bytes freed", session_id_, sweep,
                   reply.bytes_freed());
    } else if (WentAway(status)) {
      MutexLock lock(mutex_);
      to_release_.push_back(sweep);
    } else {
      Log("processing").warn("session {}: sweep {} is not released: {}", session_id_, sweep,
                   Message(status));
    }
  }
}

Status SessionJob::ReadCamera(int camera) {
  uint64_t cursor = 0;
  bool again = false;  // frames of lamps, for their black levels
  auto last_sign = Clock::now();
  for (;;) {
    const Status status = ReadStream(camera, cursor, last_sign, again);
    if (status.ok() && !again && session_products_->NeedsAgain(camera)) {
      Log("processing").info("session {}: camera {}: a dark frame came after frames that need it: once more",
                   session_id_, rig_.cameras[static_cast<size_t>(camera)].name);
      again = true;
      cursor = 0;
      continue;
    }
    if (status.ok()) return status;
    if (stop_.stopped()) return Cancelled("stopped");
    if (!WentAway(status)) return status;
    if (SecondsSince(last_sign) > options_.patience_s) {
      return Unavailable("mesorigd has been away for {:.0f} s: {}", SecondsSince(last_sign),
                         Message(status));
    }
    if (!stop_.SleepFor(kRetry)) return Cancelled("stopped");
  }
}

Status SessionJob::ReadStream(int camera, uint64_t& cursor, Clock::time_point& last_sign,
                              bool lamps_only) {
  MESORIG_ASSIGN_OR_RETURN(const auto stub, ConnectFrames(options_));
  v1::SubscribeRequest request;
  request.set_session_id(session_id_);
  request.set_camera(static_cast<uint32_t>(camera));
  request.set_cursor(cursor);
  Call call(stop_);
  const auto reader = stub->Subscribe(call.context(), request);
  v1::Frame frame;
  Status taken;
  while (taken.ok() && reader->Read(&frame)) {
    taken = CheckFrame(rig_, camera, cursor, frame);
    const bool wanted = !lamps_only || !frame.header().has_laser();
    if (taken.ok() && wanted) taken = Take(camera, frame);
    if (taken.ok()) ReleaseSweeps();
    cursor = std::max(cursor, static_cast<uint64_t>(frame.header().sequence()));
    last_sign = Clock::now();
  }
  if (!taken.ok()) {
    call.context()->TryCancel();
    while (reader->Read(&frame)) continue;
    (void)reader->Finish();
    return taken;
  }
  const Status end = wire::FromGrpc(reader->Finish());
  if (absl::IsAborted(end)) {
    return FailedPrecondition("the session ended incomplete: {}", Message(end));
  }
  return end;
}

Status SessionJob::Take(int camera, const v1::Frame& frame) {
  const SlotGuard slot(slots_);
  if (stop_.stopped()) return Cancelled("stopped");
  const auto start = Clock::now();
  {
    MutexLock lock(mutex_);
    if (!first_frame_) first_frame_ = start;
  }
  const Status status = session_products_->Take(frame);
  const uint32_t progress = session_products_->progress();
  const double seconds = SecondsSince(start);
  MutexLock lock(mutex_);
  busy_s_ += seconds;
  if (status.ok()) received_ = std::max(received_, progress);
  return Annotate(status, rig_.cameras[static_cast<size_t>(camera)].name);
}

// A stream ends with OK when its camera has no more frames; whether the ledger balances is the
// daemon's to say. Returns the start that it was complete with.
StatusOr<v1::SessionReply> SessionJob::AwaitComplete() {
  const auto start = Clock::now();
  for (;;) {
    MESORIG_ASSIGN_OR_RETURN(v1::SessionReply session, AskSession());
    if (session.ended() && session.complete()) return session;
    if (session.ended()) return FailedPrecondition("the session ended incomplete");
    if (SecondsSince(start) > options_.patience_s) {
      return FailedPrecondition("every frame is here, but the session has not ended");
    }
    if (!stop_.SleepFor(kRetry)) return Cancelled("stopped");
  }
}

Status SessionJob::Pack(const std::string& audit_head) {
  const auto start = Clock::now();
  std::optional<SlotGuard> slot(slots_);
  MESORIG_ASSIGN_OR_RETURN(const std::vector<v1::Product> products,
                           session_products_->Pack(session_id_, audit_head));
  slot.reset();
  MutexLock lock(mutex_);
  busy_s_ += SecondsSince(start);
  if (first_frame_) state_.set_wall_s(SecondsSince(*first_frame_));
  for (const v1::Product& product : products) *state_.add_products() = product;
  state_.set_done(true);
  Log("processing").info("session {}: packed, {:.2f} s of work", session_id_, busy_s_);
  return OkStatus();
}

}  // namespace mesorig::service
