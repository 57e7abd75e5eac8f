#include "tests/bench/consumer.h"

#include <fcntl.h>
#include <grpcpp/grpcpp.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <iostream>
#include <thread>

#include "daemon/service/frames_service.h"
#include "protocol/base/check.h"
#include "protocol/base/mutex.h"
#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "tests/bench/pattern_source.h"

namespace mesorig::bench {
namespace {

using Clock = std::chrono::steady_clock;

struct Tally {
  Mutex mutex;
  uint64_t frames GUARDED_BY(mutex) = 0, late GUARDED_BY(mutex) = 0, bytes GUARDED_BY(mutex) = 0;
  double worst_ms GUARDED_BY(mutex) = 0;
  Clock::time_point first GUARDED_BY(mutex) = Clock::time_point::max(), last GUARDED_BY(mutex);
};

void ReadCamera(const std::string& endpoint, const std::string& session_id, int camera,
                double late_ms, Tally& tally) {
  const auto stub = v1::Frames::NewStub(wire::MakeChannel(endpoint));
  grpc::ClientContext context;
  v1::SubscribeRequest request;
  request.set_session_id(session_id);
  request.set_camera(static_cast<uint32_t>(camera));
  const auto reader = stub->Subscribe(&context, request);
  v1::Frame frame;
  while (reader->Read(&frame)) {
    const auto now = Clock::now();
    const Clock::time_point trigger{std::chrono::nanoseconds(frame.header().exposure_start_ns())};
    const double ms = std::chrono::duration<double, std::milli>(now - trigger).count();
    MutexLock lock(tally.mutex);
    ++tally.frames;
    tally.bytes += frame.pixels().size();
    tally.worst_ms = std::max(tally.worst_ms, ms);
    if (ms > late_ms) ++tally.late;
    tally.first = std::min(tally.first, now);
    tally.last = std::max(tally.last, now);
  }
  (void)reader->Finish();  // (ABORTED: these sessions are not reconciled)
}

}  // namespace

int Consume(const std::string& endpoint, const std::string& session_id, double late_ms) {
  Tally tally;
  std::vector<std::thread> threads;
  for (int camera = 0; camera < kCameras; ++camera) {
    threads.emplace_back([&, camera] { ReadCamera(endpoint, session_id, camera, late_ms, tally); });
  }
  for (std::thread& thread : threads) thread.join();
  MutexLock lock(tally.mutex);
  const double wall_s =
      tally.frames == 0 ? 0 : std::chrono::duration<double>(tally.last - tally.first).count();
  std::cout << nlohmann::json{{"frames", tally.frames},     {"late", tally.late},
                              {"worst_ms", tally.worst_ms}, {"bytes", tally.bytes},
                              {"wall_s", wall_s},           {"cpu_s", CpuSeconds()}}
            << std::endl;
  return 0;
}

int Drain(const std::vector<int>& sockets) {
  std::atomic<uint64_t> bytes{0};
  std::vector<std::thread> threads;
  for (const int socket : sockets) {
    threads.emplace_back([&bytes, socket] {
      std::string buffer(1 << 20, '\0');
      for (ssize_t n; (n = ::read(socket, buffer.data(), buffer.size())) > 0;) {
        bytes += static_cast<uint64_t>(n);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  std::cout << nlohmann::json{{"bytes", bytes.load()}, {"cpu_s", CpuSeconds()}} << std::endl;
  return 0;
}

Child Child::Start(const std::vector<std::string>& arguments, const std::vector<int>& keep_open) {
  int ends[2];
  MESORIG_CHECK(::pipe2(ends, O_CLOEXEC) == 0);
  std::string program = std::filesystem::read_symlink("/proc/self/exe").string();
  std::vector<std::string> owned = arguments;
  std::vector<char*> argv = {program.data()};
  for (std::string& argument : owned) argv.push_back(argument.data());
  argv.push_back(nullptr);
  Child child;
  child.output_ = ends[0];
  child.pid_ = ::fork();
  MESORIG_CHECK(child.pid_ >= 0);
  if (child.pid_ == 0) {
    ::dup2(ends[1], STDOUT_FILENO);
    for (const int fd : keep_open) ::fcntl(fd, F_SETFD, 0);
    ::execv(program.c_str(), argv.data());
    ::_exit(127);
  }
  ::close(ends[1]);
  return child;
}

nlohmann::json Child::Result() {
  std::string text;
  char buffer[4096];
  for (ssize_t n; (n = ::read(output_, buffer, sizeof(buffer))) > 0;) {
    text.append(buffer, static_cast<size_t>(n));
  }
  ::close(output_);
  int status = 0;
  ::waitpid(pid_, &status, 0);
  MESORIG_CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  return nlohmann::json::parse(text);
}

FramesServer::FramesServer(const std::filesystem::path& folder, daemon::Books& books)
    : endpoint_("unix:" + (folder / "frames.sock").string()),
      service_(std::make_unique<daemon::FramesService>(books, [] { return RigTime(); })) {
  grpc::ServerBuilder builder;
  builder.AddListeningPort(endpoint_, grpc::InsecureServerCredentials());
  builder.RegisterService(service_.get());
  server_ = builder.BuildAndStart();
  MESORIG_CHECK(server_ != nullptr);
}

FramesServer::~FramesServer() {
  service_->BeginShutdown();
  server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(5));
}

}  // namespace mesorig::bench
