// A chain of lines and everything that can be done to it.

#include "protocol/base/hash_chain.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "protocol/base/digest.h"

namespace mesorig {
namespace {

using ::testing::HasSubstr;

struct Chain {
  std::vector<std::string> lines;  // with their ends
  std::vector<ChainHead> heads;    // after each
  std::string text() const {
    std::string text;
    for (const std::string& line : lines) text += line;
    return text;
  }
};

Chain MakeChain(int entries) {
  Chain chain;
  ChainHead head;
  for (int i = 1; i <= entries; ++i) {
    chain.lines.push_back(
        AppendToChain(head, fmt::format("\"who\":\"user {}\",\"n\":{}", i % 3, i)));
    chain.heads.push_back(head);
  }
  return chain;
}

ChainReport Verify(std::string_view text, const std::vector<ChainHead>& anchors = {}) {
  ChainVerifier verifier;
  for (const ChainHead& anchor : anchors) verifier.Expect(anchor);
  verifier.Add(text);
  return verifier.Finish();
}

TEST(HashChain, FirstLineByHand) {
  ChainHead head;
  const std::string line = AppendToChain(head, "\"a\":1");
  const std::string hashed =
      "{\"sequence\":1,\"a\":1,\"previous\":\"" + std::string(64, '0') + "\"";
  EXPECT_EQ(line, hashed + ",\"hash\":\"" + Sha256(hashed) + "\"}\n");
  EXPECT_EQ(head.sequence, 1u);
  EXPECT_EQ(head.hash, Sha256(hashed));
}

TEST(HashChain, AWholeOneIsGood) {
  const Chain chain = MakeChain(20);
  const ChainReport report = Verify(chain.text(), {chain.heads[3], {0, chain.heads[19].hash}});
  EXPECT_TRUE(report.ok()) << report.wrong;
  EXPECT_EQ(report.head, chain.heads.back());
  EXPECT_EQ(report.bytes, chain.text().size());
  EXPECT_EQ(report.torn_bytes, 0u);
  EXPECT_TRUE(Verify("").ok());
}

TEST(HashChain, PiecesAreTheWhole) {
  const Chain chain = MakeChain(7);
  const std::string text = chain.text();
  for (size_t piece = 1; piece < 200; piece += 13) {
    ChainVerifier verifier;
    for (size_t at = 0; at < text.size(); at += piece) {
      verifier.Add(std::string_view(text).substr(at, piece));
    }
    const ChainReport report = verifier.Finish();
    EXPECT_TRUE(report.ok()) << piece << ": " << report.wrong;
    EXPECT_EQ(report.head, chain.heads.back());
  }
}

// Each bit of each byte: the entry that it is in is named.
TEST(HashChain, EveryFlippedBitIsFoundInItsEntry) {
  const Chain chain = MakeChain(5);
  const std::string text = chain.text();
  size_t entry = 1, end = chain.lines[0].size();
  for (size_t at = 0; at < text.size(); ++at) {
    if (at == end) end += chain.lines[entry++].size();
    for (int bit = 0; bit < 8; ++bit) {
      std::string changed = text;
      changed[at] = static_cast<char>(changed[at] ^ (1 << bit));
      const ChainReport report = Verify(changed);
      ASSERT_EQ(report.bad_entry, entry) << "byte " << at << " bit " << bit;
      ASSERT_EQ(report.head.sequence, entry - 1);
    }
  }
}

// A cut at the end is what a kill leaves: the anchor alone tells.
TEST(HashChain, EveryCutIsATornTailOrLacksAnAnchor) {
  const Chain chain = MakeChain(4);
  const std::string text = chain.text();
  for (size_t length = 0; length < text.size(); ++length) {
    const std::string_view cut = std::string_view(text).substr(0, length);
    const ChainReport report = Verify(cut);
    ASSERT_TRUE(report.ok()) << length << ": " << report.wrong;
    ASSERT_EQ(report.bytes + report.torn_bytes, length);
    const ChainReport anchored = Verify(cut, {chain.heads.back()});
    ASSERT_FALSE(anchored.ok()) << length;
    ASSERT_EQ(anchored.lacking.front(), chain.heads.back());
    // A power cut may leave zeros behind.
    if (report.torn_bytes > 0 && report.torn_bytes + 1 < chain.lines[3].size()) {
      ASSERT_TRUE(Verify(std::string(cut) + std::string(1, '\0')).ok()) << length;
    }
  }
}

TEST(HashChain, CutFromTheMiddleSwappedInsertedDoubled) {
  const Chain chain = MakeChain(6);
  for (size_t i = 0; i < chain.lines.size(); ++i) {
    Chain doubled = chain;
    doubled.lines.insert(doubled.lines.begin() + static_cast<long>(i), chain.lines[i]);
    EXPECT_EQ(Verify(doubled.text()).bad_entry, i + 2);
    Chain inserted = chain;
    ChainHead head = i == 0 ? ChainHead() : chain.heads[i - 1];
    inserted.lines.insert(inserted.lines.begin() + static_cast<long>(i),
                          AppendToChain(head, "\"who\":\"nobody\""));
    EXPECT_EQ(Verify(inserted.text()).bad_entry, i + 2) << "it fits, the one after it does not";
    if (i + 1 == chain.lines.size()) continue;
    Chain without = chain;
    without.lines.erase(without.lines.begin() + static_cast<long>(i));
    EXPECT_EQ(Verify(without.text()).bad_entry, i + 1);
    Chain swapped = chain;
    std::swap(swapped.lines[i], swapped.lines[i + 1]);
    EXPECT_EQ(Verify(swapped.text()).bad_entry, i + 1);
  }
}

// Whoever can write the file can make a chain anew: then the anchors are missing.
TEST(HashChain, AForgedChainLacksTheAnchors) {
  const Chain chain = MakeChain(6);
  Chain forged = MakeChain(3);
  ChainHead head = forged.heads.back();
  for (int i = 4; i <= 6; ++i) forged.lines.push_back(AppendToChain(head, "\"who\":\"x\""));
  EXPECT_TRUE(Verify(forged.text()).ok());
  const ChainReport report = Verify(forged.text(), {chain.heads[1], chain.heads[4]});
  EXPECT_FALSE(report.ok());
  ASSERT_EQ(report.lacking.size(), 1u);
  EXPECT_EQ(report.lacking[0].sequence, 5u);
}

TEST(HashChain, NonsenseIsBad) {
  EXPECT_EQ(Verify("\n").bad_entry, 1u);
  EXPECT_EQ(Verify("hello").bad_entry, 1u);
  EXPECT_EQ(Verify(std::string(3, '\0') + "x").bad_entry, 1u);
  EXPECT_EQ(Verify(std::string(200000, 'x')).bad_entry, 1u);
  EXPECT_THAT(Verify(std::string(200000, '{')).wrong, HasSubstr("longer"));
  EXPECT_EQ(Verify("{\"sequence\":1,\n").bad_entry, 1u);
}

TEST(HashChain, AnchorsAreFoundAmongOtherText) {
  const Chain chain = MakeChain(3);
  const std::string journal = "Nov 22 rig mesorigd[7]: " + AnchorText(chain.heads[0]) +
                              "\nother audit head x\naudit head 99\naudit head 12 abc\n" +
                              AnchorText(chain.heads[2]);
  const auto anchors = FindAnchors(journal);
  ASSERT_EQ(anchors.size(), 2u);
  EXPECT_EQ(anchors[0], chain.heads[0]);
  EXPECT_EQ(anchors[1], chain.heads[2]);
  for (size_t length = 0; length < journal.size(); ++length) {
    EXPECT_LE(FindAnchors(std::string_view(journal).substr(0, length)).size(), 2u);
  }
}

TEST(HashChain, AFile) {
  const auto path = std::filesystem::temp_directory_path() / fmt::format("chain-{}", ::getpid());
  EXPECT_TRUE(absl::IsNotFound(VerifyChainFile(path).status()));
  const Chain chain = MakeChain(9);
  FILE* out = std::fopen(path.c_str(), "wb");
  ASSERT_NE(out, nullptr);
  std::fputs(chain.text().c_str(), out);
  std::fclose(out);
  const auto report = VerifyChainFile(path, {chain.heads[8]});
  ASSERT_TRUE(report.ok());
  EXPECT_TRUE(report->ok());
  EXPECT_EQ(report->head, chain.heads[8]);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace mesorig
