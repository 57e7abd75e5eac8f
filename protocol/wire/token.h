#pragma once
// What a user gives a gateway, so that it may act for him: his certificate, the fingerprint of the
// gateway's certificate, when it was issued, when it ends (minutes later) and a nonce, signed with
// his key. The gateway sends it with each call as metadata kTokenKey. A gateway has no rights of
// its own; somebody who copies the token lacks the gateway's key.
//
// Base64 of (little-endian): "MTK1", gateway fingerprint, i64 issued, i64 expires (seconds since
// 1970), nonce (16 bytes), certificate (DER), signature (ECDSA or what the key is, SHA-256) of all
// bytes before it; each of variable length with a u32 length.

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "protocol/base/status.h"
#include "protocol/wire/identity.h"

namespace mesorig::wire {

inline constexpr char kTokenKey[] = "mesorig-token";
inline constexpr size_t kMaxTokenBytes = 6144;  // as text; gRPC reads 8 KiB of metadata
inline constexpr int64_t kMaxTokenLife_s = 600, kTokenLife_s = 300;
inline constexpr int64_t kClockSkew_s = 60;  // between the user's clock and the daemon's

struct Token {
  Identity user;
  std::string gateway;  // fingerprint
  int64_t issued_s = 0, expires_s = 0;
  std::string nonce;
  std::string certificate, signature, signed_part;  // bytes
};

// `key_pem` and `certificate_pem` are the user's. InvalidArgument: they do not belong together, a
// lifetime outside 1 to kMaxTokenLife_s, a fingerprint that is none.
StatusOr<std::string> MakeToken(std::string_view key_pem, std::string_view certificate_pem,
                                std::string_view gateway_fingerprint, int64_t now_s,
                                int64_t life_s = kTokenLife_s);
// Form only: nothing is verified. InvalidArgument.
StatusOr<Token> ParseToken(std::string_view text);

// Verifies against one laboratory's CA. Immutable; any thread.
class TokenVerifier {
 public:
  // Without a CA (empty) it refuses all.
  explicit TokenVerifier(std::string ca_pem) : ca_pem_(std::move(ca_pem)) {}
  // The token's form, signature, times at `now_s`, and the certificate's chain, purpose and
  // validity. Unauthenticated tells what is wrong. Whom it may serve, and how often, is the
  // TokenBook's.
  StatusOr<Token> Verify(std::string_view text, int64_t now_s) const;

 private:
  const std::string ca_pem_;
};

// One token serves one connection of one gateway: the first that it comes over. Kept in memory
// until tokens end; those issued before the book was opened are refused, so that a restart forgets
// nothing that matters. The caller's lock.
class TokenBook {
 public:
  explicit TokenBook(int64_t opened_s) : opened_s_(opened_s) {}
  // What is known of this text over this connection; null: it has to be verified.
  const Token* Known(std::string_view text, std::string_view connection) const;
  // Enters a verified token. Unauthenticated: its nonce served another connection, or another
  // token; it was issued before the book was opened; the book is full of tokens that still last.
  StatusOr<const Token*> Enter(Token token, std::string_view text, std::string_view connection,
                               int64_t now_s);
  size_t size() const { return entries_.size(); }
  static constexpr size_t kMaxEntries = 1024, kMaxOfOneUser = 64;

 private:
  struct Entry {
    Token token;
    std::string text_sha256, connection;
  };
  const int64_t opened_s_;
  std::map<std::string, Entry> entries_;         // by user's fingerprint and nonce
  std::map<std::string, const Entry*> by_text_;  // by text_sha256
};

}  // namespace mesorig::wire
