// The rig by hand.

#include <chrono>
#include <future>
#include <thread>

#include "client/connection/daemon_calls.h"

namespace mesorig::client {
namespace {

// Well within the 200 ms after which the daemon stops a jog.
constexpr std::chrono::milliseconds kRepeat{50};

StatusOr<v1::LeaseStatus> LeaseOf(StatusOr<v1::LeaseReply> reply) {
  if (!reply.ok()) return reply.status();
  return reply->lease();
}

// A call that may take as long as a motion does; given up when `leave` says so.
template <typename Method, typename Request>
Status LongCall(v1::Control::Stub& stub, Method method, const Request& request,
                const std::function<bool()>& leave) {
  grpc::ClientContext context;
  v1::ManualReply reply;
  auto done =
      std::async(std::launch::async, [&] { return (stub.*method)(&context, request, &reply); });
  while (done.wait_for(kRepeat) != std::future_status::ready) {
    if (leave && leave()) context.TryCancel();
  }
  return wire::FromGrpc(done.get());
}

}  // namespace

StatusOr<v1::LeaseStatus> DaemonClient::AcquireLease(double span_s, bool take) {
  v1::AcquireLeaseRequest request;
  request.set_span_s(span_s);
  request.set_take(take);
  return LeaseOf(Call<v1::LeaseReply>(*state_->control, &v1::Control::Stub::AcquireLease, request));
}

StatusOr<v1::LeaseStatus> DaemonClient::RenewLease(uint64_t token) {
  v1::LeaseTokenRequest request;
  request.set_lease_token(token);
  return LeaseOf(Call<v1::LeaseReply>(*state_->control, &v1::Control::Stub::RenewLease, request));
}

StatusOr<v1::LeaseStatus> DaemonClient::ReleaseLease(uint64_t token) {
  v1::LeaseTokenRequest request;
  request.set_lease_token(token);
  return LeaseOf(Call<v1::LeaseReply>(*state_->control, &v1::Control::Stub::ReleaseLease, request));
}

StatusOr<v1::LeaseStatus> DaemonClient::RequestHandover() {
  return LeaseOf(Call<v1::LeaseReply>(*state_->control, &v1::Control::Stub::RequestHandover,
                                      v1::HandoverRequest()));
}

Status DaemonClient::Jog(uint64_t token, std::string_view axis, double rate_rad_s,
                         const std::function<bool()>& held) {
  grpc::ClientContext context;
  v1::JogReply reply;
  const auto stream = state_->control->Jog(&context, &reply);
  v1::JogRequest request;
  request.set_lease_token(token);
  request.set_axis(std::string(axis));
  request.set_rate_rad_s(rate_rad_s);
  while (held() && stream->Write(request)) std::this_thread::sleep_for(kRepeat);
  stream->WritesDone();
  return wire::FromGrpc(stream->Finish());
}

Status DaemonClient::MoveAxis(uint64_t token, std::string_view axis, double target_rad,
                              const std::function<bool()>& leave) {
  v1::MoveAxisRequest request;
  request.set_lease_token(token);
  request.set_axis(std::string(axis));
  request.set_target_rad(target_rad);
  return LongCall(*state_->control, &v1::Control::Stub::MoveAxis, request, leave);
}

Status DaemonClient::HomeAxis(uint64_t token, std::string_view axis,
                              const std::function<bool()>& leave) {
  v1::HomeAxisRequest request;
  request.set_lease_token(token);
  request.set_axis(std::string(axis));
  return LongCall(*state_->control, &v1::Control::Stub::HomeAxis, request, leave);
}

Status DaemonClient::SetLamp(uint64_t token, std::string_view lamp) {
  v1::SetLampRequest request;
  request.set_lease_token(token);
  request.set_lamp(std::string(lamp));
  return LongCall(*state_->control, &v1::Control::Stub::SetLamp, request, {});
}

Status DaemonClient::TestLaser(uint64_t token, double seconds, const std::function<bool()>& leave) {
  v1::TestLaserRequest request;
  request.set_lease_token(token);
  request.set_seconds(seconds);
  return LongCall(*state_->control, &v1::Control::Stub::TestLaser, request, leave);
}

}  // namespace mesorig::client
