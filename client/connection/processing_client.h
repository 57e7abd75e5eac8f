#pragma once
// The processing service as its clients see it.

#include <filesystem>
#include <memory>
#include <string_view>

#include "protocol/base/status.h"
#include "protocol/messages/processing.pb.h"

namespace mesorig::client {

class ProcessingClient {
 public:
  // Unavailable when mesorig-processd is not running.
  static StatusOr<std::unique_ptr<ProcessingClient>> Connect(
      const std::filesystem::path& runtime_dir);
  ~ProcessingClient();
  // What there is now.
  StatusOr<v1::ProductsReply> GetProducts(std::string_view session_id);
  // Blocks until the session's products are whole or will not be (ProductsReply::error).
  StatusOr<v1::ProductsReply> AwaitProducts(std::string_view session_id);

 private:
  struct State;
  explicit ProcessingClient(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace mesorig::client
