#pragma once
// A session on disk, looked at again from outside: does its ledger balance, are its pixels as they
// were, what is its content. Works on live, killed and ended sessions, and changes nothing (but an
// older journal becomes today's, as with every opening).

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "daemon/session/ledger.h"
#include "daemon/session/reconcile.h"
#include "daemon/session/session.h"

namespace mesorig::daemon {

struct VerifyReport {
  SessionSummary summary;
  std::vector<Imbalance> imbalances;   // empty: every planned frame is there, whole, once
  uint32_t rows = 0, frames_live = 0;  // live: not superseded
  uint32_t frames_released = 0;        // live, and of released sweeps: only digests are left
  uint64_t bytes_read = 0;             // of pixels
  std::string content_digest;
  std::vector<JournalEntry> entries;
};

// Reads the pixels of all live frames again. `progress`, with frames done and frames planned, says
// whether to go on; Cancelled when not. Errors as Session::Open; InvalidArgument for a plan.bin of
// another version.
StatusOr<VerifyReport> VerifySession(const std::filesystem::path& root, const std::string& id,
                                     const std::function<bool(uint32_t, uint32_t)>& progress);

// Equal for two sessions whose live frames have equal pixels: a digest over camera, shot and digest
// of every one, in this order. Nothing of time, sequence or runs goes in.
StatusOr<std::string> ContentDigest(Ledger& ledger);

}  // namespace mesorig::daemon
