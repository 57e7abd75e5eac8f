// kill -9 of daemon, simulator and processing service in the middle of a capture, at some thirty
// points each: the session goes on where it was, and ends with the frames and the files of one that
// never died (DESIGN, "What must always hold", 1).

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <map>
#include <numeric>

#include "tests/end_to_end/running_rig.h"

namespace mesorig::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kKills = 30;  // of each program
const std::string kNight = kTiny + "tiny_night.toml";

// What a capture comes to.
struct Result {
  std::string frames, btf, mdf;  // digests of the live frames and of the files' pixels
  friend bool operator==(const Result&, const Result&) = default;
};

// How far a capture has come: the most bytes that each of its segments had when looked at (those of
// released sweeps go meanwhile).
class Progress {
 public:
  uintmax_t Look(const fs::path& session) {
    std::error_code gone;  // released sweeps go while we look
    for (fs::recursive_directory_iterator at(session, gone), end; !gone && at != end;
         at.increment(gone)) {
      if (at->path().extension() != ".seg") continue;
      std::error_code error;
      const uintmax_t size = fs::file_size(at->path(), error);
      if (!error) most_[at->path()] = std::max(most_[at->path()], size);
    }
    return std::accumulate(most_.begin(), most_.end(), uintmax_t{0},
                           [](uintmax_t sum, const auto& segment) { return sum + segment.second; });
  }

 private:
  std::map<fs::path, uintmax_t> most_;
};

std::string DigestOf(const fs::path& file) {
  const Outcome outcome = RunProgram("mesorig-btf", {"digest", file.string(), "--json"});
  EXPECT_EQ(outcome.code, 0) << outcome.text;
  const json digest = json::parse(outcome.text, nullptr, false);
  return digest.is_object() ? digest.value("pixels", "") : "";
}

// One capture of the night's plan, which somebody may disturb.
class Night {
 public:
  Night() : rig_(true) {
    client_ = std::make_unique<Service>(
        "mesorig",
        std::vector<std::string>{"run", kNight, "--no-products", "--on-prompt", rig_.Operator(),
                                 "--runtime-dir", rig_.folder().path().string()},
        rig_.folder() / "client.log");
  }

  // Returns when so many bytes are in the segments, or the capture is over.
  void AwaitBytes(uintmax_t bytes) {
    while (client_->Running() && (session().empty() || this->bytes() < bytes)) {
      PollPause();
    }
  }
  void KillDaemon() {
    rig_.daemon().End(SIGKILL);
    rig_.StartDaemon();
    Resume();
  }
  void KillSimulator() {
    rig_.sim().End(SIGKILL);
    // (A daemon without its rig takes its time to say that it cannot switch anything off.)
    rig_.daemon().End(SIGKILL);
    rig_.StartSimulator();
    rig_.StartDaemon();
    Resume();
  }
  void KillProcessing() {
    rig_.processing().End(SIGKILL);
    rig_.StartProcessing();
  }
  bool capturing() { return client_->Running(); }

  Result Finish() {
    while (client_->Running()) PollPause();
    const fs::path products = rig_.folder() / "products" / session();
    EXPECT_TRUE(AwaitFile(products / "sample.mdf.exr")) << client_->Log() << rig_.Logs();
    const Outcome verified = rig_.Mesorig({"session", "verify", session(), "--json"});
    EXPECT_EQ(verified.code, 0) << verified.text;
    const json ledger = json::parse(verified.text, nullptr, false);
    if (!ledger.is_object()) return {};
    return {ledger.value("content_digest", ""), DigestOf(products / "sample.btf.exr"),
            DigestOf(products / "sample.mdf.exr")};
  }
  std::string Logs() const { return client_->Log() + rig_.Logs(); }
  uintmax_t bytes() { return progress_.Look(session_dir()); }

 private:
  // The client says which one it began.
  const std::string& session() {
    if (!session_.empty()) return session_;
    const std::string log = client_->Log();
    const size_t at = log.find("session "), end = log.find(": ", at);
    if (at != std::string::npos && end != std::string::npos) session_ = log.substr(at + 8, end - at - 8);
    return session_;
  }
  fs::path session_dir() { return rig_.folder() / "state" / session(); }
  // A session that was over before the blow has nothing to go on with.
  void Resume() {
    while (client_->Running()) PollPause();
    const Outcome outcome =
        rig_.Mesorig({"resume", session(), "--sample", "weave", "--no-products", "--on-prompt",
                      rig_.Operator(), "--json"});
    if (outcome.text.find("complete") != std::string::npos && outcome.code != 0) {
      EXPECT_NE(outcome.text.find("is complete"), std::string::npos) << outcome.text << Logs();
      return;
    }
    EXPECT_EQ(outcome.code, 0) << outcome.text << Logs();
  }

  RunningRig rig_;
  std::unique_ptr<Service> client_;
  std::string session_;
  Progress progress_;
};

class Kill : public ::testing::Test {
 protected:
  // Strikes at `kKills` points spread over the capture's bytes; returns how many it survived.
  int StrikeEverywhere(const char* victim, void (Night::*strike)()) {
    Night undisturbed;
    undisturbed.AwaitBytes(1);
    uintmax_t most = 0;
    for (; undisturbed.capturing(); PollPause()) most = undisturbed.bytes();
    const Result expected = undisturbed.Finish();
    if (expected.frames.empty() || expected.btf.empty() || expected.mdf.empty()) {
      ADD_FAILURE() << "no undisturbed night: " << undisturbed.Logs();
      return 0;
    }
    int survived = 0, in_capture = 0;
    for (int k = 0; k < kKills; ++k) {
      SCOPED_TRACE(fmt::format("{}, blow {} of {}", victim, k + 1, kKills));
      Night night;
      night.AwaitBytes(1 + most * static_cast<uintmax_t>(k) / kKills);
      in_capture += night.capturing();
      (night.*strike)();
      const Result result = night.Finish();
      EXPECT_EQ(result.frames, expected.frames);
      EXPECT_EQ(result.btf, expected.btf);
      EXPECT_EQ(result.mdf, expected.mdf);
      survived += result == expected;
      if (HasFailure()) {
        ADD_FAILURE() << night.Logs();
        break;
      }
    }
    fmt::print("{}: {} kills survived of {} tried, {} of them during the capture\n", victim,
               survived, kKills, in_capture);
    EXPECT_GE(in_capture, kKills * 3 / 4) << "the blows came too late to mean much";
    return survived;
  }
};

TEST_F(Kill, Daemon) {
  EXPECT_EQ(StrikeEverywhere("mesorigd", &Night::KillDaemon), kKills);
}
TEST_F(Kill, Simulator) {
  EXPECT_EQ(StrikeEverywhere("mesorig-sim", &Night::KillSimulator), kKills);
}
TEST_F(Kill, Processing) {
  EXPECT_EQ(StrikeEverywhere("mesorig-processd", &Night::KillProcessing), kKills);
}

}  // namespace
}  // namespace mesorig::test
