#include "daemon/service/metrics.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmath>
#include <map>
#include <regex>
#include <sstream>

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

// The text format 0.0.4, read by its rules: value by "name{label="value",...}".
std::map<std::string, double> Exposition(const std::string& text) {
  const std::regex sample(
      R"(([a-zA-Z_:][a-zA-Z0-9_:]*)(\{(?:[a-zA-Z_][a-zA-Z0-9_]*="(?:[^"\\\n]|\\["\\n])*",?)*\})? )"
      R"(([-+0-9.eE]+|NaN|[+-]?Inf)( [0-9]+)?)");
  std::map<std::string, double> values;
  std::map<std::string, std::string> types;
  std::istringstream lines(text);
  std::string line;
  while (std::getline(lines, line)) {
    if (line.empty() || line.starts_with("# HELP ")) continue;
    if (line.starts_with("# TYPE ")) {
      std::istringstream words(line.substr(7));
      std::string name, type;
      words >> name >> type;
      EXPECT_TRUE(types.emplace(name, type).second) << "a family twice: " << name;
      EXPECT_TRUE(type == "gauge" || type == "counter" || type == "untyped") << line;
      continue;
    }
    std::smatch match;
    if (!std::regex_match(line, match, sample)) {
      ADD_FAILURE() << "not of the format: " << line;
      continue;
    }
    EXPECT_TRUE(types.contains(match[1])) << line;
    EXPECT_EQ(std::string(match[1]).ends_with("_total"), types[match[1]] == "counter") << line;
    EXPECT_TRUE(values.emplace(match[1].str() + match[2].str(), std::stod(match[3])).second)
        << "twice: " << line;
  }
  EXPECT_TRUE(text.ends_with('\n'));
  return values;
}

v1::StatusReply Busy() {
  v1::StatusReply status;
  status.set_state(v1::RUNNING);
  status.set_shots(40);
  status.set_shots_done(12);
  status.set_frames_durable(96);
  status.set_frames_lost(3);
  status.set_disk_free_bytes(123456789012);
  status.set_event_sequence(77);
  auto& consumer = *status.add_consumers();
  consumer.set_peer("unix:\"quoted\\\n");
  consumer.set_streams(8);
  auto& reading = *status.add_readings();
  reading.set_name("turntable");
  reading.set_unit("rad");
  reading.set_value(0.5);
  reading.set_age_s(1.25);
  return status;
}

TEST(Metrics, AreOfTheFormat) {
  const auto values = Exposition(MetricsText(SamplesOf(Busy(), "a \"rig\"")));
  EXPECT_EQ(values.at("mesorig_state{state=\"running\"}"), 1);
  EXPECT_EQ(values.at("mesorig_state{state=\"fault\"}"), 0);
  EXPECT_EQ(values.at("mesorig_shots_done"), 12);
  EXPECT_EQ(values.at("mesorig_frames_lost_total"), 3);
  EXPECT_EQ(values.at("mesorig_disk_free_bytes"), 123456789012.0);
  EXPECT_EQ(values.at("mesorig_reading_age_seconds{name=\"turntable\"}"), 1.25);
  EXPECT_EQ(values.at("mesorig_consumer_streams{peer=\"unix:\\\"quoted\\\\\\n\"}"), 8);
  EXPECT_GT(values.at("process_resident_memory_bytes"), 1e6);
  EXPECT_GE(values.at("process_threads"), 1);
}

TEST(Metrics, EveryFamilySaysWhatItIs) {
  const std::string text = MetricsText(SamplesOf(Busy(), "rig"));
  EXPECT_EQ(text.find(" untyped"), text.npos) << text;
  std::istringstream lines(text);
  std::string line;
  while (std::getline(lines, line)) {
    if (!line.starts_with("# HELP ")) continue;
    EXPECT_GT(line.size(), line.find(' ', 7) + 1) << line;
  }
}

std::string Get(int port, const std::string& request) {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port));
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  EXPECT_GT(::send(fd, request.data(), request.size(), MSG_NOSIGNAL), 0);
  std::string answer;
  char buffer[4096];
  ssize_t n;
  while ((n = ::recv(fd, buffer, sizeof(buffer), 0)) > 0) answer.append(buffer, size_t(n));
  ::close(fd);
  return answer;
}

TEST(MetricsServer, ServesOnLoopbackAlone) {
  const auto server = MetricsServer::Start(0, [] { return SamplesOf(Busy(), "rig"); });
  ASSERT_TRUE(server.ok()) << server.status();
  const std::string answer =
      Get((*server)->port(), "GET /metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(answer, HasSubstr("200 OK"));
  EXPECT_THAT(answer, HasSubstr("mesorig_shots_done 12"));
  EXPECT_THAT(Get((*server)->port(), "GET /etc/passwd HTTP/1.1\r\nConnection: close\r\n\r\n"),
              HasSubstr(" 404 "));
  EXPECT_THAT(Get((*server)->port(), std::string("\x16\x03\x01\0\xff\r\n\r\n", 9)),
              ::testing::Not(HasSubstr("200 OK")));
  const auto second = MetricsServer::Start((*server)->port(), [] { return std::vector<Sample>(); });
  EXPECT_TRUE(absl::IsFailedPrecondition(second.status()));
  EXPECT_THAT(std::string(Message(second.status())),
              HasSubstr(fmt::format("127.0.0.1:{}", (*server)->port())));
}

}  // namespace
}  // namespace mesorig::daemon
