#pragma once
// A small rig and plan, and frames whose pixels tell what they are.

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <string>

#include "daemon/session/session.h"
#include "protocol/base/file_writer.h"

namespace mesorig::daemon {

// A folder of its own that goes with the object.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "mesorig-session-XXXXXX").string();
    EXPECT_NE(::mkdtemp(name.data()), nullptr);
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// The demo rig with sensors of 8 x 8 pixels.
inline Rig SmallRig() {
  auto text = ReadFile(std::filesystem::path(MESORIG_SOURCE_DIR) / "rigs/demo.toml");
  EXPECT_TRUE(text.ok());
  const auto replace = [&](std::string_view from, std::string_view to) {
    for (size_t at = 0; (at = text->find(from, at)) != std::string::npos; at += to.size()) {
      text->replace(at, from.size(), to);
    }
  };
  replace("width_px = 256", "width_px = 8");
  replace("height_px = 192", "height_px = 8");
  replace("focal_px = 2600", "focal_px = 80");
  auto rig = ParseRig(*text, "small.toml");
  EXPECT_TRUE(rig.ok()) << rig.status();
  return *std::move(rig);
}

// `positions` x 8 lamps, all 8 cameras.
inline CompiledPlan SmallPlan(const Rig& rig, int positions = 1, std::string_view name = "small") {
  const std::string text = fmt::format(
      "name = \"{}\"\n[sample]\nname = \"s\"\n"
      "[product]\nwidth_px = 4\nheight_px = 4\npitch_mm = 1\nh_ref_mm = 4.5\n"
      "[[grid]]\nexposure_s = 0.02\n[grid.axes.turntable]\nangles_deg = [0]\n"
      "[grid.axes.light_arc]\nstart_deg = 30\nstep_deg = 60\ncount = {}\n",
      name, positions);
  auto plan = CompilePlan(text, "small-plan.toml", rig);
  EXPECT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->frames, 64u * positions);
  return *std::move(plan);
}

// SmallPlan and three sweeps: 0 (3 frames of cameras 1 and 3) is kept, of 1 (5 frames of cameras 0,
// 3 and 6) and 2 (4 frames of all) only displacements are. Shots 0-7 are the grid's, then 8-10,
// 11-15, 16-19.
inline CompiledPlan SweepingPlan(const Rig& rig) {
  CompiledPlan plan = SmallPlan(rig);
  const std::vector<std::vector<int>> cameras = {{1, 3}, {0, 3, 6}, {0, 1, 2, 3, 4, 5, 6, 7}};
  const uint32_t frames[] = {3, 5, 4};
  for (uint32_t i = 0; i < 3; ++i) {
    Step step;
    step.kind = StepKind::kSweep;
    step.shot = plan.shots;
    step.exposure_s = 0.02;
    step.cameras = cameras[i];
    step.sweep = {i, static_cast<int>(i % 2), 0.01, -0.01, frames[i], 15, i == 0, {}};
    for (const int camera : step.cameras) {
      step.sweep.regions.push_back(camera % 2 ? Region{2, 4, 6, 4} : Region{0, 2, 4, 6});
    }
    plan.shots += frames[i];
    plan.frames += frames[i] * static_cast<uint32_t>(step.cameras.size());
    ++plan.sweeps;
    plan.steps.push_back(step);
  }
  return plan;
}

inline std::shared_ptr<const std::string> PixelsOf(int camera, uint32_t shot, size_t bytes = 128) {
  auto pixels = std::make_shared<std::string>(bytes, '\0');
  std::mt19937 random(shot * 8u + static_cast<unsigned>(camera));
  for (char& c : *pixels) c = static_cast<char>(random());
  return pixels;
}

inline FrameRecord FrameOf(int camera, uint32_t shot) {
  FrameRecord r;
  r.camera = camera;
  r.shot = shot;
  r.trigger_id = shot + 1;
  r.frame_id = shot + 1000;
  r.exposure_start_ns = int64_t{1'000'000} * shot;
  r.exposure_end_ns = r.exposure_start_ns + 20'000'000;
  r.exposure_s = 0.02;
  r.axis_rad = {0.25 * shot, -1};
  r.lamp_level = {0, 0, 1, 0, 0, 0, 0, 0.5};
  r.width = 8;
  r.height = 8;
  r.bits = 12;
  return r;
}

// Frame `index` of the sweep, of its k-th camera.
inline FrameRecord SweepFrameOf(const Step& step, size_t k, uint32_t index) {
  FrameRecord r = FrameOf(step.cameras[k], step.shot + index);
  const Region& region = step.sweep.regions[k];
  r.region_x = region.x;
  r.region_y = region.y;
  r.width = region.width;
  r.height = region.height;
  r.laser = {step.sweep.index, index, step.sweep.mount, 0.01 - 0.001 * index, index != 1};
  return r;
}

inline size_t BytesOf(const FrameRecord& r) {
  return static_cast<size_t>(r.width) * static_cast<size_t>(r.height) * 2;
}

inline Status AppendSweepFrame(Session& session, const FrameRecord& r) {
  return session.Append(r, PixelsOf(r.camera, r.shot, BytesOf(r)));
}

inline Status AppendSweep(Session& session, const Step& step) {
  for (uint32_t index = 0; index < step.sweep.frames; ++index) {
    for (size_t k = 0; k < step.cameras.size(); ++k) {
      MESORIG_RETURN_IF_ERROR(AppendSweepFrame(session, SweepFrameOf(step, k, index)));
    }
  }
  return OkStatus();
}

inline Status AppendShot(Session& session, const Step& step) {
  for (const int camera : step.cameras) {
    MESORIG_RETURN_IF_ERROR(
        session.Append(FrameOf(camera, step.shot), PixelsOf(camera, step.shot)));
  }
  return OkStatus();
}

inline Status AppendAll(Session& session, const CompiledPlan& plan) {
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kShot) MESORIG_RETURN_IF_ERROR(AppendShot(session, step));
    if (step.kind == StepKind::kSweep) MESORIG_RETURN_IF_ERROR(AppendSweep(session, step));
  }
  return OkStatus();
}

// Follows the stream of one camera as a consumer does: the shots that it gets, until nothing comes.
// A frame that cannot be read ends it.
inline StatusOr<std::vector<uint32_t>> ShotsOf(Session& session, int camera) {
  std::vector<uint32_t> shots;
  uint64_t cursor = 0;
  for (;;) {
    MESORIG_ASSIGN_OR_RETURN(const auto frame, session.Next(camera, cursor, 0));
    if (!frame.has_value()) return shots;
    const FrameRecord& r = frame->record;
    EXPECT_GT(r.sequence, cursor);
    EXPECT_EQ(*frame->pixels, *PixelsOf(camera, r.shot, r.bytes));
    shots.push_back(r.shot);
    cursor = r.sequence;
  }
}

// What a consumer gets of one camera: good frames, and the errors beside them.
struct Replay {
  std::vector<FrameRecord> good;
  std::vector<std::pair<uint64_t, Status>> bad;  // sequence number
};
inline Replay ReadAll(Session& session, int camera, uint64_t upto) {
  Replay replay;
  for (uint64_t cursor = 0; cursor < upto; ++cursor) {
    auto frame = session.Next(camera, cursor, 0);
    if (!frame.ok()) {
      replay.bad.emplace_back(cursor + 1, frame.status());
    } else if (frame->has_value()) {
      EXPECT_EQ(*(*frame)->pixels,
                *PixelsOf(camera, (*frame)->record.shot, (*frame)->record.bytes));
      replay.good.push_back((*frame)->record);
    }
  }
  return replay;
}

// Reads one camera's frames until the session has ended and there are no more. False after an
// error.
inline bool FollowToEnd(Session& session, int camera,
                        const std::function<void(const StoredFrame&)>& visit) {
  for (uint64_t cursor = 0;;) {
    // Looked at first: an end, then nothing, means that there is no more.
    const bool ended = session.Summary().end != SessionEnd::kOpen;
    const auto frame = session.Next(camera, cursor, 1000);
    if (!frame.ok()) return false;
    if (frame->has_value()) {
      visit(**frame);
      cursor = (*frame)->record.sequence;
    } else if (ended) {
      return true;
    }
  }
}

// Sessions of the sweeping plan, in a folder of their own.
class SessionTest : public ::testing::Test {
 protected:
  std::shared_ptr<Session> Create() {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    EXPECT_TRUE(session.ok()) << session.status();
    id_ = (*session)->id();
    return *session;
  }
  std::filesystem::path File(std::string_view name) const { return folder_.path() / id_ / name; }

  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SweepingPlan(rig_);
  std::string id_;  // of the last one created
};

}  // namespace mesorig::daemon
