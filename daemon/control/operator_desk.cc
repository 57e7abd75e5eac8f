#include "daemon/control/operator_desk.h"

namespace mesorig::daemon {

Status OperatorDesk::Ask(std::string text, std::string mount, const std::function<bool()>& posted) {
  MESORIG_RETURN_IF_ERROR(stop_.Check());  // nobody is sent to a rig that comes to rest
  chain_.BeginVisit();
  clock_.Change([&] {
    OperatorPrompt prompt;
    prompt.id = ++last_id_;
    prompt.text = std::move(text);
    prompt.mount = std::move(mount);
    prompt_ = std::move(prompt);
  });
  Status waited = Cancelled("the plan pauses before the operator is asked");
  const bool asked = posted();
  if (asked) {
    waited = stop_.Wait(kNever, [&] {
      const InterlockChain::Visit visit = chain_.VisitInsideChange();
      return prompt_->acknowledged && visit.door_cycled && visit.reset;
    });
  }
  clock_.Change([&] {
    prompt_.reset();
    hands_ = asked && !waited.ok();
  });
  return waited;
}

Status OperatorDesk::Acknowledge(uint32_t id) {
  Status status;
  clock_.Change([&] {
    if (!prompt_) {
      status = FailedPrecondition("nothing is asked of the operator");
    } else if (prompt_->id != id) {
      status =
          FailedPrecondition("prompt {} is not the one that waits, which is {}", id, prompt_->id);
    } else {
      prompt_->acknowledged = true;
    }
  });
  return status;
}

std::optional<OperatorPrompt> OperatorDesk::current() const {
  std::optional<OperatorPrompt> prompt;
  clock_.Read([&] {
    prompt = prompt_;
    if (!prompt) return;
    const InterlockChain::Visit visit = chain_.VisitInsideChange();
    prompt->door_cycled = visit.door_cycled;
    prompt->reset = visit.reset;
  });
  return prompt;
}

bool OperatorDesk::hands_in_the_rig() const {
  bool hands = false;
  clock_.Read([&] { hands = hands_; });
  return hands;
}

void OperatorDesk::BeginSession() {
  clock_.Change([&] {
    last_id_ = 0;
    hands_ = false;
  });
}

}  // namespace mesorig::daemon
