// A simulator that answers with mutated messages: the daemon's end gives every call an end with a
// status, and never crashes.

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <random>
#include <thread>

#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::sim_wire {
namespace {

// Serves one connection: plausible answers, of which some are mutated; closes after a while.
class HostileSimulator {
 public:
  HostileSimulator(const std::filesystem::path& path, uint32_t seed, int mutate_percent)
      : listener_(Listen(path).value()), random_(seed), mutate_percent_(mutate_percent) {
    thread_ = std::thread([this] { Serve(); });
  }
  ~HostileSimulator() { thread_.join(); }

 private:
  void Serve() {
    constexpr int kAnswers = 40;
    const Fd fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
    MessageReader reader;
    char buffer[4096];
    for (int answered = 0; answered < kAnswers;) {
      const auto size = ReceiveSome(fd.get(), buffer, sizeof(buffer));
      if (!size.ok() || *size == 0 || !reader.Feed({buffer, *size}).ok()) return;
      std::string bytes;
      while (const auto message = reader.Next()) {
        Answer(*message, bytes);
        ++answered;
      }
      if (!SendAll(fd.get(), bytes, 1000).ok()) return;
    }
  }
  void Answer(const Envelope& message, std::string& bytes) {
    const RigTime then = message.time;
    Envelope answer{MessageType::kAdvanced, 0, message.id, then, std::string(1, kDeterministic)};
    if (message.type == MessageType::kHello) {
      answer.type = MessageType::kWelcome;
      answer.payload = Pack(Welcome{"sha", 3, {}, {"can", "lines", "camera:1"}, "127.0.0.1:1"});
    } else if (message.type == MessageType::kQuery) {
      answer.type = MessageType::kReply;
      answer.payload = std::string(1, static_cast<char>(random_() % 4)) + PackRegisterValue(1);
    } else if (message.type == MessageType::kAdvance) {
      const CameraFrame frame{1, 1, {}, {}, 2, 2, 8, "abcd"};
      Put({MessageType::kOutput, 0, 0, then, Pack(CanFrame{0x185, 8, {}})}, bytes);
      Put({MessageType::kOutput, 1, 0, then, Pack(LineEdge{1, 1})}, bytes);
      Put({MessageType::kOutput, 2, 0, then, Pack(frame)}, bytes);
    } else {
      return;
    }
    Put(answer, bytes);
  }
  void Put(const Envelope& envelope, std::string& bytes) {
    const size_t from = bytes.size();
    AppendMessage(envelope, bytes);
    if (static_cast<int>(random_() % 100) >= mutate_percent_) return;
    const size_t at = from + random_() % (bytes.size() - from);
    switch (random_() % 3) {
      case 0:
        bytes[at] = static_cast<char>(random_());
        return;
      case 1:
        bytes.resize(at);
        return;
      default:
        bytes.insert(at, 1, static_cast<char>(random_()));
    }
  }
  Fd listener_;
  std::mt19937 random_;
  const int mutate_percent_;
  std::thread thread_;
};

struct Outcome {
  bool connected = false;
  int answered = 0;
};

Outcome Drive(uint32_t seed, int mutate_percent) {
  const auto path =
      std::filesystem::temp_directory_path() / fmt::format("mesorig-hostile-{}", ::getpid());
  std::filesystem::remove(path);
  Outcome outcome;
  {
    HostileSimulator simulator(path, seed, mutate_percent);
    SimLinkOptions options;
    options.query_timeout = std::chrono::milliseconds(20);
    auto link = SimLink::Connect("unix:" + path.string(), options);
    if (!link.ok()) {
      EXPECT_FALSE(Message(link.status()).empty());
      return outcome;
    }
    outcome.connected = true;
    std::atomic<int> heard{0};
    for (uint16_t device = 0; device < 3; ++device) {
      (*link)->Subscribe(device, [&](RigTime, const std::string& payload) {
        heard += UnpackCanFrame(payload).ok() || UnpackLineEdge(payload).ok() ||
                         UnpackCameraFrame(payload).ok()
                     ? 1
                     : 0;
      });
    }
    for (int i = 0; i < 8; ++i) {
      const auto answer = (*link)->Query(static_cast<uint16_t>(i % 3), "question");
      outcome.answered += answer.ok() ? 1 : 0;
      EXPECT_TRUE(answer.ok() || !Message(answer.status()).empty());
      (void)(*link)->Post(0, Pack(CanFrame{1, 0, {}}));
    }
    EXPECT_LE(heard.load(), 1000);
  }
  std::filesystem::remove(path);
  return outcome;
}

TEST(HostileSimulator, HonestOneWorks) {
  const Outcome outcome = Drive(1, 0);
  EXPECT_TRUE(outcome.connected);
  EXPECT_GT(outcome.answered, 0);
}

TEST(HostileSimulator, MutatedMessagesEndInAStatus) {
  int connected = 0;
  for (uint32_t seed = 0; seed < 120; ++seed) {
    connected += Drive(seed, 2 + static_cast<int>(seed % 30)).connected ? 1 : 0;
  }
  EXPECT_GT(connected, 30);
  EXPECT_LT(connected, 120);
}

}  // namespace
}  // namespace mesorig::sim_wire
