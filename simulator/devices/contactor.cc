#include "simulator/devices/contactor.h"

namespace mesorig::simulator {

void Contactor::SetChain(bool chain_closed, RigTime now) {
  chain_closed_ = chain_closed;
  if (!chain_closed) Set(false, now);
}

void Contactor::ResetEdge(RigTime now) {
  if (chain_closed_) Set(true, now);
}

void Contactor::Set(bool closed, RigTime now) {
  if (closed == closed_ || (welded_ && !closed)) return;
  closed_ = closed;
  for (const auto& listener : listeners_) listener(closed, now);
}

}  // namespace mesorig::simulator
