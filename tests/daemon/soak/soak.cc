#include "tests/daemon/soak/soak.h"

#include <atomic>
#include <nlohmann/json.hpp>
#include <thread>

#include "daemon/service/audit_log.h"
#include "daemon/service/lease_keeper.h"
#include "daemon/session/verify.h"
#include "protocol/base/digest.h"
#include "protocol/base/hash_chain.h"
#include "tests/daemon/soak/soak_rig.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
using Kind = SequencerEvent::Kind;

constexpr size_t kMaxViolations = 20;

// Reads all frames of a session while it grows, each once. Its reader dies now and then; the next
// one, another thread, has nothing but the cursors.
class SoakConsumer {
 public:
  SoakConsumer(std::shared_ptr<Session> session, int cameras, uint32_t seed)
      : session_(std::move(session)), cursors_(static_cast<size_t>(cameras)), random_(seed) {
    thread_ = std::thread([this] { Run(); });
  }
  // Everything that is durable has been read.
  void Finish() {
    ended_ = true;
    thread_.join();
  }
  uint64_t frames = 0;
  uint32_t restarts = 0;
  std::string wrong;

 private:
  void Run() {
    while (!done_) {
      const uint32_t rounds = 1 + random_() % 32;
      std::thread([this, rounds] { Read(rounds); }).join();
      if (!done_) ++restarts;
    }
  }
  void Read(uint32_t rounds) {
    for (uint32_t i = 0; i < rounds && !done_; ++i) {
      // (Looked at before the frames.)
      const bool last = ended_ || session_->Summary().end != SessionEnd::kOpen;
      done_ = !ReadRound() && last;
    }
  }
  // One frame of each camera; false: there was none.
  bool ReadRound() {
    bool more = false;
    for (size_t camera = 0; camera < cursors_.size(); ++camera) {
      const auto next = session_->Next(static_cast<int>(camera), cursors_[camera], 5);
      if (!next.ok()) {
        wrong = Message(next.status());
        ended_ = true;
        return false;
      }
      if (!*next) continue;
      more = true;
      const FrameRecord& record = (*next)->record;
      if (record.sequence <= cursors_[camera]) wrong = "a frame twice";
      cursors_[camera] = record.sequence;
      ++frames;
      if (FrameDigest(*(*next)->pixels) != record.digest) wrong = "a frame that is damaged";
    }
    return more;
  }
  const std::shared_ptr<Session> session_;
  std::vector<uint64_t> cursors_;
  std::mt19937 random_;
  std::atomic<bool> ended_{false};
  bool done_ = false;  // of one reader at a time
  std::thread thread_;
};

class Soak {
 public:
  Soak(const std::filesystem::path& root, const SoakOptions& options)
      : root_(root),
        options_(options),
        random_(options.seed),
        faults_(MakeSoakFaults(random_, 3 * options.cycle_s, options.virtual_s,
                               options.cycle_s / 12)),
        rig_(faults_),
        plan_(SmallPlan(rig_.rig())) {
    report_.injections = static_cast<uint32_t>(faults_.size());
    AuditOptions audit;
    audit.anchor = [](std::string_view) {};
    audit_ = AuditLog::Open(root, audit).value();
    keeper_ = LeaseKeeper::Open(root, {[](uint64_t) {}, [](uint64_t) {},
                                       [this](const LeaseChange& change) { Note(change); }})
                  .value();
  }

  SoakReport Run() {
    const auto began = HostClock::now();
    const double cpu_s = ReadProcessFigures().cpu_s;
    for (double at_s = 0; at_s < options_.virtual_s && !hangs_; at_s += options_.cycle_s) {
      OneSession();
      if (const double left_s = at_s + options_.cycle_s - rig_.now_s(); left_s > 0) {
        rig_.Idle(left_s);
      }
      if (const std::string on = rig_.StillOn(); !on.empty()) Violate("still on: " + on);
      report_.samples.push_back(ReadProcessFigures());
    }
    report_.virtual_s = rig_.now_s();
    report_.recoveries = rig_.recoveries();
    report_.lease_changes = changes_;
    CheckAudit();
    report_.host_s = std::chrono::duration<double>(HostClock::now() - began).count();
    report_.cpu_s = ReadProcessFigures().cpu_s - cpu_s;
    return std::move(report_);
  }

 private:
  void Violate(std::string what) {
    if (report_.violations.size() < kMaxViolations) {
      report_.violations.push_back(
          fmt::format("session {} at {:.1f} s: {}", report_.sessions, rig_.now_s(), what));
    }
  }
  bool Chance(uint32_t percent) { return random_() % 100 < percent; }
  void Note(const LeaseChange& change) {
    ++changes_;
    audit_->RecordLater({Caller{Role::kOperator, change.holder, "unix", ""},
                         fmt::format("lease/{}", Name(change.kind)), "", "OK"});
  }

  // Somebody has the lease, sometimes another one asks for it, and the run takes it over.
  uint64_t TakeLease() {
    const std::array<const char*, 3> names = {"anna", "ben", "cleo"};
    const Caller first{Role::kOperator, names[random_() % 3], "unix", ""};
    const Caller second{Role::kOperator, names[random_() % 3], "unix", ""};
    const auto token = keeper_->Acquire(first, std::chrono::milliseconds(60'000), false);
    if (!token.ok()) {
      Violate(fmt::format("lease: {}", Message(token.status())));
      return 0;
    }
    const Caller* holder = &first;
    uint64_t held = *token;
    if (second.name != first.name && Chance(50)) {
      if (keeper_->Acquire(second, {}, false).ok()) Violate("two have the lease");
      if (!keeper_->Request(second).ok() || !keeper_->Release(first, held).ok()) {
        Violate("the lease is not handed over");
      }
      const auto next = keeper_->Acquire(second, {}, false);
      if (!next.ok() || *next <= held) Violate("the next lease");
      if (keeper_->Check(first, held).ok()) Violate("an old token is good");
      held = next.value_or(0);
      holder = &second;
    }
    const auto run = keeper_->BeginRun(*holder, held);
    if (!run.ok()) Violate(fmt::format("the run's lease: {}", Message(run.status())));
    return run.value_or(0);
  }

  void OneSession() {
    ++report_.sessions;
    const uint64_t lease = TakeLease();
    auto session = Session::Create(root_ / "sessions", plan_, rig_.rig());
    if (!session.ok()) return Violate(fmt::format("create: {}", Message(session.status())));
    const std::string id = (*session)->id();
    Record("Control/Run", id);
    bool complete = RunOnce(SequencerCommand::kRun, *session, false);
    session->reset();
    for (int i = 0; i < 2 && !complete && !hangs_ && began_ && Chance(50); ++i) {
      complete = ResumeOnce(id);
    }
    keeper_->EndRun(lease);
    Record("daemon/ended", complete ? "complete" : "incomplete");
    ++(complete ? report_.complete : report_.incomplete);
    if (complete) CheckComplete(id);
    if (!hangs_) Remove(root_ / "sessions" / id);
  }

  // The sequencer lets go of a session a moment after it told its end, and closes its files then.
  void Remove(const std::filesystem::path& session) {
    std::error_code error;
    for (int attempt = 0; attempt < 100; ++attempt) {
      std::filesystem::remove_all(session, error);
      if (!error && !std::filesystem::exists(session)) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    Violate(fmt::format("{}: {}", session.string(), error.message()));
  }

  bool ResumeOnce(const std::string& id) {
    auto session = Session::Resume(root_ / "sessions", id, rig_.rig());
    if (!session.ok()) {
      Violate(fmt::format("resume: {}", Message(session.status())));
      return false;
    }
    ++report_.resumed;
    Record("Control/ResumeSession", id);
    return RunOnce(SequencerCommand::kResume, *session, true);
  }

  // True: complete.
  bool RunOnce(SequencerCommand how, const std::shared_ptr<Session>& session, bool resumed) {
    rig_.Forget();
    SoakConsumer consumer(session, static_cast<int>(rig_.rig().cameras.size()), static_cast<uint32_t>(random_()));
    SessionJob job;
    job.plan = plan_;
    job.session = session;
    job.resumed = resumed;
    Status begun = rig_.sequencer().Begin(how, job);
    if (!begun.ok()) {  // the chain is open
      rig_.CloseChain();
      begun = rig_.sequencer().Begin(how, std::move(job));
    }
    job = {};
    began_ = begun.ok();
    if (!begun.ok()) {
      ++report_.refused;
      (void)session->Finish(false, Message(begun), 0, 0, true);
    } else {
      Meddle();
      hangs_ = !rig_.Await(Kind::kEnded, 1);
      if (hangs_) Violate("hangs: " + rig_.sequencer().GetStatus().message);
    }
    consumer.Finish();
    CheckConsumer(consumer, *session);
    if (hangs_) return false;
    if (rig_.sequencer().GetStatus().state == SequencerState::kFault) {
      (void)rig_.sequencer().Command(SequencerCommand::kReset, "");
    }
    return begun.ok() && rig_.end().complete;
  }

  // What people do while a session runs.
  void Meddle() {
    const auto what = static_cast<uint32_t>(random_() % 100);
    if (what >= 30) return;
    if (!rig_.Await(what % 2 == 0 ? Kind::kStarted : Kind::kProgress, 1)) return;
    Sequencer& sequencer = rig_.sequencer();
    if (what < 10) {
      ++report_.stops;
      audit_->RecordLater({Caller{Role::kObserver, "dora", "unix", ""}, "Control/Stop", "", "OK"});
      (void)sequencer.Stop("enough");
    } else if (what < 15) {
      ++report_.aborts;
      (void)sequencer.Command(SequencerCommand::kAbort, "enough");
    } else if (sequencer.Command(SequencerCommand::kPause, "coffee").ok()) {
      ++report_.pauses;
      (void)rig_.AwaitState(SequencerState::kPaused);
      if (sequencer.Command(SequencerCommand::kContinue, "").ok()) return;
      rig_.CloseChain();
      if (sequencer.Command(SequencerCommand::kContinue, "").ok()) return;
      (void)sequencer.Stop("cannot go on");
    }
  }

  void Record(const char* call, std::string what) {
    const Status recorded = audit_->Record(
        {Caller{Role::kOperator, "anna", "unix", ""}, call, std::move(what), "OK"});
    if (!recorded.ok()) Violate(fmt::format("audit: {}", Message(recorded)));
  }

  void CheckConsumer(const SoakConsumer& consumer, const Session& session) {
    report_.consumer_restarts += consumer.restarts;
    report_.frames_read += consumer.frames;
    const uint32_t durable = session.Summary().frames_durable;
    report_.frames_acknowledged += durable;
    if (!consumer.wrong.empty()) Violate("consumer: " + consumer.wrong);
    if (consumer.frames != durable) {
      Violate(fmt::format("{} frames acknowledged, {} read", durable, consumer.frames));
    }
  }

  void CheckComplete(const std::string& id) {
    const auto verified =
        VerifySession(root_ / "sessions", id, [](uint32_t, uint32_t) { return true; });
    if (!verified.ok()) return Violate(fmt::format("verify: {}", Message(verified.status())));
    if (!verified->imbalances.empty()) {
      Violate(fmt::format("ledger: {}", verified->imbalances.front().first));
    }
    if (content_.empty()) content_ = verified->content_digest;
    if (verified->content_digest == content_) {
      ++report_.equal_sessions;
    } else {
      Violate("its frames are not those of the first session");
    }
    report_.worst_position_error_rad =
        std::max(report_.worst_position_error_rad, rig_.PositionError());
  }

  void CheckAudit() {
    audit_.reset();  // writes what waits
    const auto chain = VerifyChainFile(root_ / kAuditFile);
    if (!chain.ok()) return Violate(fmt::format("audit: {}", Message(chain.status())));
    report_.audit_entries = chain->head.sequence;
    if (!chain->ok() || chain->torn_bytes > 0) Violate("audit: " + chain->wrong);
  }

  const std::filesystem::path root_;
  const SoakOptions options_;
  std::mt19937 random_;
  const std::vector<sim_wire::TimedInjection> faults_;
  SoakReport report_;
  std::atomic<uint32_t> changes_{0};
  std::unique_ptr<AuditLog> audit_;
  std::unique_ptr<LeaseKeeper> keeper_;
  SoakRig rig_;
  const CompiledPlan plan_;
  std::string content_;  // digest of the first complete session
  bool began_ = false, hangs_ = false;
};

}  // namespace

SoakReport RunSoak(const std::filesystem::path& root, const SoakOptions& options) {
  std::filesystem::create_directories(root / "sessions");
  return Soak(root, options).Run();
}

std::string SoakReport::Text() const {
  const auto mb = [](uint64_t bytes) { return static_cast<double>(bytes) / 1e6; };
  std::string text = fmt::format(
      "virtual {:.2f} days in {:.1f} s of host time, {:.1f} s of CPU\n"
      "sessions {}: complete {} (equal {}), incomplete {}, refused {}, resumed {} times\n"
      "injections {}, recoveries {}, stops {}, aborts {}, pauses {}\n"
      "lease changes {}, consumer restarts {}, audit entries {}\n"
      "frames acknowledged {}, read by consumers {}\n"
      "worst position error {:.2e} rad\n",
      virtual_s / 86400, host_s, cpu_s, sessions, complete, equal_sessions, incomplete, refused,
      resumed, injections, recoveries, stops, aborts, pauses, lease_changes, consumer_restarts,
      audit_entries, frames_acknowledged, frames_read, worst_position_error_rad);
  if (!samples.empty()) {
    text += fmt::format("after a quarter / at the end: {:.1f} / {:.1f} MB, {} / {} threads, {} / "
                        "{} descriptors\n",
                        mb(settled().resident_bytes), mb(last().resident_bytes), settled().threads,
                        last().threads, settled().open_files, last().open_files);
  }
  for (const std::string& violation : violations) text += "VIOLATION " + violation + '\n';
  return text;
}

std::string SoakReport::Json() const {
  nlohmann::ordered_json json = {{"virtual_s", virtual_s},
                                 {"host_s", host_s},
                                 {"cpu_s", cpu_s},
                                 {"sessions", sessions},
                                 {"complete", complete},
                                 {"equal_sessions", equal_sessions},
                                 {"incomplete", incomplete},
                                 {"refused", refused},
                                 {"resumed", resumed},
                                 {"injections", injections},
                                 {"recoveries", recoveries},
                                 {"stops", stops},
                                 {"aborts", aborts},
                                 {"pauses", pauses},
                                 {"lease_changes", lease_changes},
                                 {"consumer_restarts", consumer_restarts},
                                 {"audit_entries", audit_entries},
                                 {"frames_acknowledged", frames_acknowledged},
                                 {"frames_read", frames_read},
                                 {"worst_position_error_rad", worst_position_error_rad},
                                 {"violations", violations}};
  for (size_t i = 0; i < samples.size(); i += std::max<size_t>(1, samples.size() / 48)) {
    json["samples"].push_back({{"resident_bytes", samples[i].resident_bytes},
                               {"threads", samples[i].threads},
                               {"open_files", samples[i].open_files},
                               {"cpu_s", samples[i].cpu_s}});
  }
  return json.dump(1);
}

}  // namespace mesorig::daemon
