#pragma once
// A daemon that has one session and serves it from memory: Control and Frames, nothing else.

#include <grpcpp/grpcpp.h>

#include <map>
#include <set>
#include <vector>

#include "protocol/base/digest.h"
#include "protocol/base/mutex.h"
#include "protocol/messages/control.grpc.pb.h"
#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/server.h"

namespace mesorig::service {

class FakeDaemon final : public v1::Control::Service, public v1::Frames::Service {
 public:
  explicit FakeDaemon(std::filesystem::path dir) : dir_(std::move(dir)) {}
  ~FakeDaemon() override { Shutdown(); }

  void Listen() {
    endpoint_.emplace(PublishedEndpoint::Claim(dir_, wire::kDaemonName).value());
    {
      MutexLock lock(mutex_);
      closing_ = false;
    }
    server_ = wire::StartServer(*endpoint_, {static_cast<v1::Control::Service*>(this),
                                             static_cast<v1::Frames::Service*>(this)})
                  .value();
  }
  void Shutdown() {
    {
      MutexLock lock(mutex_);
      closing_ = true;
      changed_.NotifyAll();
    }
    if (server_ != nullptr) server_->Shutdown(std::chrono::system_clock::now());
    server_.reset();
    endpoint_.reset();
  }
  void SetSession(v1::SessionReply session) {
    MutexLock lock(mutex_);
    session_ = std::move(session);
    changed_.NotifyAll();
  }
  void Commit(int camera, v1::FrameHeader header, std::string pixels) {
    MutexLock lock(mutex_);
    auto& rows = frames_[camera];
    header.set_camera(static_cast<uint32_t>(camera));
    header.set_sequence(rows.size() + 1);
    if (header.digest().empty()) header.set_digest(FrameDigest(pixels));
    v1::Frame frame;
    *frame.mutable_header() = std::move(header);
    frame.set_pixels(std::move(pixels));
    rows.push_back(std::move(frame));
    changed_.NotifyAll();
  }
  void End(bool complete) {
    MutexLock lock(mutex_);
    session_.set_ended(true), session_.set_complete(complete);
    changed_.NotifyAll();
  }
  // Streams break (UNAVAILABLE) after each so many frames.
  void BreakEvery(int frames) {
    MutexLock lock(mutex_);
    break_every_ = frames;
  }
  int subscriptions() const {
    MutexLock lock(mutex_);
    return subscriptions_;
  }

  grpc::Status Hello(grpc::ServerContext*, const v1::HelloRequest*, v1::HelloReply* r) override {
    r->set_protocol_major(protocol_major);
    r->set_server("fake 0");
    return grpc::Status::OK;
  }
  grpc::Status GetStatus(grpc::ServerContext*, const v1::StatusRequest*,
                         v1::StatusReply* reply) override {
    MutexLock lock(mutex_);
    const bool running = announced_running && !session_.ended();
    reply->set_state(running ? v1::RUNNING : v1::IDLE);
    reply->set_session_id(session_.session_id());
    return grpc::Status::OK;
  }
  grpc::Status Watch(grpc::ServerContext* context, const v1::WatchRequest*,
                     grpc::ServerWriter<v1::Event>* writer) override {
    MutexLock lock(mutex_);
    bool told = false;
    while (!closing_ && !context->IsCancelled()) {
      if (!told && !session_.session_id().empty()) {
        v1::Event event;
        event.mutable_started()->set_session_id(session_.session_id());
        writer->Write(event);
        told = true;
      }
      changed_.WaitFor(mutex_, std::chrono::milliseconds(20));
    }
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "closing");
  }
  grpc::Status GetSession(grpc::ServerContext*, const v1::SessionRequest* request,
                          v1::SessionReply* reply) override {
    MutexLock lock(mutex_);
    if (request->session_id() != session_.session_id()) {
      return grpc::Status(grpc::StatusCode::NOT_FOUND, "no session " + request->session_id());
    }
    *reply = session_;
    return grpc::Status::OK;
  }
  grpc::Status Subscribe(grpc::ServerContext* context, const v1::SubscribeRequest* request,
                         grpc::ServerWriter<v1::Frame>* writer) override {
    MutexLock lock(mutex_);
    ++subscriptions_;
    size_t next = request->cursor();
    int sent = 0;
    while (!closing_ && !context->IsCancelled()) {
      const auto& rows = frames_[static_cast<int>(request->camera())];
      if (next < rows.size()) {
        if (break_every_ > 0 && sent++ == break_every_) {
          return grpc::Status(grpc::StatusCode::UNAVAILABLE, "broken on purpose");
        }
        const v1::Frame& frame = rows[next++];
        if (!frame.pixels().empty()) writer->Write(frame);
      } else if (session_.ended()) {
        return session_.complete() ? grpc::Status::OK
                                   : grpc::Status(grpc::StatusCode::ABORTED, "stopped by hand");
      } else {
        changed_.WaitFor(mutex_, std::chrono::milliseconds(20));
      }
    }
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "closing");
  }
  grpc::Status ReleaseSweep(grpc::ServerContext*, const v1::ReleaseSweepRequest* request,
                            v1::ReleaseSweepReply*) override {
    MutexLock lock(mutex_);
    if (refuse_releases_-- > 0) return grpc::Status(grpc::StatusCode::UNAVAILABLE, "busy");
    released_.insert(request->sweep());
    // Its frames are passed over from now on.
    for (auto& [camera, rows] : frames_) {
      for (v1::Frame& frame : rows) {
        const bool gone =
            frame.header().has_laser() && frame.header().laser().sweep() == request->sweep();
        if (gone) frame.clear_pixels();
      }
    }
    return grpc::Status::OK;
  }
  std::set<uint32_t> released() const {
    MutexLock lock(mutex_);
    return released_;
  }
  void RefuseReleases(int times) {
    MutexLock lock(mutex_);
    refuse_releases_ = times;
  }

  uint32_t protocol_major = wire::kProtocolMajor;
  bool announced_running = false;

 private:
  const std::filesystem::path dir_;
  mutable Mutex mutex_;
  CondVar changed_;
  bool closing_ GUARDED_BY(mutex_) = false;
  v1::SessionReply session_ GUARDED_BY(mutex_);
  std::map<int, std::vector<v1::Frame>> frames_ GUARDED_BY(mutex_);
  std::set<uint32_t> released_ GUARDED_BY(mutex_);
  int refuse_releases_ GUARDED_BY(mutex_) = 0;
  int break_every_ GUARDED_BY(mutex_) = 0, subscriptions_ GUARDED_BY(mutex_) = 0;
  std::optional<PublishedEndpoint> endpoint_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace mesorig::service
