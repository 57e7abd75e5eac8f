#include "daemon/service/audit_interceptor.h"

#include <google/protobuf/message.h>
#include <grpcpp/server_context.h>

#include <algorithm>

#include "daemon/service/call_table.h"
#include "protocol/base/digest.h"
#include "protocol/base/log.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {
namespace {

namespace ge = grpc::experimental;

constexpr size_t kLongField = 200;
constexpr double kRefusalsPerSecond = 20, kRefusalBurst = 100;

// Of one call; its hooks run one after the other.
class AuditInterceptor final : public ge::Interceptor {
 public:
  AuditInterceptor(AuditLog& log, const CallRule& rule, ge::ServerRpcInfo& info)
      : log_(log), rule_(rule), info_(info) {}

  void Intercept(ge::InterceptorBatchMethods* methods) override {
    if (methods->QueryInterceptionHookPoint(ge::InterceptionHookPoints::POST_RECV_MESSAGE)) {
      // Of a stream the first one. Audited methods take messages of ours, no bytes.
      const void* message = methods->GetRecvMessage();
      if (what_.empty() && message != nullptr) {
        what_ = EssentialFields(*static_cast<const google::protobuf::Message*>(message));
      }
    }
    if (methods->QueryInterceptionHookPoint(ge::InterceptionHookPoints::PRE_SEND_STATUS)) {
      Tell(wire::FromGrpc(methods->GetSendStatus()));
    }
    methods->Proceed();
  }

 private:
  void Tell(const Status& outcome) {
    AuditEntry entry;
    entry.caller = CallerOf(*info_.server_context());
    entry.call = rule_.method;
    entry.what = what_;
    entry.outcome = OutcomeText(outcome);
    if (rule_.method == "Control/Stop") {
      log_.RecordLater(std::move(entry));
      return;
    }
    const Status recorded = log_.Record(std::move(entry));
    if (!recorded.ok()) Log("audit").error("{}: {}", rule_.method, Message(recorded));
  }

  AuditLog& log_;
  const CallRule& rule_;
  ge::ServerRpcInfo& info_;
  std::string what_;
};

class Factory final : public ge::ServerInterceptorFactoryInterface {
 public:
  explicit Factory(AuditLog& log) : log_(log) {}
  ge::Interceptor* CreateServerInterceptor(ge::ServerRpcInfo* info) override {
    const CallRule* rule = FindRule(info->method());
    if (rule == nullptr || !rule->audited) return nullptr;
    return new AuditInterceptor(log_, *rule, *info);
  }

 private:
  AuditLog& log_;
};

}  // namespace

std::string OutcomeText(const Status& status) {
  if (status.ok()) return "OK";
  return fmt::format("{}: {}", absl::StatusCodeToString(status.code()), Message(status));
}

std::string EssentialFields(const google::protobuf::Message& request) {
  std::unique_ptr<google::protobuf::Message> copy(request.New());
  copy->CopyFrom(request);
  const auto* reflection = copy->GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection->ListFields(*copy, &fields);
  for (const auto* field : fields) {
    if (field->is_repeated() ||
        field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_STRING) {
      continue;
    }
    const std::string text = reflection->GetString(*copy, field);
    if (text.size() <= kLongField) continue;
    reflection->SetString(copy.get(), field,
                          fmt::format("sha256 {} of {} bytes", Sha256(text), text.size()));
  }
  return copy->ShortDebugString();
}

std::unique_ptr<ge::ServerInterceptorFactoryInterface> MakeAuditInterceptors(AuditLog& log) {
  return std::make_unique<Factory>(log);
}

void RefusalRecorder::Record(Caller caller, std::string_view path, const Status& why) {
  const auto now = std::chrono::steady_clock::now();
  AuditEntry entry;
  entry.caller = std::move(caller);
  entry.call = path;
  entry.outcome = OutcomeText(why);
  {
    const MutexLock lock(mutex_);
    const double passed_s = std::chrono::duration<double>(now - refilled_).count();
    tokens_ = std::min(kRefusalBurst, tokens_ + passed_s * kRefusalsPerSecond);
    refilled_ = now;
    if (tokens_ < 1) {
      ++passed_over_;
      return;
    }
    tokens_ -= 1;
    if (passed_over_ > 0)
      entry.what = fmt::format("{} refusals before it were too many to record", passed_over_);
    passed_over_ = 0;
  }
  log_.RecordLater(std::move(entry));
}

}  // namespace mesorig::daemon
