#pragma once
// Internal to processing/service: what the frames of one session become. Frames of lamps go to
// processing/assemble, frames of laser sweeps to processing/mesostructure; a plan may have only one
// kind.

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "processing/assemble/assembler.h"
#include "processing/mesostructure/mdf_builder.h"
#include "processing/service/product_folder.h"
#include "protocol/messages/frames.pb.h"
#include "protocol/messages/processing.pb.h"

namespace mesorig::service {

// Thread contract: Take from any thread, frames of one camera one after the other; Pack when no
// Take runs; the rest from any thread.
class SessionProducts {
 public:
  static StatusOr<std::unique_ptr<SessionProducts>> Create(const Rig& rig, const CompiledPlan& plan,
                                                           const std::filesystem::path& folder);
  // As Assembler::Add and MdfBuilder::Add.
  Status Take(const v1::Frame& frame);
  // As Assembler::NeedsAgain.
  bool NeedsAgain(int camera) const {
    return assembler_ != nullptr && assembler_->NeedsAgain(camera);
  }
  // Of the planned ones: arrived, or not needed again.
  uint32_t frames() const;
  // The same at no cost, but frames of lamps that were shot again count again.
  uint32_t progress() const;
  uint32_t frames_planned() const;
  // Sweeps whose raw frames may go and, by the plan, shall; each is told once.
  std::vector<uint32_t> TakeReleasable();
  // DataLoss unless every planned frame has arrived.
  Status CheckWhole() const;
  // `audit_head`: of the daemon's audit log, for the products' provenance.
  // A plan of calibration frames only has no product.
  StatusOr<std::vector<v1::Product>> Pack(const std::string& session_id,
                                           const std::string& audit_head);

 private:
  SessionProducts(const CompiledPlan& plan, std::filesystem::path folder);

  StatusOr<v1::Product> PackBtf(const std::string& session_id, const std::string& audit_head);
  StatusOr<v1::Product> PackMdf(const std::string& session_id, const std::string& audit_head);

  const std::filesystem::path folder_;
  const bool has_data_;  // of lamps: there is a BTF
  std::vector<uint8_t> released_by_plan_;  // of each sweep
  std::atomic<uint32_t> lamp_frames_ = 0;
  std::unique_ptr<assemble::Assembler> assembler_;          // plans with grids
  std::unique_ptr<mesostructure::MdfBuilder> mdf_builder_;  // plans with sweeps
};

}  // namespace mesorig::service
