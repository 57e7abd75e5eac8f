#include "daemon/service/rate_limit.h"

#include <gtest/gtest.h>

namespace mesorig::daemon {
namespace {

TEST(RateLimit, LetsABurstThroughAndThenTheRate) {
  RateLimit limit(2, 3);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(limit.Take("anna", 10));
  EXPECT_FALSE(limit.Take("anna", 10));
  EXPECT_TRUE(limit.Take("otto", 10)) << "each has his own";
  EXPECT_FALSE(limit.Take("anna", 10.4));
  EXPECT_TRUE(limit.Take("anna", 10.5));
  EXPECT_FALSE(limit.Take("anna", 10.5));
  // Rest is saved up to the burst, and a clock that steps back gives nothing.
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(limit.Take("anna", 1000));
  EXPECT_FALSE(limit.Take("anna", 1000));
  EXPECT_FALSE(limit.Take("anna", 0));
}

TEST(RateLimit, RemembersSoMany) {
  RateLimit limit(1, 1);
  for (size_t i = 0; i < RateLimit::kMaxBuckets; ++i) {
    ASSERT_TRUE(limit.Take(std::to_string(i), 0));
  }
  EXPECT_FALSE(limit.Take("one more", 0)) << "all the others are at their limit";
  EXPECT_TRUE(limit.Take("one more", 1)) << "they have rested";
  EXPECT_EQ(limit.size(), 1u);
}

}  // namespace
}  // namespace mesorig::daemon
