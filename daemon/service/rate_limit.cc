#include "daemon/service/rate_limit.h"

#include <algorithm>

namespace mesorig::daemon {

double RateLimit::TokensAt(const Bucket& bucket, double now_s) const {
  return std::min(burst_, bucket.tokens + std::max(0.0, now_s - bucket.at_s) * per_s_);
}

bool RateLimit::Take(const std::string& who, double now_s) {
  auto at = buckets_.find(who);
  if (at == buckets_.end()) {
    if (buckets_.size() >= kMaxBuckets) {
      std::erase_if(buckets_, [&](const auto& b) { return TokensAt(b.second, now_s) >= burst_; });
      if (buckets_.size() >= kMaxBuckets) return false;
    }
    at = buckets_.emplace(who, Bucket{burst_, now_s}).first;
  }
  Bucket& bucket = at->second;
  bucket.tokens = TokensAt(bucket, now_s);
  bucket.at_s = now_s;
  if (bucket.tokens < 1) return false;
  bucket.tokens -= 1;
  return true;
}

}  // namespace mesorig::daemon
