#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "processing/exchange/importer.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::exchange {
namespace {

TEST(EveryImporter, RefusesNothingAndGarbage) {
  ASSERT_FALSE(AllImporters().empty());
  for (const Importer* importer : AllImporters()) {
    btf::TemporaryFolder folder;
    EXPECT_FALSE(importer->description().empty());
    EXPECT_EQ(*FindImporter(importer->name()), importer);
    EXPECT_EQ(importer->Import(folder / "absent").status().code(), absl::StatusCode::kNotFound);
    EXPECT_FALSE(importer->Import(folder.path()).ok());  // empty folder
    ASSERT_TRUE(WriteFileAtomically(folder / "garbage", "garbage").ok());
    const Status status = importer->Import(folder / "garbage").status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(Message(status)), ::testing::HasSubstr("garbage"));
  }
  EXPECT_FALSE(FindImporter("nonsense").ok());
}

}  // namespace
}  // namespace mesorig::exchange
