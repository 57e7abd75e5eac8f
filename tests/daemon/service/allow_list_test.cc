#include "daemon/service/allow_list.h"

#include <gtest/gtest.h>

#include <random>

#include "protocol/base/digest.h"
#include "tests/daemon/session/session_fixture.h"
#include "tests/fixtures/damaged_text.h"

namespace mesorig::daemon {
namespace {

TEST(AllowList, FollowsItsFile) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "allowed";
  AllowList list(file);
  const std::string anna = Sha256("anna"), otto = Sha256("otto");
  EXPECT_FALSE(list.Allows(anna)) << "no file, nobody";
  ASSERT_TRUE(WriteFileAtomically(file, "# people\n" + anna + " anna operator\n\n" + otto).ok());
  EXPECT_TRUE(list.Allows(anna));
  EXPECT_TRUE(list.Allows(otto));
  EXPECT_FALSE(list.Allows(""));
  EXPECT_FALSE(list.Allows("#"));
  EXPECT_FALSE(list.Allows(anna.substr(0, 63)));
  ASSERT_TRUE(WriteFileAtomically(file, otto + "\n").ok());
  EXPECT_FALSE(list.Allows(anna));
  EXPECT_TRUE(list.Allows(otto));
  std::filesystem::remove(file);
  EXPECT_FALSE(list.Allows(otto));
  list.Reload();
  EXPECT_FALSE(list.Allows(otto));
}

TEST(AllowList, ADamagedListLetsNobodyElseIn) {
  const std::string anna = Sha256("anna"), otto = Sha256("otto");
  const std::string text = anna + " anna operator 2026-12-22\n" + otto + " otto observer\n";
  std::mt19937 random(3);
  int lost = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto found = ReadAllowed(test::Damaged(text, random, 1 + i % 3, " \n#ABCDEFghijklm"));
    for (const std::string& fingerprint : found) {
      // (A digit may be damaged to another one: then it is nobody's.)
      EXPECT_EQ(fingerprint.size(), 64u);
      EXPECT_EQ(fingerprint.find_first_not_of("0123456789abcdef"), std::string::npos);
    }
    lost += !found.contains(anna) || !found.contains(otto);
  }
  EXPECT_GT(lost, 500);
}

}  // namespace
}  // namespace mesorig::daemon
