#pragma once
// How the command line says things.

#include <string>
#include <string_view>

#include "protocol/messages/control.pb.h"
#include "protocol/messages/processing.pb.h"

namespace mesorig::client {

std::string_view StateName(v1::State state);
// "226.5 MB"
std::string BytesText(uint64_t bytes);
// "3 min 20 s"
std::string DurationText(double seconds);
// What a prompt still waits for: "reset pressed, `mesorig acknowledge`", or "nothing".
std::string StillNeeded(const v1::Prompt& prompt);
// One line: what is asked of the operator, and what is still missing.
std::string PromptText(const v1::Prompt& prompt);
// "free", "anna has control of the rig, for another 7 s"
std::string LeaseText(const v1::LeaseStatus& lease);
std::string EventText(const v1::Event& event);
// Any message as one line of JSON, with the names of the .proto file and zeros included.
std::string JsonText(const google::protobuf::Message& message);

// A bar on a terminal (stderr), nothing elsewhere.
class ProgressBar {
 public:
  ProgressBar();
  ~ProgressBar();  // ends its line
  void Show(uint32_t done, uint32_t total, std::string_view unit);

 private:
  const bool terminal_;
  bool shown_ = false;
};

}  // namespace mesorig::client
