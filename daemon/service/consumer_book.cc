#include "daemon/service/consumer_book.h"

#include <map>

namespace mesorig::daemon {

ConsumerBook::Stream::Stream(ConsumerBook& book, std::string peer) : book_(book) {
  MutexLock lock(book_.mutex_);
  entry_ = book_.streams_.insert(book_.streams_.end(), {std::move(peer), 1, 0});
}

ConsumerBook::Stream::~Stream() {
  MutexLock lock(book_.mutex_);
  book_.streams_.erase(entry_);
}

void ConsumerBook::Stream::CountFrame() {
  MutexLock lock(book_.mutex_);
  ++entry_->frames_sent;
}

std::vector<ConsumerFigures> ConsumerBook::Get() const {
  std::map<std::string, ConsumerFigures> by_peer;
  {
    MutexLock lock(mutex_);
    for (const ConsumerFigures& stream : streams_) {
      ConsumerFigures& figures = by_peer[stream.peer];
      figures.peer = stream.peer;
      figures.streams += stream.streams;
      figures.frames_sent += stream.frames_sent;
    }
  }
  std::vector<ConsumerFigures> consumers;
  for (auto& [peer, figures] : by_peer) consumers.push_back(std::move(figures));
  return consumers;
}

}  // namespace mesorig::daemon
