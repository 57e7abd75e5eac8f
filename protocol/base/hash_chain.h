#pragma once
// A log of lines in which each carries the SHA-256 of the one before: whoever changes, cuts out or
// inserts a line breaks it there (docs/audit.md). A line is one JSON object and its end of line:
//
//   {"sequence":7,<fields>,"previous":"<64 hex>","hash":"<64 hex>"}
//
// `hash` is the SHA-256 of the line's bytes before `,"hash"`; `previous` is the hash of the line
// before, 64 zeros in the first; `sequence` counts from 1. What lacks at the end, only an anchor
// tells: the hash of an entry, noted elsewhere.

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/status.h"

namespace mesorig {

struct ChainHead {
  uint64_t sequence = 0;  // 0: nothing yet
  std::string hash = std::string(64, '0');
  bool operator==(const ChainHead&) const = default;
};

inline constexpr size_t kMaxChainLine = 64u << 10;  // bytes, with the end of line

// The line that follows `head`, which becomes that line's. `fields`: JSON members without braces,
// of at least one, in one line.
std::string AppendToChain(ChainHead& head, std::string_view fields);

// "audit head 7 <64 hex>", as it is noted elsewhere, and the heads in a text of such lines.
std::string AnchorText(const ChainHead& head);
std::vector<ChainHead> FindAnchors(std::string_view text);

struct ChainReport {
  ChainHead head;           // of the last entry that is good; all before it are
  uint64_t bytes = 0;       // of the good ones
  uint64_t bad_entry = 0;   // the first that is not, by the number that it should have; 0: none
  std::string wrong;        // what is wrong with it
  uint64_t torn_bytes = 0;  // at the end: the beginning of an entry, as a kill leaves it
  std::vector<ChainHead> lacking;  // anchors that no entry has
  bool ok() const { return bad_entry == 0 && lacking.empty(); }
};

// Reads a chain piece by piece. Not thread-safe.
class ChainVerifier {
 public:
  // An entry with this hash must be there; sequence 0: of any number.
  void Expect(ChainHead anchor) { anchors_.push_back(std::move(anchor)); }
  void Add(std::string_view bytes);
  ChainReport Finish();

 private:
  void AddLine(std::string_view line);
  void Bad(std::string wrong);
  void JudgeTail();

  ChainReport report_;
  std::string rest_;  // of a line whose end has not come
  std::vector<ChainHead> anchors_;
};

// NotFound, Unavailable: the file.
StatusOr<ChainReport> VerifyChainFile(const std::filesystem::path& path,
                                      const std::vector<ChainHead>& anchors = {});

}  // namespace mesorig
