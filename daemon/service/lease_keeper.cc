#include "daemon/service/lease_keeper.h"

#include <charconv>

#include "protocol/base/file_writer.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr uint64_t kBlock = 1000;  // tokens a write of the file
constexpr uint64_t kLargest = uint64_t{1} << 62;

StatusOr<uint64_t> ReadMark(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return 0;
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(file, 64));
  uint64_t mark = 0;
  const auto [end, wrong] = std::from_chars(text.data(), text.data() + text.size(), mark);
  if (wrong != std::errc() ||
      std::string_view(end, static_cast<size_t>(text.data() + text.size() - end)) != "\n" ||
      mark > kLargest) {
    return InvalidArgument(
        "{}: not a number of at most {} and an end of line; tokens must grow, so that only you can "
        "say after which number",
        file.string(), kLargest);
  }
  return mark;
}

}  // namespace

StatusOr<std::unique_ptr<LeaseKeeper>> LeaseKeeper::Open(const std::filesystem::path& state_dir,
                                                         LeaseHooks hooks) {
  const auto file = state_dir / kLeaseFile;
  MESORIG_ASSIGN_OR_RETURN(const uint64_t mark, ReadMark(file));
  std::unique_ptr<LeaseKeeper> keeper(new LeaseKeeper(file, mark, std::move(hooks)));
  const MutexLock lock(keeper->mutex_);
  MESORIG_RETURN_IF_ERROR(keeper->Reserve());
  return keeper;
}

LeaseKeeper::LeaseKeeper(std::filesystem::path file, uint64_t last_token, LeaseHooks hooks)
    : file_(std::move(file)), hooks_(std::move(hooks)), book_(last_token), reserved_(last_token) {
  thread_ = std::thread([this] { Loop(); });
}

LeaseKeeper::~LeaseKeeper() { Close(); }

void LeaseKeeper::Close() {
  {
    const MutexLock lock(mutex_);
    ending_ = true;
    changed_.NotifyAll();
  }
  if (thread_.joinable()) thread_.join();
}

// Before a token is given, the file holds a number that it does not exceed.
Status LeaseKeeper::Reserve() {
  const uint64_t next = book_.State(hooks_.now()).token + 1;
  if (next <= reserved_) return OkStatus();
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(file_, fmt::format("{}\n", next + kBlock)));
  reserved_ = next + kBlock;
  return OkStatus();
}

void LeaseKeeper::Tell() {
  using Kind = LeaseChange::Kind;
  for (const LeaseChange& change : book_.TakeChanges()) {
    if (ending_) return;
    if (change.kind == Kind::kAcquired) {
      if (hooks_.admit) hooks_.admit(change.token);
    } else if (change.kind != Kind::kRequested && change.kind != Kind::kRunEnded) {
      if (hooks_.close) hooks_.close(change.token);
    }
    Log("lease").debug("{} {}: {}{}{}", Name(change.kind), change.token, change.holder,
                       change.requester.empty() ? "" : ", ", change.requester);
    if (hooks_.changed) hooks_.changed(change);
  }
  changed_.NotifyAll();
}

void LeaseKeeper::Look() {
  const MutexLock lock(mutex_);
  book_.Expire(hooks_.now());
  Tell();
}

void LeaseKeeper::Loop() {
  const MutexLock lock(mutex_);
  while (!ending_) {
    const LeaseTime now = hooks_.now();
    const auto next = book_.Expire(now);
    Tell();
    if (next) {
      changed_.WaitFor(mutex_, *next - now);
    } else {
      changed_.Wait(mutex_);
    }
  }
}

StatusOr<uint64_t> LeaseKeeper::Acquire(const Caller& caller, std::chrono::milliseconds span,
                                        bool take) {
  const MutexLock lock(mutex_);
  MESORIG_RETURN_IF_ERROR(Reserve());
  auto token = book_.Acquire(caller, span, take, hooks_.now());
  Tell();
  return token;
}

Status LeaseKeeper::Renew(const Caller& caller, uint64_t token) {
  const MutexLock lock(mutex_);
  Status status = book_.Renew(caller, token, hooks_.now());
  Tell();
  return status;
}

Status LeaseKeeper::Release(const Caller& caller, uint64_t token) {
  const MutexLock lock(mutex_);
  Status status = book_.Release(caller, token, hooks_.now());
  Tell();
  return status;
}

Status LeaseKeeper::Request(const Caller& caller) {
  const MutexLock lock(mutex_);
  Status status = book_.Request(caller, hooks_.now());
  Tell();
  return status;
}

Status LeaseKeeper::Check(const Caller& caller, uint64_t token) {
  const MutexLock lock(mutex_);
  Status status = book_.Check(caller, token, hooks_.now());
  Tell();
  return status;
}

Status LeaseKeeper::CheckFree(const Caller& caller, uint64_t token) {
  const MutexLock lock(mutex_);
  Status status = book_.CheckFree(caller, token, hooks_.now());
  Tell();
  return status;
}

StatusOr<uint64_t> LeaseKeeper::BeginRun(const Caller& caller, uint64_t token) {
  const MutexLock lock(mutex_);
  MESORIG_RETURN_IF_ERROR(Reserve());
  auto run = book_.BeginRun(caller, token, hooks_.now());
  Tell();
  return run;
}

void LeaseKeeper::EndRun(uint64_t token) {
  const MutexLock lock(mutex_);
  book_.EndRun(token);
  Tell();
}

LeaseState LeaseKeeper::State() {
  const MutexLock lock(mutex_);
  return book_.State(hooks_.now());
}

}  // namespace mesorig::daemon
