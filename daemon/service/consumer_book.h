#pragma once
// Who reads frames at the moment, for the status.

#include <cstdint>
#include <list>
#include <string>
#include <vector>

#include "protocol/base/mutex.h"

namespace mesorig::daemon {

struct ConsumerFigures {
  std::string peer;
  uint32_t streams = 0;  // one a camera
  uint64_t frames_sent = 0;
};

// Thread-safe. Outlives its streams.
class ConsumerBook {
 public:
  // One stream, while it lives.
  class Stream {
   public:
    Stream(ConsumerBook& book, std::string peer);
    ~Stream();
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
    void CountFrame();

   private:
    ConsumerBook& book_;
    std::list<ConsumerFigures>::iterator entry_;
  };
  std::vector<ConsumerFigures> Get() const;  // one a peer, in order of peer

 private:
  mutable Mutex mutex_;
  std::list<ConsumerFigures> streams_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
