#include "protocol/base/hash_chain.h"

#include <algorithm>
#include <cstring>
#include <fstream>

#include "protocol/base/check.h"
#include "protocol/base/digest.h"

namespace mesorig {
namespace {

constexpr size_t kHex = 64;
constexpr std::string_view kPrevious = ",\"previous\":\"", kHash = "\",\"hash\":\"", kEnd = "\"}";
// From `,"hash"` on, and from `,"previous"` on.
constexpr size_t kHashPart = kHash.size() - 1 + kHex + kEnd.size();
constexpr size_t kTrailer = kPrevious.size() + kHex + 1 + kHashPart;
constexpr std::string_view kAnchor = "audit head ";

std::string Opening(uint64_t sequence) { return fmt::format("{{\"sequence\":{},", sequence); }

bool IsHash(std::string_view text) {
  return text.size() == kHex && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

}  // namespace

std::string AppendToChain(ChainHead& head, std::string_view fields) {
  MESORIG_CHECK(!fields.empty() && fields.find('\n') == std::string_view::npos);
  std::string line =
      fmt::format("{}{}{}{}\"", Opening(head.sequence + 1), fields, kPrevious, head.hash);
  head = {head.sequence + 1, Sha256(line)};
  line += fmt::format("{}{}{}\n", kHash.substr(1), head.hash, kEnd);
  MESORIG_CHECK(line.size() <= kMaxChainLine);
  return line;
}

std::string AnchorText(const ChainHead& head) {
  return fmt::format("{}{} {}", kAnchor, head.sequence, head.hash);
}

std::vector<ChainHead> FindAnchors(std::string_view text) {
  std::vector<ChainHead> anchors;
  for (size_t at = text.find(kAnchor); at != std::string_view::npos; at = text.find(kAnchor, at)) {
    at += kAnchor.size();
    ChainHead anchor;
    size_t digits = 0;
    while (at < text.size() && text[at] >= '0' && text[at] <= '9' && digits++ < 18) {
      anchor.sequence = anchor.sequence * 10 + static_cast<uint64_t>(text[at++] - '0');
    }
    if (digits == 0 || at >= text.size() || text[at] != ' ') continue;
    anchor.hash = text.substr(at + 1, kHex);
    if (anchor.sequence > 0 && IsHash(anchor.hash)) anchors.push_back(std::move(anchor));
  }
  return anchors;
}

void ChainVerifier::Bad(std::string wrong) {
  report_.bad_entry = report_.head.sequence + 1;
  report_.wrong = std::move(wrong);
  rest_.clear();
}

void ChainVerifier::AddLine(std::string_view line) {
  const std::string opening = Opening(report_.head.sequence + 1);
  if (line.size() >= kMaxChainLine) return Bad(fmt::format("is longer than {}", kMaxChainLine));
  if (line.size() < opening.size() + kTrailer) return Bad("is too short to be an entry");
  if (!line.starts_with(opening)) return Bad("does not begin with its number");
  const std::string_view trailer = line.substr(line.size() - kTrailer);
  const std::string_view previous = trailer.substr(kPrevious.size(), kHex);
  const std::string_view hash = trailer.substr(kTrailer - kEnd.size() - kHex, kHex);
  const bool laid_out = trailer.starts_with(kPrevious) && trailer.ends_with(kEnd) &&
                        trailer.substr(kPrevious.size() + kHex, kHash.size()) == kHash &&
                        IsHash(hash);
  if (!laid_out) return Bad("does not end as an entry does");
  if (previous != report_.head.hash) return Bad("does not follow the one before it");
  if (Sha256(line.substr(0, line.size() - kHashPart)) != hash) return Bad("is not what was hashed");
  report_.head = {report_.head.sequence + 1, std::string(hash)};
  report_.bytes += line.size() + 1;
  std::erase_if(anchors_, [&](const ChainHead& anchor) {
    return anchor.hash == hash && (anchor.sequence == 0 || anchor == report_.head);
  });
}

void ChainVerifier::Add(std::string_view bytes) {
  while (report_.bad_entry == 0 && !bytes.empty()) {
    const size_t end = bytes.find('\n');
    if (end == std::string_view::npos) {
      rest_ += bytes;
      if (rest_.size() > kMaxChainLine) Bad(fmt::format("is longer than {}", kMaxChainLine));
      return;
    }
    if (rest_.empty()) {
      AddLine(bytes.substr(0, end));
    } else {
      rest_ += bytes.substr(0, end);
      const std::string line = std::exchange(rest_, {});
      AddLine(line);
    }
    bytes.remove_prefix(end + 1);
  }
}

// A kill leaves a beginning of the entry that was being written, a power cut zeros behind it.
void ChainVerifier::JudgeTail() {
  std::string_view tail = rest_;
  // (Quotes are escaped inside the fields, so that this can only be the entry's own.)
  const size_t hash = tail.find(kHash);
  const size_t whole = hash == std::string_view::npos ? kMaxChainLine : hash + 1 + kHashPart;
  bool good = tail.size() <= whole;
  while (!tail.empty() && tail.back() == '\0') tail.remove_suffix(1);
  const std::string opening = Opening(report_.head.sequence + 1);
  const size_t shared = std::min(tail.size(), opening.size());
  good &= tail.substr(0, shared) == std::string_view(opening).substr(0, shared);
  good &= tail.find('\0') == std::string_view::npos;
  if (!good) return Bad("is neither whole nor the beginning of one");
  report_.torn_bytes = rest_.size();
}

ChainReport ChainVerifier::Finish() {
  if (report_.bad_entry == 0 && !rest_.empty()) JudgeTail();
  report_.lacking = std::move(anchors_);
  return std::move(report_);
}

StatusOr<ChainReport> VerifyChainFile(const std::filesystem::path& path,
                                      const std::vector<ChainHead>& anchors) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return NotFound("{}: {}", path.string(), std::strerror(errno));
  ChainVerifier verifier;
  for (const ChainHead& anchor : anchors) verifier.Expect(anchor);
  std::string piece(1u << 20, '\0');
  while (in) {
    in.read(piece.data(), static_cast<std::streamsize>(piece.size()));
    verifier.Add(std::string_view(piece).substr(0, static_cast<size_t>(in.gcount())));
  }
  if (in.bad()) return Unavailable("{}: reading: {}", path.string(), std::strerror(errno));
  return verifier.Finish();
}

}  // namespace mesorig
