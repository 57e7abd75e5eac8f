#include "daemon/control/operator_visit.h"

#include <utility>

namespace mesorig::daemon {

Status AskAtRest(const RunContext& context, std::string text, std::string mount) {
  context.chain.Disarm();  // the door is meant to open
  context.activity.Suspend();
  bool waited = false;
  const Status asked = context.desk.Ask(std::move(text), std::move(mount), [&] {
    waited = context.on_wait(true);
    return waited;
  });
  context.activity.Continue();
  context.chain.Arm();
  if (waited) context.on_wait(false);
  return asked;
}

Status VisitRig(const RunContext& context, RigPower& power, CameraArray& cameras, std::string text,
                std::string mount) {
  MESORIG_RETURN_IF_ERROR(power.Down());
  MESORIG_RETURN_IF_ERROR(AskAtRest(context, std::move(text), std::move(mount)));
  MESORIG_RETURN_IF_ERROR(context.safety.MayEnergise());
  context.board.SetChain(context.chain.levels());
  cameras.Chill();
  return power.AxesOn(HomeWhich::kUnreferenced);  // those that lost their reference
}

}  // namespace mesorig::daemon
