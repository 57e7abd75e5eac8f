#include "processing/service/job_table.h"

#include <gtest/gtest.h>

namespace mesorig::service {
namespace {

class FakeJob : public Job {
 public:
  explicit FakeJob(std::function<void()> on_change) : on_change_(std::move(on_change)) {}
  void Stop() override {}
  v1::ProductsReply Snapshot() const override { return {}; }
  bool finished() const override { return finished_; }
  bool failed() const override { return failed_; }
  uint32_t start() const override { return 1; }
  void Finish(bool failed) {
    failed_ = failed;
    finished_ = true;
    on_change_();
  }

 protected:
  const std::function<void()> on_change_;

 private:
  std::atomic<bool> finished_{false}, failed_{false};
};

// Its thread says something while it is joined.
class TalkingJob final : public FakeJob {
 public:
  using FakeJob::FakeJob;
  ~TalkingJob() override { on_change_(); }
};

class JobTableTest : public ::testing::Test {
 protected:
  const std::string kId = "20260101T000000.000Z-plan";
  std::vector<std::shared_ptr<FakeJob>> jobs_;
  std::optional<uint32_t> starts_ = 1;
  JobTable table_{"no such folder",
                  [this](const std::string&, std::function<void()> on_change) {
                    jobs_.push_back(std::make_shared<FakeJob>(std::move(on_change)));
                    return jobs_.back();
                  },
                  [this](const std::string&) { return starts_; }};
};

TEST_F(JobTableTest, OneThatFailedBeginsAgainOneThatIsDoneDoesNot) {
  table_.Start(kId);
  ASSERT_EQ(jobs_.size(), 1u);
  jobs_[0]->Finish(true);
  EXPECT_EQ(jobs_.size(), 1u) << "nobody resumed it";
  table_.Start(kId);
  ASSERT_EQ(jobs_.size(), 2u);
  jobs_[1]->Finish(false);
  table_.Start(kId);
  EXPECT_EQ(jobs_.size(), 2u);
  starts_ = 2;  // frames were taken again
  table_.Start(kId);
  EXPECT_EQ(jobs_.size(), 3u);
}

// The daemon resumes a session while the job has not yet noticed that it had ended.
TEST_F(JobTableTest, AStartWhileTheJobIsAboutToFailIsNotLost) {
  table_.Start(kId);
  table_.Start(kId);
  ASSERT_EQ(jobs_.size(), 1u);
  jobs_[0]->Finish(true);
  ASSERT_EQ(jobs_.size(), 2u);
  jobs_[1]->Finish(true);
  EXPECT_EQ(jobs_.size(), 2u) << "once";
  table_.Stop();
  table_.Start(kId);
  EXPECT_EQ(jobs_.size(), 2u);
}

// Whoever waits for products may be the last one to let go of a job.
TEST_F(JobTableTest, AStopWhileSomebodyWaits) {
  for (int i = 0; i < 50; ++i) {
    JobTable table("no such folder",
                   [](const std::string&, std::function<void()> on_change) {
                     return std::make_shared<TalkingJob>(std::move(on_change));
                   },
                   [](const std::string&) { return 1; });
    table.Start(kId);
    grpc::Status awaited;
    std::thread waiter([&] {
      grpc::ServerContext context;
      v1::ProductsRequest request;
      request.set_session_id(kId);
      v1::ProductsReply reply;
      awaited = table.AwaitProducts(&context, &request, &reply);
    });
    table.Stop();
    waiter.join();
    EXPECT_EQ(awaited.error_code(), grpc::StatusCode::UNAVAILABLE);
  }
}

TEST_F(JobTableTest, AStartWhileTheJobSucceedsChangesNothing) {
  table_.Start(kId);
  table_.Start(kId);
  jobs_[0]->Finish(false);
  EXPECT_EQ(jobs_.size(), 1u);
}

}  // namespace
}  // namespace mesorig::service
