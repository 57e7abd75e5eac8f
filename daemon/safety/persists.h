#pragma once
// Something that must hold for a while before it is believed. A value of one thread, or guarded.

#include "protocol/base/clocks.h"

namespace mesorig::daemon {

class Persists {
 public:
  // True when it holds now and has held for `limit` at least.
  bool Update(bool holds, RigTime now, RigTime limit) {
    if (!holds) since_ = kNever;
    if (holds && since_ == kNever) since_ = now;
    return holds && now - since_ >= limit;
  }
  void Forget() { since_ = kNever; }

 private:
  RigTime since_ = kNever;
};

}  // namespace mesorig::daemon
