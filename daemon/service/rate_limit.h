#pragma once
// How often somebody may call: a bucket of tokens each, refilled at a steady rate. Pure but for
// what it remembers; the caller's lock.

#include <map>
#include <string>

namespace mesorig::daemon {

class RateLimit {
 public:
  // `per_s` calls a second for long, `burst` at once.
  RateLimit(double per_s, double burst) : per_s_(per_s), burst_(burst) {}
  // Takes a token of `who` at `now_s` (seconds, any origin, never backwards). False: none is left.
  bool Take(const std::string& who, double now_s);
  size_t size() const { return buckets_.size(); }

  static constexpr size_t kMaxBuckets =
      4096;  // then full ones are forgotten, else the call refused

 private:
  struct Bucket {
    double tokens, at_s;
  };
  double TokensAt(const Bucket& bucket, double now_s) const;
  const double per_s_, burst_;
  std::map<std::string, Bucket> buckets_;
};

}  // namespace mesorig::daemon
