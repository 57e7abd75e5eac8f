#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "protocol/base/file_writer.h"
#include "protocol/base/runtime_dir.h"

namespace mesorig {
namespace {

namespace fs = std::filesystem;

class FilesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    dir_ = fs::temp_directory_path() / fmt::format("mesorig-files-{}", ::getpid());
    fs::create_directories(dir_);
  }
  void TearDown() override { fs::remove_all(dir_); }
  size_t EntryCount() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(dir_), {}));
  }
  fs::path dir_;
};

TEST_F(FilesTest, AFileIsWholeOrAbsent) {
  {
    auto file = AtomicFile::Create(dir_ / "a");
    ASSERT_TRUE(file.ok());
    std::ofstream(file->temporary_path()) << "half";
    EXPECT_FALSE(fs::exists(dir_ / "a"));
  }
  EXPECT_EQ(EntryCount(), 0u) << "not committed: nothing is left";
  ASSERT_TRUE(WriteFileAtomically(dir_ / "a", "whole").ok());
  EXPECT_EQ(ReadFile(dir_ / "a").value(), "whole");
  EXPECT_EQ(EntryCount(), 1u);
}

TEST_F(FilesTest, ErrorsNameThePath) {
  EXPECT_TRUE(absl::IsNotFound(ReadFile(dir_ / "none").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(ReadFile(dir_).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(WriteFileAtomically(dir_ / "no" / "x", "")));
  ASSERT_TRUE(WriteFileAtomically(dir_ / "big", std::string(100, 'x')).ok());
  const auto too_big = ReadFile(dir_ / "big", 99);
  ASSERT_FALSE(too_big.ok());
  EXPECT_NE(Message(too_big.status()).find("100 bytes"), std::string_view::npos);
}

TEST_F(FilesTest, EndpointIsClaimedOncePublishedAndTakenBack) {
  EXPECT_TRUE(absl::IsUnavailable(FindEndpoint(dir_, "svc").status()));
  {
    auto endpoint = PublishedEndpoint::Claim(dir_, "svc");
    ASSERT_TRUE(endpoint.ok());
    const auto second = PublishedEndpoint::Claim(dir_, "svc");
    ASSERT_FALSE(second.ok());
    EXPECT_NE(Message(second.status()).find("already runs"), std::string_view::npos);
    ASSERT_TRUE(endpoint->Publish("unix:/x").ok());
    EXPECT_EQ(FindEndpoint(dir_, "svc").value(), "unix:/x");
  }
  EXPECT_FALSE(FindEndpoint(dir_, "svc").ok());
  EXPECT_TRUE(PublishedEndpoint::Claim(dir_, "svc").ok()) << "free again";
}

TEST_F(FilesTest, RefusesARuntimeDirWhoseSocketsDoNotFit) {
  const auto deep = dir_ / std::string(120, 'd');
  const auto endpoint = PublishedEndpoint::Claim(deep, "svc");
  ASSERT_FALSE(endpoint.ok());
  EXPECT_NE(Message(endpoint.status()).find("107"), std::string_view::npos);
}

}  // namespace
}  // namespace mesorig
