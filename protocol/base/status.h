#pragma once
// Status and StatusOr at every fallible boundary (STYLE: messages name the device or file, the
// operation, the value with its unit and the permitted range).
//
//   MESORIG_RETURN_IF_ERROR(file.Sync());
//   MESORIG_ASSIGN_OR_RETURN(Rig rig, LoadRig(path));
//   return InvalidArgument("{}: exposure {} s is not in [{}, {}] s", path, value, low, high);

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <fmt/core.h>

#include <string>
#include <string_view>
#include <utility>

namespace mesorig {

using absl::Status;
using absl::StatusOr;

inline Status OkStatus() { return absl::OkStatus(); }

// What the user gave is wrong (a file's content, an argument): exit code 2.
template <typename... Args>
Status InvalidArgument(fmt::format_string<Args...> format, Args&&... args) {
  return absl::InvalidArgumentError(fmt::format(format, std::forward<Args>(args)...));
}
// A named file, session or device does not exist: exit code 2.
template <typename... Args>
Status NotFound(fmt::format_string<Args...> format, Args&&... args) {
  return absl::NotFoundError(fmt::format(format, std::forward<Args>(args)...));
}
// The state forbids it (a plan is running, the chain is open): exit code 1.
template <typename... Args>
Status FailedPrecondition(fmt::format_string<Args...> format, Args&&... args) {
  return absl::FailedPreconditionError(fmt::format(format, std::forward<Args>(args)...));
}
// A device, disk or peer does not answer or answers wrongly: exit code 1.
template <typename... Args>
Status Unavailable(fmt::format_string<Args...> format, Args&&... args) {
  return absl::UnavailableError(fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
Status DeadlineExceeded(fmt::format_string<Args...> format, Args&&... args) {
  return absl::DeadlineExceededError(fmt::format(format, std::forward<Args>(args)...));
}
// Bytes that were whole when written are not whole now: exit code 1.
template <typename... Args>
Status DataLoss(fmt::format_string<Args...> format, Args&&... args) {
  return absl::DataLossError(fmt::format(format, std::forward<Args>(args)...));
}
// Not there yet; the README lists it.
template <typename... Args>
Status Unimplemented(fmt::format_string<Args...> format, Args&&... args) {
  return absl::UnimplementedError(fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
Status Cancelled(fmt::format_string<Args...> format, Args&&... args) {
  return absl::CancelledError(fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
Status Internal(fmt::format_string<Args...> format, Args&&... args) {
  return absl::InternalError(fmt::format(format, std::forward<Args>(args)...));
}

// The message as a std::string_view (the packaged abseil has a string_view of its own).
inline std::string_view Message(const Status& status) {
  return {status.message().data(), status.message().size()};
}

// The same status with `context: ` before its message.
inline Status Annotate(const Status& status, std::string_view context) {
  if (status.ok()) return status;
  return Status(status.code(), fmt::format("{}: {}", context, Message(status)));
}

}  // namespace mesorig

#define MESORIG_CONCAT_INNER_(a, b) a##b
#define MESORIG_CONCAT_(a, b) MESORIG_CONCAT_INNER_(a, b)

#define MESORIG_RETURN_IF_ERROR(expression)              \
  do {                                                   \
    ::absl::Status mesorig_status_ = (expression);       \
    if (!mesorig_status_.ok()) return mesorig_status_;   \
  } while (false)

#define MESORIG_ASSIGN_OR_RETURN(declaration, expression) \
  MESORIG_ASSIGN_OR_RETURN_IMPL_(MESORIG_CONCAT_(mesorig_or_, __LINE__), declaration, expression)
#define MESORIG_ASSIGN_OR_RETURN_IMPL_(or_value, declaration, expression) \
  auto or_value = (expression);                                           \
  if (!or_value.ok()) return std::move(or_value).status();                \
  declaration = std::move(or_value).value()
