#include "daemon/control/state_machine.h"

namespace mesorig::daemon {

Status StateMachine::CheckInsideChange(SequencerCommand command) const {
  if (Allowed(state_, command)) return OkStatus();
  const StateRow& row = RowOf(state_);
  std::string possible;
  for (size_t i = 0; i < kCommandNames.size(); ++i) {
    if (row.allowed[i])
      possible += fmt::format("{}{}", possible.empty() ? "" : ", ", kCommandNames[i]);
  }
  return FailedPrecondition("{} is not possible while {}{}{}; possible is: {}",
                            kCommandNames[static_cast<size_t>(command)], row.name,
                            message_.empty() ? "" : ": ", message_, possible);
}

Status StateMachine::Check(SequencerCommand command) const {
  Status status;
  clock_.Read([&] { status = CheckInsideChange(command); });
  return status;
}

Status StateMachine::Give(SequencerCommand command, std::string_view reason,
                          const std::function<Status()>& take) {
  Status status;
  clock_.Change([&] {
    status = CheckInsideChange(command);
    if (status.ok() && take) status = take();
    if (status.ok()) Apply(command, reason);
  });
  return status;
}

void StateMachine::Order(RunOrder order, SequencerState state, std::string_view reason) {
  order_ = order;
  state_ = state;
  message_ = reason;
  if (order != RunOrder::kPause) stop_.RaiseInsideChange(reason);
}

void StateMachine::Apply(SequencerCommand command, std::string_view reason) {
  switch (command) {
    case SequencerCommand::kArm:
    case SequencerCommand::kStart:
    case SequencerCommand::kRun:
    case SequencerCommand::kResume:
    case SequencerCommand::kContinue:
      state_ =
          command == SequencerCommand::kArm ? SequencerState::kArmed : SequencerState::kRunning;
      order_ = RunOrder::kNone;
      message_.clear();
      stop_.LowerInsideChange();
      return;
    case SequencerCommand::kPause:
      return Order(RunOrder::kPause, SequencerState::kPausing, reason);
    case SequencerCommand::kPauseNow:
      return Order(RunOrder::kPauseNow, SequencerState::kPausing, reason);
    case SequencerCommand::kAbort:
      return Order(RunOrder::kAbort, SequencerState::kStopping, reason);
    case SequencerCommand::kStop:
      if (InSession(state_) && order_ != RunOrder::kStop) {
        Order(RunOrder::kStop, SequencerState::kStopping, reason);
      }
      return;
    case SequencerCommand::kAcknowledge:
      return;
    case SequencerCommand::kReset:
      state_ = SequencerState::kIdle;
      message_.clear();
      return;
  }
}

bool StateMachine::Move(SequencerState from, SequencerState to, std::string_view message) {
  bool moved = false;
  clock_.Change([&] {
    moved = state_ == from;
    if (!moved) return;
    state_ = to;
    message_ = message;
  });
  return moved;
}

void StateMachine::Rest(SequencerState state, std::string_view message) {
  clock_.Change([&] {
    state_ = state;
    message_ = message;
    order_ = RunOrder::kNone;
  });
}

void StateMachine::LowerStop() {
  clock_.Change([&] {
    if (order_ != RunOrder::kStop) stop_.LowerInsideChange();
  });
}

SequencerState StateMachine::state() const {
  SequencerState state{};
  clock_.Read([&] { state = state_; });
  return state;
}

RunOrder StateMachine::order() const {
  RunOrder order{};
  clock_.Read([&] { order = order_; });
  return order;
}

std::string StateMachine::message() const {
  std::string message;
  clock_.Read([&] { message = message_; });
  return message;
}

}  // namespace mesorig::daemon
