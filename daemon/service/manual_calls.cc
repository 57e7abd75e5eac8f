// The Control service's calls for the rig by hand, its lease, and the audit log.

#include <algorithm>
#include <chrono>

#include "daemon/service/control_service.h"
#include "daemon/service/convert.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {
namespace {

constexpr std::chrono::milliseconds kLookForClient{50};
constexpr size_t kAuditPiece = 256u << 10;

}  // namespace

void ControlService::TellLease(const Caller& caller, v1::LeaseReply& reply) {
  const LeaseState state = books_.lease->State();
  *reply.mutable_lease() = ToMessage(state);
  if (state.kind == LeaseState::Kind::kManual && state.holder == caller.name) {
    reply.mutable_lease()->set_token(state.token);
  }
}

grpc::Status ControlService::AcquireLease(grpc::ServerContext* context,
                                          const v1::AcquireLeaseRequest* request,
                                          v1::LeaseReply* reply) {
  if (const Status why = WhyNoChange(); !why.ok()) return wire::ToGrpc(why);
  if (manual_ == nullptr) {
    return wire::ToGrpc(Unimplemented("this daemon drives no rig by hand"));
  }
  // (What is no number of milliseconds is out of every range.)
  const double span_ms = request->span_s() * 1000;
  const bool sane = span_ms >= 0 && span_ms <= 1e9;
  const auto span = std::chrono::milliseconds(sane ? static_cast<int64_t>(span_ms) : -1);
  const Caller caller = CallerOf(*context);
  const auto token = books_.lease->Acquire(caller, span, request->take());
  if (!token.ok()) return wire::ToGrpc(token.status());
  TellLease(caller, *reply);
  reply->mutable_lease()->set_token(*token);  // his, though it may be over already
  return grpc::Status::OK;
}

grpc::Status ControlService::RenewLease(grpc::ServerContext* context,
                                        const v1::LeaseTokenRequest* request,
                                        v1::LeaseReply* reply) {
  const Caller caller = CallerOf(*context);
  const Status status = books_.lease->Renew(caller, request->lease_token());
  if (status.ok()) TellLease(caller, *reply);
  return wire::ToGrpc(status);
}

grpc::Status ControlService::ReleaseLease(grpc::ServerContext* context,
                                          const v1::LeaseTokenRequest* request,
                                          v1::LeaseReply* reply) {
  const Caller caller = CallerOf(*context);
  const Status status = books_.lease->Release(caller, request->lease_token());
  if (status.ok()) TellLease(caller, *reply);
  return wire::ToGrpc(status);
}

grpc::Status ControlService::RequestHandover(grpc::ServerContext* context,
                                             const v1::HandoverRequest*, v1::LeaseReply* reply) {
  const Caller caller = CallerOf(*context);
  const Status status = books_.lease->Request(caller);
  if (status.ok()) TellLease(caller, *reply);
  return wire::ToGrpc(status);
}

StatusOr<int> ControlService::AxisNamed(const std::string& name) const {
  std::string names;
  for (size_t i = 0; i < rig_.axes.size(); ++i) {
    if (rig_.axes[i].name == name) return static_cast<int>(i);
    names += (i == 0 ? "" : ", ") + rig_.axes[i].name;
  }
  return InvalidArgument("axis \"{}\" is none of rig {}: {}", name.substr(0, 100), rig_.name,
                         names);
}

Status ControlService::ByHand(const grpc::ServerContext& context, uint64_t lease_token,
                              const std::function<std::future<Status>(ManualControl&)>& order) {
  MESORIG_RETURN_IF_ERROR(WhyNoChange());
  MESORIG_RETURN_IF_ERROR(books_.lease->Check(CallerOf(context), lease_token));
  if (manual_ == nullptr) return Unimplemented("this daemon drives no rig by hand");
  std::future<Status> done = order(*manual_);
  while (done.wait_for(kLookForClient) != std::future_status::ready) {
    // Nobody looks at what moves: it ends as by a stop.
    if (context.IsCancelled()) manual_->Stop("the client left while it moved");
  }
  return done.get();
}

grpc::Status ControlService::MoveAxis(grpc::ServerContext* context,
                                      const v1::MoveAxisRequest* request, v1::ManualReply*) {
  const auto axis = AxisNamed(request->axis());
  if (!axis.ok()) return wire::ToGrpc(axis.status());
  return wire::ToGrpc(ByHand(*context, request->lease_token(), [&](ManualControl& manual) {
    return manual.MoveTo(request->lease_token(), *axis, request->target_rad());
  }));
}

grpc::Status ControlService::HomeAxis(grpc::ServerContext* context,
                                      const v1::HomeAxisRequest* request, v1::ManualReply*) {
  const auto axis = AxisNamed(request->axis());
  if (!axis.ok()) return wire::ToGrpc(axis.status());
  return wire::ToGrpc(ByHand(*context, request->lease_token(), [&](ManualControl& manual) {
    return manual.Home(request->lease_token(), *axis);
  }));
}

grpc::Status ControlService::SetLamp(grpc::ServerContext* context,
                                     const v1::SetLampRequest* request, v1::ManualReply*) {
  int lamp = -1;
  if (!request->lamp().empty()) {
    const auto at = std::find_if(rig_.lamps.begin(), rig_.lamps.end(),
                                 [&](const auto& each) { return each.name == request->lamp(); });
    if (at == rig_.lamps.end()) {
      return wire::ToGrpc(InvalidArgument("lamp \"{}\" is none of the {} of rig {}",
                                          request->lamp().substr(0, 100), rig_.lamps.size(),
                                          rig_.name));
    }
    lamp = static_cast<int>(at - rig_.lamps.begin());
  }
  return wire::ToGrpc(ByHand(*context, request->lease_token(), [&](ManualControl& manual) {
    return manual.SetLamp(request->lease_token(), lamp);
  }));
}

grpc::Status ControlService::TestLaser(grpc::ServerContext* context,
                                       const v1::TestLaserRequest* request, v1::ManualReply*) {
  return wire::ToGrpc(ByHand(*context, request->lease_token(), [&](ManualControl& manual) {
    return manual.TestLaser(request->lease_token(), request->seconds());
  }));
}

// Each message is a hand on the button for another 200 ms.
Status ControlService::JogWhileHeld(const Caller& caller,
                                    grpc::ServerReader<v1::JogRequest>& reader,
                                    v1::JogReply& reply) {
  MESORIG_RETURN_IF_ERROR(WhyNoChange());
  if (manual_ == nullptr) return Unimplemented("this daemon drives no rig by hand");
  v1::JogRequest request;
  int axis = -1;
  uint64_t token = 0;
  Status status;
  while (status.ok() && reader.Read(&request)) {
    status = books_.lease->Check(caller, request.lease_token());
    if (!status.ok()) break;
    const auto named = AxisNamed(request.axis());
    if (!named.ok()) {
      status = named.status();
    } else if (axis >= 0 && *named != axis) {
      status = InvalidArgument("a jog is of one axis: {} after {}", request.axis(),
                               rig_.axes[axis].name);
    } else {
      axis = *named;
      token = request.lease_token();
      status = manual_->Jog(token, axis, request.rate_rad_s());
    }
  }
  if (axis >= 0) {  // let go at once, whatever it was
    const Status ended = manual_->Jog(token, axis, 0);
    if (status.ok()) status = ended;
  }
  reply.set_ended("let go");
  return status;
}

grpc::Status ControlService::Jog(grpc::ServerContext* context,
                                 grpc::ServerReader<v1::JogRequest>* reader, v1::JogReply* reply) {
  return wire::ToGrpc(JogWhileHeld(CallerOf(*context), *reader, *reply));
}

grpc::Status ControlService::ReadAudit(grpc::ServerContext* context,
                                       const v1::ReadAuditRequest* request,
                                       grpc::ServerWriter<v1::AuditBytes>* writer) {
  uint64_t offset = request->offset();
  while (!context->IsCancelled()) {
    auto piece = books_.audit->Read(offset, kAuditPiece);
    if (!piece.ok()) return wire::ToGrpc(piece.status());
    if (piece->empty()) return grpc::Status::OK;
    offset += piece->size();
    v1::AuditBytes bytes;
    bytes.set_data(*std::move(piece));
    if (!writer->Write(bytes)) break;
  }
  return grpc::Status::CANCELLED;
}

}  // namespace mesorig::daemon
